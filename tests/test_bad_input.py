"""What is wrong with a file is said with its name and place, and nothing half-written stays."""

import json
import os
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest
from support.household import kitchen
from support.paths import ROOT
from support.tiny import export_tiny

from karma.errors import FileError, ModelError
from karma.files import append_line, decode_json, read_toml, to_json, write_atomic
from karma.goals.files import load_tasks
from karma.models.llama.model import LlamaModel
from karma.world.core import scene as scenes
from karma.world.sim import EmbeddedWorld

# ----------------------------------------------------------------- scenes and dumps


def scene_file(folder, **changes):
    path = folder / "home.json"
    raw = {**json.loads(to_json(kitchen())), **changes}
    path.write_text(json.dumps(raw))
    return path


def without_things(raw, **first):
    """The objects of a scene, the first one changed."""
    objects = json.loads(to_json(raw))["objects"]
    return [{**objects[0], **first}, *objects[1:]]


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"colour": "red"}, "unknown field `colour`"),
        ({"room": "Attic"}, r"'Attic'.*\$\.room"),
        ({"version": 2}, r"\$\.version"),
        ({"reachable": [[0.0]]}, r"\$\.reachable\[0\]"),
        ({"objects": without_things(kitchen(), position="here")}, r"\$\.objects\[0\]\.position"),
        ({"objects": without_things(kitchen(), parents=["Shelf|9"])}, r"'Shelf\|9', which is not"),
        ({"objects": without_things(kitchen(), capabilities=["flies"])}, r"'flies'.*objects\[0\]"),
    ],
)
def test_broken_scene_is_refused_with_file_and_place(tmp_path, changes, named):
    path = scene_file(tmp_path, **changes)
    with pytest.raises(FileError, match=rf"home\.json: .*{named}"):
        scenes.load(path)
    with pytest.raises(FileError, match=r"home\.json"):
        EmbeddedWorld(str(path))


def test_unknown_type_in_a_scene_is_refused_by_name(tmp_path):
    objects = list(kitchen().objects)
    number = next(i for i, thing in enumerate(objects) if thing.type == "Egg")
    objects[number] = msgspec.structs.replace(objects[number], type="Unicorn")
    path = tmp_path / "home.json"
    path.write_bytes(to_json(msgspec.structs.replace(kitchen(), objects=tuple(objects))))
    with pytest.raises(FileError, match=r"home\.json: 'Egg.*unknown object type 'Unicorn'"):
        scenes.load(path)
    with pytest.raises(FileError, match="'Unicorn'"):
        EmbeddedWorld(str(path))


# ----------------------------------------------------------------- tasks


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"colour": "red"}, "unknown field `colour`"),
        ({"subtasks": [{"instruction": "Go.", "goals": [], "hint": 1}]}, "unknown field `hint`"),
        ({"id": 7}, r"\$\.id"),
    ],
)
def test_task_file_with_a_wrong_key_is_refused_with_line_and_key(tmp_path, change, named):
    good = {"id": "a", "kind": "simple", "scene": "kitchen_1",
            "subtasks": [{"instruction": "Open it.", "goals": ["OPEN(Fridge)"]}]}  # fmt: skip
    path = tmp_path / "tasks.jsonl"
    path.write_text(json.dumps(good) + "\n\n" + json.dumps({**good, "id": "b", **change}) + "\n")
    with pytest.raises(FileError, match=rf"tasks\.jsonl: line 3: .*{named}"):
        load_tasks(path)


# ----------------------------------------------------------------- models


@pytest.fixture(scope="module")
def gguf(tmp_path_factory):
    return export_tiny(tmp_path_factory.mktemp("m") / "tiny.gguf")


def test_model_of_another_hash_is_refused_with_both_hashes(gguf):
    with pytest.raises(ModelError) as caught:
        LlamaModel(gguf, sha256="00ff")
    for part in ("tiny.gguf: its SHA-256 is", "Expected SHA-256: 00ff", "karma models verify"):
        assert part in str(caught.value)


# ----------------------------------------------------------------- full disks

LIMITED = """
import resource, signal, sys
from karma.errors import FileError
from karma.files import append_line, write_atomic
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
sys.dont_write_bytecode = True
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
try:
    {"write": write_atomic, "append": append_line}[sys.argv[1]](sys.argv[2], b"x" * 5000)
except FileError as error:
    print(error)
    sys.exit(7)
"""


def limited(what, path):
    """Write 5000 bytes where a file may have 1000, and return what was said."""
    found = subprocess.run(
        [sys.executable, "-c", LIMITED, what, str(path)],
        capture_output=True, text=True, check=False, cwd=ROOT,
    )  # fmt: skip
    assert found.returncode == 7, found.stderr
    return found.stdout


@pytest.mark.parametrize("before", [None, b"the old content"])
def test_write_without_room_leaves_the_old_file_and_nothing_else(tmp_path, before):
    path = tmp_path / "results.json"
    if before is not None:
        path.write_bytes(before)
    said = limited("write", path)
    assert "results.json: cannot write: File too large" in said
    assert "To fix: free some space" in said
    assert [file.name for file in tmp_path.iterdir()] == ([path.name] if before else [])
    assert before is None or path.read_bytes() == before


def test_append_without_room_is_refused_and_keeps_whole_lines(tmp_path):
    path = tmp_path / "episodes.jsonl"
    append_line(path, b"one\n")
    assert "episodes.jsonl: cannot write" in limited("append", path)
    assert path.read_bytes().startswith(b"one\n")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_append_to_a_full_device_is_refused_with_the_fix():
    with pytest.raises(FileError, match=r"/dev/full: cannot write: No space left.*\n.*free some"):
        append_line("/dev/full", b"line\n")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_folder_that_may_not_be_written_is_named(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(FileError, match=r"x\.json: cannot write: Permission denied"):
        write_atomic(tmp_path / "x.json", b"data")


def test_folder_that_is_a_file_is_named(tmp_path):
    (tmp_path / "runs").write_bytes(b"")
    for write in (write_atomic, append_line):
        with pytest.raises(FileError, match=r"runs/x\.json: cannot write"):
            write(tmp_path / "runs" / "x.json", b"data")


# ----------------------------------------------------------------- a mark that editors write


TASKS = ROOT / "eval/alfred_l/tasks.jsonl"


def test_byte_order_mark_at_the_beginning_is_passed_over(tmp_path):
    marked = {name: tmp_path / name for name in ("tasks.jsonl", "demo.toml")}
    for path, source in zip(marked.values(), (TASKS, ROOT / "eval/demo.toml"), strict=True):
        path.write_bytes(b"\xef\xbb\xbf" + source.read_bytes())
    assert load_tasks(marked["tasks.jsonl"]) == load_tasks(TASKS)
    assert read_toml(marked["demo.toml"], dict) == read_toml(ROOT / "eval/demo.toml", dict)
    assert decode_json(b"\xef\xbb\xbf[1]", list, path="x") == [1]
    assert decode_json("\ufeff[1]", list, path="x") == [1]


@pytest.mark.parametrize("where", ["task", "subtask", "scene"])
def test_key_of_a_task_that_stands_twice_is_refused_with_its_line(tmp_path, where):
    first, second, *_ = TASKS.read_text().splitlines()
    key, text = {
        "task": ("kind", second.replace('"kind":', '"kind": "simple", "kind":')),
        "subtask": ("goals", second.replace('"goals":', '"goals": [], "goals":', 1)),
        "scene": ("id", second.replace('"id":', '"id": "x", "id":', 1)),
    }[where]
    path = tmp_path / "tasks.jsonl"
    path.write_text(f"{first}\n{text}\n")
    with pytest.raises(FileError, match=f"line 2: '{key}' stands twice"):
        load_tasks(path)
