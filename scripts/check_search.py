"""Look for everything that can be carried, in every room, on several days.

    python scripts/check_search.py                     # 16 rooms, seeds 0 to 4, two workers
    python scripts/check_search.py --seeds 5 6 --rooms kitchen_1

Each search begins anew in the seed's start, once with a map of the room and once without. What
was not found is listed.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing import Pool
from pathlib import Path
from statistics import mean

from rich.console import Console
from rich.progress import track
from rich.table import Table

import karma.world
from karma.agent.skills import Skills
from karma.bench.days import drawn
from karma.contracts import Area, Known, SceneRef, SkillCall, SkillResult, Task
from karma.memory.scene_graph import SceneGraph
from karma.methods.tour import explore_room, position_of
from karma.world.sim import EmbeddedWorld

ROOMS = tuple(sorted(path.stem for path in Path(karma.world.__file__).parent.glob("scenes/*.json")))


@dataclass(frozen=True, slots=True, kw_only=True)
class Search:
    """One search and what it came to."""

    room: str
    seed: int
    wanted: str  # an object type
    mapped: bool
    result: SkillResult


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
    chosen = parser.parse_args()
    jobs = [(room, seed) for room in chosen.rooms for seed in chosen.seeds]
    console = Console()
    found: list[Search] = []
    with Pool(chosen.workers) as pool:
        rooms = pool.imap(searches, jobs)
        for part in track(rooms, "rooms and days", total=len(jobs), console=console):
            found += part
    console.print(_table(found))
    for one in (one for one in found if not one.result.ok):
        how = "with" if one.mapped else "without"
        console.print(f"{one.room}, seed {one.seed}, {how} a map: {one.result.reason}")


def searches(job: tuple[str, int]) -> list[Search]:
    """Look for everything in one room on one day."""
    room, seed = job
    world = EmbeddedWorld(room)
    graph, _ = explore_room(world, SceneRef.of(room), None)
    task = Task(id=f"search-{room}", kind="simple", scene=SceneRef.of(room), subtasks=())
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
            done.append(Search(room=room, seed=seed, wanted=wanted, mapped=mapped, result=result))
    return done


def _table(found: Sequence[Search]) -> Table:
    table = Table("", "searches", "found", "places", "actions")
    for mapped, words in ((True, "with a map"), (False, "without")):
        some = [one.result for one in found if one.mapped == mapped]
        table.add_row(
            words,
            str(len(some)),
            str(sum(result.ok for result in some)),
            f"{mean(result.explorations for result in some):.2f}",
            f"{mean(result.actions for result in some):.1f}",
        )
    return table


if __name__ == "__main__":
    main()
