"""Attacks on the stack, drawn by seed ($KARMA_SEED, 0), as many as $KARMA_SAMPLE says.

A class of attacks is a function `(seed, count) -> Iterator[Case]`. What holds returns from
`Case.attack`; whatever it raises is what gave way. Files, links and pipes are made in the folder
that the attack is given, and nowhere else; connections go to this machine only.
"""

import os
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from karma.errors import KarmaError

SAMPLE = int(os.environ.get("KARMA_SAMPLE", "0"))  # 0: what a test draws by itself
SEED = int(os.environ.get("KARMA_SEED", "0"))


@dataclass(frozen=True, kw_only=True)
class Case:
    """One attack."""

    name: str
    attack: Callable[[Path], None]  # in an empty folder


def all_held(draw: Callable[[int, int], Iterator[Case]], count: int, folder: Path) -> None:
    """Try `count` cases of a class, or $KARMA_SAMPLE; raises AssertionError with what gave way."""
    gave_way = []
    tried = 0
    for tried, case in enumerate(draw(SEED, SAMPLE or count), 1):
        place = folder / str(tried)
        place.mkdir(parents=True)
        try:
            case.attack(place)
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt):
                raise
            gave_way.append((case.name, f"{type(error).__name__}: {str(error)[:300]}"))
    assert tried >= min(SAMPLE or count, count)
    assert not gave_way, gave_way[:5]


def refused(act: Callable[[], object], *, naming: str = "") -> None:
    """See that something is refused as the command line shows it: karma's error, in few lines."""
    try:
        act()
    except KarmaError as error:
        said = str(error)
        assert naming in said, f"does not name {naming!r}: {said[:200]}"
        assert len(said.splitlines()[0]) < 2000, "a line of any length"
        return
    raise AssertionError("was not refused")


def stream(seed: int, name: str) -> random.Random:
    """Return the generator of a class."""
    return random.Random(f"{seed}/{name}")
