"""A lived memory that was damaged on the disk is refused by name, or answers as it did."""

import random
import sqlite3
import subprocess
import sys
from contextlib import closing

import pytest
from support.abuse import all_held
from support.abuse.memories import answers, damaged, left, memories
from support.lived import PLACES, LetterEmbedder

from karma.errors import FileError
from karma.memory.lived.episodes import SEAL, EpisodeLog
from karma.memory.lived.true_memory import LOG


def test_damaged_memory_is_refused_by_name_or_answers_as_it_did(tmp_path):
    all_held(memories, 60, tmp_path)


@pytest.fixture
def log_path(tmp_path):
    for name, data in left().files.items():
        (tmp_path / name).write_bytes(data)
    return tmp_path / LOG


def test_edited_memory_is_refused_and_left_as_it_is(log_path):
    with closing(sqlite3.connect(log_path)) as base:
        base.execute("update episodes set states = ' sliced ' where id = 7")
        base.commit()
    edited = log_path.read_bytes()
    for _ in range(2):
        with pytest.raises(FileError, match=f"{LOG}: is not as it was left") as told:
            answers(log_path)
        assert f"rm {log_path}" in told.value.fix
    assert log_path.read_bytes() == edited


def test_seal_is_one_that_other_programs_check(log_path):
    assert answers(log_path) == left().answers  # opened and closed
    command = ["sha256sum", "-c", f"{LOG}{SEAL}"]
    subprocess.run(command, cwd=log_path.parent, capture_output=True, check=True)


def test_memory_of_a_process_that_ended_without_closing_it_is_opened(log_path):
    held = EpisodeLog(log_path, LetterEmbedder(), PLACES)
    held.keep("looked", {"Desk|1": 9.0})
    held.commit()
    held._base.close()  # SQLite writes its pages now; nobody seals them
    again = EpisodeLog(log_path, LetterEmbedder(), PLACES)
    assert again.kept("looked")["Desk|1"] == 9.0


def test_unsealed_memory_with_rows_that_cannot_be_read_is_refused_by_name(log_path):
    log_path.with_name(f"{LOG}{SEAL}").unlink()
    sound, named = log_path.read_bytes(), 0
    for seed in range(60):
        log_path.with_name(f"{LOG}{SEAL}").unlink(missing_ok=True)
        log_path.write_bytes(damaged(sound, random.Random(seed)))
        try:
            answers(log_path)
        except FileError as error:
            named += LOG in str(error)
    assert named > 20


def test_memory_in_use_is_said_to_be_in_use(log_path):
    held = EpisodeLog(log_path, LetterEmbedder(), PLACES)
    held._base.execute("pragma busy_timeout = 50")
    writes = (
        f"import sqlite3; base = sqlite3.connect({str(log_path)!r}, isolation_level=None);"
        "base.execute('begin immediate'); print('begun', flush=True); input()"
    )
    other = subprocess.Popen(
        [sys.executable, "-c", writes], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    with other:
        assert other.stdout.readline() == "begun\n"
        with pytest.raises(FileError, match="database is locked") as told:
            held.drop("Mug|0")
        other.stdin.close()
    assert "another process is at work in it" in told.value.fix
    held.drop("Mug|0")
    held.close()
