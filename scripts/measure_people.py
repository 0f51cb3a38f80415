"""What memory is worth in a home where people live: the same errands with it and without.

    python scripts/measure_people.py [--homes 16] [--planner karma-nano] [--people 2] [--hours 26]

On the first day an agent puts three things somewhere. So many hours later it puts the same things
elsewhere: once with the memory of the day before, once in the same room with none. Judged by the
room, not by what it says.
"""

import shutil
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import msgspec
import typer
from measuring import table
from support.errand_sequences import SCENES, Room, place_of

from karma import Agent
from karma.assistant.session_log import PastRequest
from karma.files import read_bytes, to_json, write_atomic
from karma.household.ids import type_of
from karma.household.saying import name_of, told_place
from karma.household.types import object_types
from karma.offline.guard import go_offline
from karma.plugins.rules.talk.replies import AgentReply
from karma.seeds import stream

THINGS = 3
COLUMNS = (
    "errands", "moved by people", "right", "said done and was not", "places searched", "steps",
)  # fmt: skip


def main(
    homes: int = len(SCENES), planner: str = "karma-nano", people: int = 2, hours: float = 26.0
) -> None:
    """Print what came of all errands of the second day."""
    go_offline()
    sums: dict[str, Counter[str]] = {"memory": Counter(), "no memory": Counter()}
    for number in range(homes):
        scene, seed = SCENES[number % len(SCENES)], number // len(SCENES)
        with tempfile.TemporaryDirectory() as name:
            (first, second), folder = errands(scene, seed), Path(name)
            options = {"planner": planner, "seed": seed, "maps": folder / "maps"}
            home = folder / "home"
            agent = Agent(scene, home=home, people=people, folder=folder / "0", **options)
            was = [agent.do(text) and place_of(agent, kind) for text, kind, _ in first]
            agent.home.leave()
            later = Agent(home=home, later_s=hours * 3600, folder=folder / "1", **options)
            later.home.leave()
            for row, found in sums.items():
                shutil.copytree(home, folder / row)
                if row == "no memory":
                    forget(folder / row / "log.jsonl")
                again = Agent(home=folder / row, folder=folder / f"run {row}", **options)
                now = [place_of(again, kind) for _, kind, _ in first]
                found["moved by people"] += sum(a != b for a, b in zip(was, now, strict=True))
                for text, kind, to in second:
                    reply = again.do(text)
                    at = type_of(place_of(again, kind) or "")
                    found.update(judged(reply, at == to))
                    if at != to:
                        print(f"{scene}, {row}: {text}: {reply.status}, it is in {at or 'nothing'}")
                again.home.leave()
        print(f"{number + 1} of {homes}: {scene}, seed {seed}", flush=True)
    print()
    table(f"row | {' | '.join(COLUMNS)}", ((r, *(n[c] for c in COLUMNS)) for r, n in sums.items()))


def errands(scene: str, seed: int) -> Iterator[list[tuple[str, str, str]]]:
    """Yield the errands of two days: words, type of the thing, type of the place."""
    room, rng = Room(scene, seed), stream(seed, "people", scene)
    kinds, places = room.things, sorted(room.fixed - {"Floor"})
    things = [kinds[n] for n in rng.permutation(len(kinds))[:THINGS]]
    fits = {
        kind: [p for p in places if object_types()[kind].fits(object_types()[p], room.rules)]
        for kind in things
    }
    for _ in range(2):
        day = []
        for kind in things:
            to = fits[kind].pop(int(rng.integers(len(fits[kind]))))
            day.append((f"put the {name_of(kind)} {told_place(to)}", kind, to))
        yield day


def forget(log: Path) -> None:
    """Take what was learnt out of a home's log; what was done in it stays."""
    lines = [msgspec.json.decode(one, type=PastRequest) for one in read_bytes(log).splitlines()]
    write_atomic(log, b"".join(to_json(msgspec.structs.replace(one, changes=())) for one in lines))


def judged(reply: AgentReply, right: bool) -> dict[str, int]:
    """Return the counts of one errand."""
    results = [one for part in reply.parts for one in part.results]
    return {
        "errands": 1, "right": right, "said done and was not": reply.status == "done" and not right,
        "places searched": sum(one.explorations for one in results),
        "steps": sum(one.actions for one in results),
    }  # fmt: skip


if __name__ == "__main__":
    typer.run(main)
