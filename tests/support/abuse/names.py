"""Names made of pieces that mean something to file systems, shells and terminals."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from support.abuse import Case, stream
from support.abuse.answers import BAD

Way = Callable[[str, Path], None]  # how a name becomes a path in a folder
_PIECES = (
    "..", ".", "/", "//", "\\", "~", "a", "FloorPlan1", "\0", "\n", "%2e%2e%2f", "C:", "CON", " ",
    "．．", "∕", "‥", "x" * 300, "-rf", "$HOME", "`id`", "|", "*", "\udcff", "..;/", "/etc/x",
    *BAD,
)  # fmt: skip


def names(seed: int, count: int, ways: Sequence[Way]) -> Iterator[Case]:
    """Yield names that become paths in some ways, in turns."""
    rng = stream(seed, "names")
    for number in range(count):
        name = "".join(rng.choice(_PIECES) for _ in range(rng.randrange(1, 5)))
        way = ways[number % len(ways)]
        yield Case(name=f"{way.__name__} {name[:40]!a}", attack=_tried(way, name))


def _tried(way: Way, name: str) -> Callable[[Path], None]:
    def attack(folder: Path) -> None:
        inner = folder / "deep" / "inside"
        inner.mkdir(parents=True)
        way(name, inner)
        found = {path for path in folder.rglob("*") if path.is_file()}
        assert all(inner in path.parents for path in found), f"left the folder: {found}"

    return attack
