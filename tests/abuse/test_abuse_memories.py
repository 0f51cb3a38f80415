"""A lived memory that was damaged on the disk is refused by name, or answers as it did."""

import random
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from support.abuse import Case, all_held, refused, stream
from support.lived import PLACES, LetterEmbedder, seen

from karma.plugins.homes.memory.episodes import Belief, EpisodeLog, EpisodeQuery
from karma.plugins.homes.memory.true_memory import LOG
from karma.plugins.homes.types import Deed

_ASKED = (
    EpisodeQuery(),
    EpisodeQuery(types=("Mug",), after_s=5_000.0),
    EpisodeQuery(who="Ann", action="PutObject"),
    EpisodeQuery(state="dirty", text="dirty mug, desk, bedroom"),
)


_SECTOR, _PAGE = 512, 4096


@dataclass(frozen=True)
class Lived:
    """A memory that was left, and what it answers."""

    files: dict[str, bytes]
    answers: list[object]


def memories(seed: int, count: int) -> Iterator[Case]:
    """Yield memories whose log was damaged at a drawn place."""
    rng = stream(seed, "memories")
    for number in range(count):
        yield Case(name=f"damaged {number}", attack=Attack(rng.randrange(1 << 30)))


@dataclass(frozen=True)
class Attack:
    """One damaged memory."""

    seed: int

    def __call__(self, folder: Path) -> None:
        """See that it is refused by name, or answers as the sound one."""
        for name, data in left().files.items():
            (folder / name).write_bytes(data)
        path = folder / LOG
        path.write_bytes(damaged(path.read_bytes(), random.Random(self.seed)))
        copy = folder / "copy"
        copy.mkdir()
        for name in left().files:
            shutil.copy(folder / name, copy)
        try:
            found = answers(path)
        except Exception:  # noqa: BLE001  it must be an error of karma's
            refused(lambda: answers(copy / LOG), naming=LOG)
            return
        assert found == left().answers, "silently different"


def damaged(sound: bytes, rng: random.Random) -> bytes:
    """Return bytes with one fault."""
    data = bytearray(sound)
    at = rng.randrange(len(data))
    page, other = (rng.randrange(len(data) // _PAGE) * _PAGE for _ in range(2))
    match rng.randrange(6):
        case 0 | 1:
            data[at] ^= 1 << rng.randrange(8)
        case 2:
            data[at] = rng.randrange(256)
        case 3:
            data[at : at + _SECTOR] = bytes(min(_SECTOR, len(data) - at))
        case 4:
            data[page : page + _PAGE] = data[other : other + _PAGE]
        case _:
            del data[at:]
    return bytes(data)


def answers(path: Path) -> list[object]:
    """Return all that a log says, in short."""
    log = EpisodeLog(path, LetterEmbedder(), PLACES)
    try:
        found: list[object] = [list(log.episodes()), log.kept("looked"), len(log)]
        return found + [log.recall(query, 1_000) for query in _ASKED]
    finally:
        log.close()


@cache
def left() -> Lived:
    """Return a memory of 300 episodes as it is after its process ended."""
    with tempfile.TemporaryDirectory() as place:
        path = Path(place, LOG)
        log = EpisodeLog(path, LetterEmbedder(), PLACES)
        rng = random.Random(3)
        for at in range(300):
            kind, begun_s = rng.choice(("Mug", "Book", "Apple")), at * 100.0
            number = f"{kind}|{at}"
            who = rng.choice(("Ann", "Ben"))
            deed = Deed(
                time_s=begun_s, who=who, action="PutObject", object_id=number, object_type=kind
            )
            states = ("dirty",) if at % 4 == 0 else ()
            last = seen(number, rng.choice(list(PLACES)), begun_s + 50.0, states)
            one = Belief(sighting=last, since_s=begun_s, deed=deed if at % 3 == 0 else None)
            log.begin(one)
            if at % 5:
                log.end(one)
        log.keep("looked", {place_id: 7.0 for place_id in PLACES})
        log.close()
        files = {one.name: one.read_bytes() for one in Path(place).iterdir()}
        return Lived(files=files, answers=answers(path))


def test_damaged_memory_is_refused_by_name_or_answers_as_it_did(tmp_path):
    all_held(memories, 60, tmp_path)
