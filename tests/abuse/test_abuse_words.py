"""What is typed, piped in or planted: a message with a reason, never a traceback or silence."""

import gzip
import os
import subprocess
import sys
from pathlib import Path

import pytest
from support.paths import ROOT
from support.run_files import write_experiment

from karma.bench.engine.run import Run
from karma.errors import FileError
from karma.journal.folder import EPISODES, RESULTS
from karma.journal.run_folder import read_run
from karma.journal.steps import steps_path

KARMA = str(Path(sys.executable).parent / "karma")
POLICY = """
class Odd:
    def __init__(self, capacity): {making}
    def touch(self, key): {touching}
    def discard(self, key): ...
    def __contains__(self, key): return False
    def __len__(self): return 0
    def __iter__(self): return iter(())
"""


def shell(command, folder, **environment):
    done = subprocess.run(
        ["bash", "-c", command],
        cwd=folder,
        env={**os.environ, "KARMA": KARMA, **environment},
        capture_output=True,
        timeout=120,
        check=False,
    )
    said = (done.stdout + done.stderr).decode("utf-8", "replace")
    assert "Traceback" not in said
    return done.returncode, " ".join(said.split())


CHAT = "$KARMA chat --planner karma-nano --fresh"


@pytest.mark.parametrize(
    ("command", "code", "said"),
    [
        ("printf 'open \\xff it\\nis the fridge open?\\n' | " + CHAT, 5, "The fridge is in this"),
        (
            f"(head -c 1000000 /dev/zero | tr '\\0' a; echo; echo 'go home?') | {CHAT}",
            1,
            "characters are too many for one request",
        ),
        ("$KARMA eval demo --set seeds=$(printf '1%.0s' {1..5000})", 1, "error: "),
    ],
)
def test_foreign_bytes_and_endless_words(tmp_path, command, code, said):
    found, told = shell(command, tmp_path)
    assert (found, said in told) == (code, True), told[-500:]


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("import sys; sys.exit(0)", "importing it raised SystemExit"),
        ("raise RuntimeError('\\x1b[31mred')", "importing it raised RuntimeError: \\x1b[31mred"),
        (POLICY.format(making="raise ValueError('small')", touching="..."), "small"),
        (POLICY.format(making="...", touching="return 1 / 0"), "raised ZeroDivisionError"),
    ],
)
def test_plug_in_that_fails_is_named_and_no_run_ends_in_silence(tmp_path, body, said):
    (tmp_path / "bad_plug.py").write_text(body)
    about = tmp_path / "bad_plug-1.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: bad-plug\nVersion: 1\n")
    (about / "entry_points.txt").write_text("[karma.policies]\nodd = bad_plug:Odd\n")
    command = (
        "$KARMA eval demo --only simple-03 --row KARMA --set models.planner=karma-nano"
        " --set 'rows.KARMA.options.policy=odd[9]' --out run"
    )
    code, told = shell(command, tmp_path, PYTHONPATH=f"{tmp_path}{os.pathsep}{ROOT}")
    assert code == 1
    assert "odd" in told
    assert said in told


def expert(folder, steps=False):
    path = write_experiment(
        folder / "x.toml",
        "karma-nano",
        rows='[[rows]]\nname = "expert"\nmethod = "expert"\n',
        only=["simple-11", "simple-14"],
        more="",
    )
    return Run(path, folder / "run", steps=steps)


def test_run_that_was_edited_after_its_end_is_believed_by_nobody(tmp_path):
    run = expert(tmp_path)
    assert len(list(run.episodes())) == 2
    place, results = run.folder / EPISODES, (run.folder / RESULTS).read_bytes()
    whole = place.read_text()
    edits = [whole.replace(":", ": ", 1), whole[: len(whole) // 2], whole.splitlines(True)[0], ""]
    for edited in edits:
        place.write_text(edited)
        for again in (lambda: read_run(run.folder), lambda: expert(tmp_path)):
            with pytest.raises(FileError, match="is not as it was left"):
                again()
        assert place.read_text() == edited
        assert (run.folder / RESULTS).read_bytes() == results
    place.write_text(whole)
    assert len(read_run(run.folder).records) == 2
    assert list(expert(tmp_path).episodes()) == []


def test_edited_step_log_is_believed_by_nobody_and_one_that_is_gone_is_made_again(tmp_path):
    run = expert(tmp_path, steps=True)
    assert len(list(run.episodes())) == 2
    log = steps_path(run.folder, *read_run(run.folder).records[0].key)
    whole = log.read_bytes()
    log.write_bytes(gzip.compress(gzip.decompress(whole).replace(b"robot", b"robin", 1)))
    with pytest.raises(FileError, match=f"{log.name}.*is not as it was left"):
        read_run(run.folder)
    log.unlink()
    assert len(list(expert(tmp_path, steps=True).episodes())) == 1
    assert log.read_bytes() == whole


def test_run_that_was_stopped_goes_on(tmp_path):
    run = expert(tmp_path)
    next(iter(run.episodes()))
    del run
    assert len(list(expert(tmp_path).episodes())) == 1
    assert read_run(tmp_path / "run").finished
