"""Files that mean harm, of every kind that is read: damaged, too large, or no files at all."""

import gzip
import json
import os
import random
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from operator import attrgetter
from pathlib import Path
from unittest.mock import patch

from support.abuse import Case, refused, stream

Read = Callable[[Path], object]


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of file that is read."""

    name: str  # of a file of that kind
    sound: Callable[[], bytes]
    read: Read


def reader(function: str, **given: object) -> Read:
    """Return a function "package.module:name" that reads a path; it is imported when called."""
    module, _, names = function.partition(":")
    return lambda path: attrgetter(names)(import_module(module))(path, **given)


def _run(path: Path) -> object:
    return reader("karma.journal.run_folder:read_run")(path.parent)


def _manifest(path: Path) -> object:
    with patch.dict(os.environ, {"KARMA_MODELS": str(path.parent)}):
        return import_module("karma.models.manifest").read_manifest()


# ----------------------------------------------------------------- sound ones


@cache
def _kitchen() -> bytes:
    from karma.files import to_json
    from support.household import kitchen

    return to_json(kitchen())


def as_json(value: object) -> Callable[[], bytes]:
    return lambda: json.dumps(value).encode() + b"\n"


@cache
def _graph() -> bytes:
    import tempfile

    from karma.memory.scene_graph import SceneGraph

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.json"
        SceneGraph([]).save(path)
        return path.read_bytes()


def _gguf_bytes() -> bytes:
    """Return the smallest model: sizes and one number."""

    def text(value: str) -> bytes:
        return struct.pack("<Q", len(value.encode())) + value.encode()

    pairs = [("general.architecture", 8, text("llama"))]
    sizes = ("context_length", "embedding_length", "block_count", "attention.head_count")
    pairs += [(f"llama.{name}", 4, struct.pack("<I", 8)) for name in sizes]
    tensor = text("t") + struct.pack("<IQIQ", 1, 1, 0, 0)  # one number
    body = b"".join(text(name) + struct.pack("<I", kind) + value for name, kind, value in pairs)
    whole = b"GGUF" + struct.pack("<IQQ", 3, 1, len(pairs)) + body + tensor
    return whole + bytes(-len(whole) % 32 + 32)


def _tensors() -> bytes:
    about = {"w": {"dtype": "F32", "shape": [2], "data_offsets": [0, 8]}}
    head = json.dumps(about).encode()
    return struct.pack("<Q", len(head)) + head + bytes(8)


TASK = {"id": "a", "kind": "simple", "scene": "kitchen_1",
        "subtasks": [{"instruction": "Open it.", "goals": ["OPEN(Fridge)"]}]}  # fmt: skip
EXPERIMENT = (
    b'name = "x"\ntasks = "t.jsonl"\nseeds = [0]\n[[rows]]\nname = "r"\n[models]\nthreads = 1\n'
)
KINDS = (
    Kind(name="home.json", sound=_kitchen, read=reader("karma.world.core.scene:load")),
    Kind(name="tasks.jsonl", sound=as_json(TASK), read=reader("karma.goals.files:load_tasks")),
    Kind(
        name="requests.jsonl",
        sound=as_json({"id": "a", "text": "Go."}),
        read=reader("karma.goals.files:load_texts"),
    ),
    Kind(
        name="x.toml",
        sound=lambda: EXPERIMENT,
        read=reader("karma.bench.engine.experiment_file:read_experiment"),
    ),
    Kind(name="map.json", sound=_graph, read=reader("karma.memory.scene_graph:SceneGraph.load")),
    Kind(
        name="a-0.jsonl.gz",
        sound=lambda: gzip.compress(b"{}"),
        read=reader("karma.journal.steps:read_steps"),
    ),
    Kind(name="header.json", sound=as_json({"name": "x"}), read=_run),
    Kind(name="manifest.toml", sound=lambda: b"", read=_manifest),
    Kind(
        name="config.json",
        sound=as_json({"a": 1}),
        read=reader("karma.models.checks.folder:read_config", fix="bring another"),
    ),
    Kind(name="model.gguf", sound=_gguf_bytes, read=reader("karma.models.checks.gguf:check_gguf")),
    Kind(
        name="mmproj.gguf",
        sound=_gguf_bytes,
        read=reader("karma.models.checks.gguf:check_projector"),
    ),
    Kind(
        name="model.safetensors",
        sound=_tensors,
        read=reader("karma.models.checks.folder:check_safetensors"),
    ),
)


# ----------------------------------------------------------------- harm


def _bomb(seed: int) -> bytes:
    """Return a gzip of 4 MB that holds 4 GB of zeros; made in a moment by repeating members."""
    return gzip.compress(bytes(1 << 24), compresslevel=9) * 256


def _deep(opening: bytes) -> bytes:
    return opening * 100_000


HOSTILE_TEXTS: tuple[tuple[str, Callable[[int], bytes]], ...] = (
    ("empty", lambda _: b""),
    ("zeros", lambda _: bytes(10_000)),
    ("deep lists", lambda _: _deep(b"[")),
    ("deep objects", lambda _: _deep(b'{"a":')),
    ("deep in TOML", lambda _: b"a = " + _deep(b"[")),
    ("dots in TOML", lambda _: b".".join([b"a"] * 20_000) + b" = 1\n"),
    ("no UTF-8", lambda _: b'{"id": "\xff\xfe"}'),
    ("lone surrogate", lambda _: rb'{"id": "\ud800", "name": "\udfff"}'),
    ("endless number", lambda _: b'{"version": 1' + b"0" * 50_000 + b"}"),
    ("number beyond floats", lambda _: b'{"version": 1e999, "grid_m": -1e999}'),
    ("no number", lambda _: b'{"version": NaN}'),
    ("a list", lambda _: b"[1, 2, 3]"),
    ("a text", lambda _: b'"' + b"x" * 1_000_000 + b'"'),
    ("null", lambda _: b"null"),
    ("many keys", lambda _: b"{" + b",".join(b'"k%d":0' % n for n in range(50_000)) + b"}"),
    ("escape sequences", lambda _: b'{"\x1b[2J": "\x1b]0;x\x07"}'),
    ("gzip bomb", _bomb),
)


def files(seed: int, count: int, kinds: Sequence[Kind] = KINDS) -> Iterator[Case]:
    """Yield damaged and hostile files of some kinds, in turns."""
    rng = stream(seed, "files")
    fixed = [(kind, what) for what in _whole_kinds() for kind in kinds]
    for number in range(count):
        kind, (name, make) = fixed[number] if number < len(fixed) else (
            kinds[number % len(kinds)], ("damaged", _damaged(rng.randrange(1 << 30)))
        )  # fmt: skip
        attack = _attack(kind, make, rng.randrange(1 << 30))
        yield Case(name=f"{kind.name}: {name} {number}", attack=attack)


def _whole_kinds() -> list[tuple[str, Callable[[Kind, Path, int], None]]]:
    made: list[tuple[str, Callable[[Kind, Path, int], None]]] = [
        ("a pipe", lambda _, path, __: os.mkfifo(path)),
        ("a folder", lambda _, path, __: path.mkdir()),
        ("a link to itself", lambda _, path, __: path.symlink_to(path.name)),
        ("a link to a pipe", _linked_pipe),
        ("not there", lambda *_: None),
    ]
    for name, content in HOSTILE_TEXTS:
        made.append((name, lambda _, path, seed, c=content: _put(path, c(seed))))
    return made


def _put(path: Path, data: bytes) -> None:
    path.write_bytes(data)


def _linked_pipe(kind: Kind, path: Path, seed: int) -> None:
    os.mkfifo(path.with_name("pipe"))
    path.symlink_to("pipe")


def _damaged(seed: int) -> Callable[[Kind, Path, int], None]:
    """Return what spoils a sound file: cuts, flipped bits, repeats, other values."""

    def make(kind: Kind, path: Path, _: int) -> None:
        rng = random.Random(seed)
        data = bytearray(kind.sound())
        for _ in range(rng.randrange(1, 6)):
            at = rng.randrange(len(data) or 1)
            match rng.randrange(5):
                case 0:
                    data = data[:at]
                case 1:
                    data[at : at + 1] = bytes([rng.randrange(256)])
                case 2:
                    data[at:at] = data[at : at + rng.randrange(200)]
                case 3:
                    data[at : at + rng.randrange(9)] = b"1e308"
                case _:
                    data[at : at + 8] = struct.pack("<Q", rng.choice((1 << 63, (1 << 32) - 1, 7)))
        path.write_bytes(data)

    return make


def _attack(
    kind: Kind, make: Callable[[Kind, Path, int], None], seed: int
) -> Callable[[Path], None]:
    def attack(folder: Path) -> None:
        path = folder / kind.name
        make(kind, path, seed)
        before = sorted(one.name for one in folder.iterdir())
        try:
            kind.read(path)
        except Exception:  # noqa: BLE001  it must be an error of karma's
            refused(lambda: kind.read(path), naming=kind.name.partition(".")[0])
        assert sorted(one.name for one in folder.iterdir()) == before, "something was left"

    return attack
