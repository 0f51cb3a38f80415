"""What memory is worth in a home where people live: the same errands with it and without.

    python scripts/measure_people.py [--homes 16] [--planner karma-nano] [--people 2] [--hours 26]

On the first day an agent puts three things somewhere. So many hours later it puts the same things
elsewhere: once with the memory of the day before, once in the same room with none. Judged by the
room, not by what it says.
"""

import argparse
import shutil
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec

from karma import Agent
from karma.files import read_bytes, to_json, write_atomic
from karma.household.ids import type_of
from karma.household.saying import name_of, told_place
from karma.household.types import object_types
from karma.offline import go_offline
from karma.seeds import stream
from karma.talk.home import PastErrand
from karma.world.sim import EmbeddedWorld

SCENES = [
    f"{kind}_{n}" for n in (1, 2, 3, 4) for kind in ("kitchen", "living", "bedroom", "bathroom")
]
THINGS = 3


def main() -> None:
    """Print what came of all errands of the second day."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--homes", type=int, default=len(SCENES))
    parser.add_argument("--planner", default="karma-nano")
    parser.add_argument("--people", type=int, default=2)
    parser.add_argument("--hours", type=float, default=26.0)
    given = parser.parse_args()
    go_offline()
    sums: dict[str, Counter[str]] = {"memory": Counter(), "no memory": Counter()}
    for number in range(given.homes):
        scene, seed = SCENES[number % len(SCENES)], number // len(SCENES)
        with tempfile.TemporaryDirectory() as name:
            first, second = errands(scene, seed)
            home = Path(name) / "home"
            options = {"planner": given.planner, "seed": seed, "maps": Path(name) / "maps"}
            agent = Agent(scene, home=home, people=given.people, folder=Path(name) / "0", **options)
            was = [agent.do(text) and place_of(agent, kind) for text, kind, _ in first]
            agent.home.leave()
            Agent(
                home=home, later_s=given.hours * 3600, folder=Path(name) / "1", **options
            ).home.leave()
            for row, found in sums.items():
                place = Path(name) / row
                shutil.copytree(home, place)
                if row == "no memory":
                    forget(place / "log.jsonl")
                again = Agent(home=place, folder=Path(name) / f"run {row}", **options)
                now = [place_of(again, kind) for _, kind, _ in first]
                found["moved by people"] += sum(a != b for a, b in zip(was, now, strict=True))
                for text, kind, to in second:
                    reply = again.do(text)
                    at = type_of(place_of(again, kind) or "")
                    found.update(judged(reply, at == to))
                    if at != to:
                        print(f"{scene}, {row}: {text}: {reply.status}, it is in {at or 'nothing'}")
                again.home.leave()
        print(f"{number + 1} of {given.homes}: {scene}, seed {seed}", flush=True)
    show(sums)


def errands(scene: str, seed: int) -> Iterator[list[tuple[str, str, str]]]:
    """Yield the errands of two days: words, type of the thing, type of the place."""
    world = EmbeddedWorld()
    objects = world.reset(scene).metadata["objects"]
    count = Counter(one["objectType"] for one in objects)
    kinds = sorted(
        one["objectType"] for one in objects if one["pickupable"] and count[one["objectType"]] == 1
    )
    places = sorted(
        {one["objectType"] for one in objects if one["receptacle"] and not one["pickupable"]}
        - {"Floor"}
    )
    rng, rules = stream(seed, "people", scene), world.state.room.rules
    things = [kinds[n] for n in rng.permutation(len(kinds))[:THINGS]]
    fits = {
        kind: [p for p in places if object_types()[kind].fits(object_types()[p], rules)]
        for kind in things
    }
    for _ in range(2):
        day = []
        for kind in things:
            to = fits[kind].pop(int(rng.integers(len(fits[kind]))))
            day.append((f"put the {name_of(kind)} {told_place(to)}", kind, to))
        yield day


def place_of(agent: Agent, kind: str) -> str | None:
    """Return the id of what the one thing of a type lies in, by the room itself."""
    objects = agent._world.last_event.metadata["objects"]
    parents = next(one for one in objects if one["objectType"] == kind)["parentReceptacles"]
    return parents[0] if parents else None


def forget(log: Path) -> None:
    """Take what was learnt out of a home's log; what was done in it stays."""
    lines = [msgspec.json.decode(one, type=PastErrand) for one in read_bytes(log).splitlines()]
    write_atomic(log, b"".join(to_json(msgspec.structs.replace(one, changes=())) for one in lines))


def judged(reply: object, right: bool) -> dict[str, int]:
    """Return the counts of one errand."""
    results = [one for part in reply.parts for one in part.results]  # type: ignore[attr-defined]
    return {
        "errands": 1,
        "right": right,
        "said done and was not": reply.status == "done" and not right,  # type: ignore[attr-defined]
        "places searched": sum(one.explorations for one in results),
        "steps": sum(one.actions for one in results),
    }


def show(sums: dict[str, Counter[str]]) -> None:
    """Print the table, as Markdown."""
    columns: Sequence[str] = (
        "errands", "moved by people", "right", "said done and was not", "places searched", "steps",
    )  # fmt: skip
    print(f"\n| row | {' | '.join(columns)} |\n|{'---|' * (len(columns) + 1)}")
    for row, found in sums.items():
        print(f"| {row} | {' | '.join(str(found[name]) for name in columns)} |")


if __name__ == "__main__":
    main()
