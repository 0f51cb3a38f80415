"""Measure the memory of a lived-in home at size: recall, insertions, restart, bytes, a year.

Moments are drawn, not lived: things of 50 types that move between 60 places. Latencies are medians
on one thread; the text query goes through MiniLM, whose own share is given beside it.

    python scripts/bench_lived_memory.py --out runs/lived_memory.json
"""

import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import track
from rich.table import Table

from karma.contracts import Deed, HomeMoment, HomeQuestion, Meaning, SaidThing, Sighting
from karma.files import to_json, write_atomic
from karma.household.types import object_types
from karma.infer.embed.minilm import MiniLm
from karma.memory.lived.episodes import EpisodeLog, EpisodeQuery
from karma.memory.lived.setting import KnownPlace, MemorySetting
from karma.memory.lived.true_memory import LOG, TrueMemory
from karma.seeds import stream

DAY_S = 86_400.0
ASKED = 40  # questions of each kind
KINDS = ("Cabinet", "Drawer", "Shelf", "CounterTop", "SideTable", "Desk")
ROOMS = ("kitchen", "living", "bedroom", "bathroom")


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """One size."""

    units: int  # episodes in the log
    objects: int
    inserted_per_s: float
    question_ms: float  # a type known, now or then
    text_ms: float  # text, time, place and state together
    embed_ms: float  # of that, MiniLM's for a text never seen before
    restart_s: float
    file_mb: float


def drawn_places(number: int = 60) -> dict[str, KnownPlace]:
    """Return furniture."""
    found = {}
    for at in range(number):
        kind, room = KINDS[at % len(KINDS)], ROOMS[at // 15 % len(ROOMS)]
        place_id = f"{kind}|{at}"
        found[place_id] = KnownPlace(
            place_id=place_id, place_type=kind, room=f"{room}_1", room_kind=room, openable=False
        )
    return found


def drawn_moments(units: int, objects: int, days: float, seed: int) -> Iterator[HomeMoment]:
    """Yield moments in which some thing has come to another place, spread over days."""
    rng = stream(seed, "bench", "lived", str(units), str(objects))
    places = list(drawn_places().values())
    types = [name for name, kind in object_types().items() if kind.can("pickupable")][:50]
    for number in range(units):
        which = int(rng.integers(objects)) if number >= objects else number
        place = places[int(rng.integers(len(places)))]
        time_s = number * days * DAY_S / units
        kind = types[which % len(types)]
        seen = Sighting(
            time_s=time_s,
            object_id=f"{kind}|{which}",
            object_type=kind,
            place_id=place.place_id,
            room=place.room,
            position_m=(0.0, 0.0, 0.0),
            states=("dirty",) if rng.random() < 0.2 else (),
        )
        deed = Deed(
            time_s=time_s, who="Ann", action="PutObject", object_id=seen.object_id,
            object_type=kind, place_id=place.place_id, room=place.room,
        ) if rng.random() < 0.3 else None  # fmt: skip
        yield HomeMoment(time_s=time_s, room=place.room, seen=(seen,), deed=deed)


def measured(units: int, objects: int, embedder: MiniLm, folder: Path) -> Measured:
    """Fill a memory and measure it."""
    setting = MemorySetting(embedder=embedder, places=drawn_places(), folder=folder)
    memory = TrueMemory(setting)
    begun = time.perf_counter()
    for number, moment in enumerate(drawn_moments(units, objects, 30.0, 0)):
        memory.take_in(moment)
        if number % 20 == 19:
            memory.commit()
    memory.commit()
    inserted = units / (time.perf_counter() - begun)
    question_ms = _median_ms(lambda at: memory.recall(_question(at), 64))
    memory.close()
    begun = time.perf_counter()
    memory = TrueMemory(setting)
    restart_s = time.perf_counter() - begun
    memory.close()
    log = EpisodeLog(folder / LOG, embedder, setting.places)
    log.recall(EpisodeQuery(text="a mug"), 1)  # the index is made once
    text_ms = _median_ms(lambda at: log.recall(_text_query(at, f"{units} {objects}"), 20))
    embed_ms = _median_ms(lambda at: embedder.embed([f"thing {at} of {units} {objects}"]))
    size = log.size_bytes() / 1e6
    log.close()
    return Measured(
        units=units, objects=objects, inserted_per_s=inserted, question_ms=question_ms,
        text_ms=text_ms, embed_ms=embed_ms, restart_s=restart_s, file_mb=size,
    )  # fmt: skip


def _median_ms(do: Callable[[int], object]) -> float:
    taken = []
    for at in range(ASKED):
        begun = time.perf_counter()
        do(at)
        taken.append(1000 * (time.perf_counter() - begun))
    return statistics.median(taken)


def _question(at: int) -> HomeQuestion:
    """Return a question for now, or every second time for the past."""
    types = [name for name, kind in object_types().items() if kind.can("pickupable")][:50]
    said = SaidThing(phrase="the thing", types=(Meaning(name=types[at % 50], similarity=1.0),))
    now_s = 31 * DAY_S
    if at % 2:
        said = SaidThing(phrase="it", types=said.types, after_s=5 * DAY_S, before_s=6 * DAY_S)
    return HomeQuestion(text="", speaker="Ann", time_s=now_s, asked="place", thing=said)


def _text_query(at: int, size: str) -> EpisodeQuery:
    """Return a query whose text no other size has asked for: MiniLM keeps what it has embedded."""
    return EpisodeQuery(
        text=f"something soft to wash up with, number {at} of {size}",
        after_s=(at % 25) * DAY_S,
        before_s=(at % 25 + 4) * DAY_S,
        state="dirty" if at % 2 else "",
    )


def year(embedder: MiniLm, folder: Path, most: int) -> tuple[int, float, float]:
    """Live 365 drawn days with a budget; return episodes, megabytes at half and at the end."""
    setting = MemorySetting(embedder=embedder, places=drawn_places(), folder=folder)
    memory = TrueMemory(setting, most_episodes=most)
    half = 0.0
    total = 365 * 150
    for number, moment in enumerate(drawn_moments(total, 150, 365.0, 1)):
        memory.take_in(moment)
        if number % 50 == 49:
            memory.commit()
        if number == total // 2:
            half = memory.size_bytes() / 1e6
    memory.commit()
    found = (memory.episodes, half, memory.size_bytes() / 1e6)
    memory.close()
    return found


def main(
    out: Annotated[Path | None, typer.Option(help="Takes the figures as JSON.")] = None,
    most: Annotated[int, typer.Option(help="Episodes kept in the year.")] = 20_000,
) -> None:
    """Print a table of sizes, and what a year comes to."""
    embedder = MiniLm()
    sizes = [(10, 10), (100, 100), (1_000, 100), (10_000, 1_000), (100_000, 100), (100_000, 10_000)]
    found: list[Measured] = []
    with tempfile.TemporaryDirectory() as place:
        for number, (units, objects) in enumerate(track(sizes, description="sizes")):
            folder = Path(place, str(number))
            folder.mkdir()
            found.append(measured(units, objects, embedder, folder))
        folder = Path(place, "year")
        folder.mkdir()
        episodes, half, end = year(embedder, folder, most)
    table = Table("units", "objects", "inserted/s", "question ms", "text ms", "of it MiniLM ms",
                  "restart s", "file MB")  # fmt: skip
    for one in found:
        table.add_row(
            f"{one.units:,}", f"{one.objects:,}", f"{one.inserted_per_s:,.0f}",
            f"{one.question_ms:.2f}", f"{one.text_ms:.2f}", f"{one.embed_ms:.2f}",
            f"{one.restart_s:.2f}", f"{one.file_mb:.1f}",
        )  # fmt: skip
    console = Console()
    console.print(table)
    console.print(
        f"365 days, at most {most:,} closed episodes: {episodes:,} at the end; "
        f"{half:.1f} MB after half the year, {end:.1f} MB after all of it"
    )
    if out is not None:
        rows = {"sizes": [asdict(one) for one in found],
                "year": {"episodes": episodes, "half_mb": half, "end_mb": end}}  # fmt: skip
        write_atomic(out, to_json(rows, indent=1))


if __name__ == "__main__":
    typer.run(main)
