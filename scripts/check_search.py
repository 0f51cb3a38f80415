"""Look for everything that can be carried, in every room, on several days.

    python scripts/check_search.py                     # 16 rooms, seeds 0 to 4, two workers
    python scripts/check_search.py --seeds 5 6 --rooms kitchen_1
    python scripts/check_search.py --plans --seeds 0   # AI2-THOR's, of the reference data

Each search begins anew in the seed's start, once with a map of the room and once without. What
was not found is listed; "shown" counts the searches for what some pose shows, with all doors open.
"""

import argparse
import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from statistics import mean

from rich.console import Console
from rich.progress import track
from rich.table import Table

import karma.world
from karma.agent.skills import Skills
from karma.bench.days import drawn
from karma.children import forking, starting
from karma.contracts import Area, Known, SceneRef, SkillCall, SkillResult, Task
from karma.files import to_json
from karma.memory.scene_graph import SceneGraph
from karma.methods.tour import explore_room, position_of
from karma.world.importing.scenes import import_dump
from karma.world.sim import EmbeddedWorld

SHARED = Path(os.environ.get("KARMA_SHARED", "../shared")) / "data"
ROOMS = tuple(sorted(path.stem for path in Path(karma.world.__file__).parent.glob("scenes/*.json")))


@dataclass(frozen=True, slots=True, kw_only=True)
class Search:
    """One search and what it came to."""

    room: str
    seed: int
    wanted: str  # an object type
    mapped: bool
    result: SkillResult
    shown: bool  # from some pose, if every door is open


class _Knowledge:
    """What skills know: a room's map, or nothing."""

    def __init__(self, world: EmbeddedWorld, graph: SceneGraph | None) -> None:
        self._world, self._graph = world, graph

    def where(self, name: str) -> Known | None:
        """Return the map's word."""
        return self._graph.known(name, near=position_of(self._world)) if self._graph else None

    def areas(self) -> Sequence[Area]:
        """Return the map's nodes."""
        return self._graph.areas() if self._graph else ()


def main() -> None:
    """Run the check."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rooms", nargs="*", default=ROOMS)
    parser.add_argument("--seeds", type=int, nargs="*", default=[0, 1, 2, 3, 4])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--plans", action="store_true", help="AI2-THOR's rooms, not ours")
    parser.add_argument("--every", type=int, default=1, help="of these plans each so many")
    chosen = parser.parse_args()
    console = Console()
    found: list[Search] = []
    rooms_of = _rooms(chosen.rooms, plans=chosen.plans)
    with rooms_of as names, starting(), forking().Pool(chosen.workers) as pool:
        jobs = [(room, seed) for room in names[:: chosen.every] for seed in chosen.seeds]
        rooms = pool.imap(searches, jobs)
        for part in track(rooms, "rooms and days", total=len(jobs), console=console):
            found += part
    console.print(_table(found))
    for one in (one for one in found if not one.result.ok):
        how = "with" if one.mapped else "without"
        seen = "" if one.shown else " (no pose shows it)"
        room = Path(one.room).stem
        console.print(f"{room}, seed {one.seed}, {how} a map: {one.result.reason}{seen}")


@contextmanager
def _rooms(names: Sequence[str], *, plans: bool) -> Iterator[Sequence[str]]:
    """Give names of rooms, or the files of AI2-THOR's, for as long as they are needed."""
    if not plans:
        yield names
        return
    dumps, layouts = SHARED / "thor5/scenes.jsonl.gz", SHARED / "alfred/layouts.json.gz"
    with tempfile.TemporaryDirectory() as folder:
        files = []
        for scene in import_dump(dumps, layouts=layouts):
            files.append(Path(folder) / f"{scene.name}.json")
            files[-1].write_bytes(to_json(scene))
        yield list(map(str, files))


def searches(job: tuple[str, int]) -> list[Search]:
    """Look for everything in one room on one day."""
    room, seed = job
    world = EmbeddedWorld(room)
    graph, _ = explore_room(world, SceneRef.of(room), None)
    task = Task(id=f"search-{Path(room).stem}", kind="simple", scene=SceneRef.of(room), subtasks=())
    things = drawn(world, task, seed, 0) if seed else world.reset(room)
    objects = things.metadata["objects"]
    done = []
    for wanted in sorted({thing["objectType"] for thing in objects if thing["pickupable"]}):
        for mapped in (True, False):
            if seed:
                drawn(world, task, seed, 0)
            else:
                world.reset(room)
            skills = Skills(world, _Knowledge(world, graph if mapped else None))
            result = skills.run(SkillCall(skill="Explore", objects=(wanted,)))
            shown = result.ok or _is_shown(world, wanted)
            done.append(
                Search(
                    room=room, seed=seed, wanted=wanted, mapped=mapped, result=result, shown=shown
                )
            )
    return done


def _is_shown(world: EmbeddedWorld, wanted: str) -> bool:
    """Return whether some pose shows a thing of a type; opens all that can be opened."""
    things = world.last_event.metadata["objects"]
    for thing in things:
        if thing["openable"] and not thing["isOpen"]:
            world.step("OpenObject", objectId=thing["objectId"], forceAction=True)
    ids = [thing["objectId"] for thing in things if thing["objectType"] == wanted]
    return any(
        world.step("GetInteractablePoses", objectId=one, maxPoses=1).metadata["actionReturn"]
        for one in ids
    )


def _table(found: Sequence[Search]) -> Table:
    table = Table("", "searches", "shown", "found", "places", "actions")
    for mapped, words in ((True, "with a map"), (False, "without")):
        some = [one.result for one in found if one.mapped == mapped]
        table.add_row(
            words,
            str(len(some)),
            str(sum(one.shown for one in found if one.mapped == mapped)),
            str(sum(result.ok for result in some)),
            f"{mean(result.explorations for result in some):.2f}",
            f"{mean(result.actions for result in some):.1f}",
        )
    return table


if __name__ == "__main__":
    main()
