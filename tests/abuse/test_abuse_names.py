"""Names in files that become paths stay in their folder, or are refused."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path

from support.abuse import Case, all_held, stream
from support.abuse.answers import BAD

from karma.agent.journal.steps import steps_path
from karma.errors import FileError
from karma.files import below
from karma.plugins.airgap.install import unsafe

_PIECES = (
    "..", ".", "/", "//", "\\", "~", "a", "FloorPlan1", "\0", "\n", "%2e%2e%2f", "C:", "CON", " ",
    "．．", "∕", "‥", "x" * 300, "-rf", "$HOME", "`id`", "|", "*", "\udcff", "..;/", "/etc/x",
    *BAD,
)  # fmt: skip


def names(seed: int, count: int) -> Iterator[Case]:
    """Yield names made of pieces that mean something to file systems, shells and terminals."""
    rng = stream(seed, "names")
    ways: tuple[Callable[[str, Path], None], ...] = (
        _of_a_file,
        _of_steps,
        _of_a_member,
        _of_a_room,
    )
    for number in range(count):
        name = "".join(rng.choice(_PIECES) for _ in range(rng.randrange(1, 5)))
        way = ways[number % len(ways)]
        yield Case(name=f"{way.__name__} {name[:40]!a}", attack=_tried(way, name))


def _tried(way: Callable[[str, Path], None], name: str) -> Callable[[Path], None]:
    def attack(folder: Path) -> None:
        inner = folder / "deep" / "inside"
        inner.mkdir(parents=True)
        way(name, inner)
        found = {path for path in folder.rglob("*") if path.is_file()}
        assert all(inner in path.parents for path in found), f"left the folder: {found}"

    return attack


def _of_a_file(name: str, folder: Path) -> None:
    try:
        path = below(folder, name)
    except FileError as error:
        assert len(str(error)) < 1000
        return
    path.write_text("x")
    assert path.parent == folder


def _of_steps(name: str, folder: Path) -> None:
    path = steps_path(folder, name, name, 0)
    path.parent.mkdir(parents=True)
    path.write_text("x")
    assert path.resolve().is_relative_to(folder.resolve())
    assert steps_path(folder, name + "?", name, 0) != path


def _of_a_member(name: str, folder: Path) -> None:
    if not unsafe(name):
        inside = (folder / name).resolve().is_relative_to(folder.resolve())
        assert inside, "a member out of the folder is taken"


def _of_a_room(name: str, folder: Path) -> None:
    from support.abuse.files import dumped_as
    from typer.testing import CliRunner

    from karma.cli import app

    dump = folder / "dump.jsonl"
    dump.write_bytes(dumped_as(json.dumps(name)))
    said = CliRunner().invoke(app, ["world", "import", str(dump), "--out", str(folder / "out")])
    assert said.exit_code in (0, 1), said.output
    assert said.exception is None or isinstance(said.exception, SystemExit), repr(said.exception)


def test_name_of_any_pieces_never_leaves_the_folder_that_it_is_for(tmp_path):
    all_held(names, 200, tmp_path)
