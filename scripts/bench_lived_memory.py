"""Measure the memory of a lived-in home at size: recall, insertions, bytes, a year.

Moments are drawn, not lived: things of 50 types that move between 60 places. Latencies are medians
on one thread; the text query goes through MiniLM, whose own share is the reference beside it.

    python scripts/bench_lived_memory.py [--most 20000]
"""

import time
from collections.abc import Callable, Iterator
from statistics import median

import typer
from measuring import table, taken

from karma.household.types import object_types
from karma.models.embed.minilm import MiniLm
from karma.plugins.homes.memory.episodes import EpisodeQuery
from karma.plugins.homes.memory.setting import KnownPlace, MemorySetting
from karma.plugins.homes.memory.true_memory import TrueMemory
from karma.plugins.homes.types import Deed, HomeMoment, HomeQuestion, SaidThing, Sighting
from karma.seeds import stream
from karma.types.planning import Meaning

DAY_S = 86_400.0
KINDS = ("Cabinet", "Drawer", "Shelf", "CounterTop", "SideTable", "Desk")
ROOMS = ("kitchen", "living", "bedroom", "bathroom")
TYPES = [name for name, kind in object_types().items() if kind.can("pickupable")][:50]
SIZES = ((10, 10), (100, 100), (1_000, 100), (10_000, 1_000), (100_000, 100), (100_000, 10_000))


def _place(at: int) -> KnownPlace:
    kind, room = KINDS[at % 6], ROOMS[at // 15]
    return KnownPlace(
        place_id=f"{kind}|{at}", place_type=kind, room=f"{room}_1", room_kind=room, openable=False
    )


PLACES = {place.place_id: place for place in map(_place, range(60))}


def drawn_moments(units: int, objects: int, days: float, seed: int) -> Iterator[HomeMoment]:
    """Yield moments of moved objects, spread over days."""
    rng, places = stream(seed, "bench", "lived", str(units), str(objects)), list(PLACES.values())
    for number in range(units):
        which = int(rng.integers(objects)) if number >= objects else number
        place = places[int(rng.integers(len(places)))]
        kind = TYPES[which % len(TYPES)]
        where = {
            "time_s": number * days * DAY_S / units, "object_id": f"{kind}|{which}",
            "object_type": kind, "place_id": place.place_id, "room": place.room,
        }  # fmt: skip
        states = ("dirty",) if rng.random() < 0.2 else ()
        seen = Sighting(**where, position_m=(0.0, 0.0, 0.0), states=states)
        deed = Deed(**where, who="Ann", action="PutObject") if rng.random() < 0.3 else None
        yield HomeMoment(time_s=seen.time_s, room=place.room, seen=(seen,), deed=deed)


def measured(units: int, objects: int, embedder: MiniLm) -> list[float]:
    """Fill a memory and measure it."""
    setting = MemorySetting(embedder=embedder, places=PLACES)
    memory = TrueMemory(setting)
    moments = drawn_moments(units, objects, 30.0, 0)
    inserting = taken(lambda: [memory.take_in(moment) for moment in moments], time.perf_counter)
    question_ms = _median_ms(lambda at: memory.recall(_question(at), 64))
    log, size = memory.log, f"{units} {objects}"
    log.recall(EpisodeQuery(text="a mug"), 1)  # the index is made once
    text_ms = _median_ms(lambda at: log.recall(_text_query(at, size), 20))
    embed_ms = _median_ms(lambda at: embedder.embed([f"thing {at} of {size}"]))
    return [units / inserting, question_ms, text_ms, embed_ms, log.size_bytes() / 1e6]


def _median_ms(do: Callable[[int], object]) -> float:
    return 1000 * median(taken(lambda at=at: do(at), time.perf_counter) for at in range(40))


def _question(at: int) -> HomeQuestion:
    """Return a question for now, or every second time for the past."""
    types = (Meaning(name=TYPES[at % len(TYPES)], similarity=1.0),)
    past = {"after_s": 5 * DAY_S, "before_s": 6 * DAY_S} if at % 2 else {}
    said = SaidThing(phrase="the thing", types=types, **past)
    return HomeQuestion(text="", speaker="Ann", time_s=31 * DAY_S, asked="place", thing=said)


def _text_query(at: int, size: str) -> EpisodeQuery:
    """Return a query with new text for each size: MiniLM caches its embeddings."""
    after = at % 25
    return EpisodeQuery(
        text=f"something soft to wash up with, number {at} of {size}",
        after_s=after * DAY_S, before_s=(after + 4) * DAY_S, state="dirty" if at % 2 else "",
    )  # fmt: skip


def main(most: int = 20_000, sizes: int = len(SIZES)) -> None:
    """Print a table of the first sizes, and the figures of a year with a budget of episodes."""
    embedder = MiniLm()
    table(
        "units | objects | inserted/s | question, ms | text, ms | MiniLM alone, ms | MB",
        ((f"{u:,}", f"{o:,}", *measured(u, o, embedder)) for u, o in SIZES[:sizes]),
    )
    setting = MemorySetting(embedder=embedder, places=PLACES)
    memory, half, total = TrueMemory(setting, most_episodes=most), 0.0, 365 * 150
    for number, moment in enumerate(drawn_moments(total, 150, 365.0, 1)):
        memory.take_in(moment)
        if number == total // 2:
            half = memory.size_bytes() / 1e6
    print(
        f"365 days, at most {most:,} closed episodes: {len(memory.log):,} at the end; "
        f"{half:.1f} MB after half the year, {memory.size_bytes() / 1e6:.1f} MB after all of it"
    )


if __name__ == "__main__":
    typer.run(main)
