"""Everything that can be carried is looked for, with a map of the room and without, and found.

Each search begins anew in the day's start; "shown" is what some pose shows with all doors open.
Few rooms on one day, or all on as many days as $KARMA_SAMPLE says, which takes half an hour.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from statistics import mean

from support.floor_plans import floor_plans

from karma.agent.body.skills import Skills
from karma.agent.tour import explore_room, position_of
from karma.bench.engine.episode import drawn
from karma.files import to_json
from karma.offline.children import forking, starting
from karma.types.planning import SkillCall
from karma.types.space import SceneRef
from karma.types.tasks import Task
from karma.world.core.scene import SCENES
from karma.world.sim import EmbeddedWorld

SAMPLE = int(os.environ.get("KARMA_SAMPLE", "0"))
SEEDS = range(SAMPLE) if SAMPLE else (1,)


@dataclass(frozen=True)
class Knowledge:
    """What skills know: a room's map, or nothing."""

    world: object
    graph: object

    def where(self, name):
        return self.graph.known(name, near=position_of(self.world)) if self.graph else None

    def areas(self):
        return self.graph.areas() if self.graph else ()


def searches(job):
    """Look for everything in one room on one day; yields room, day, map, result and shown."""
    room, seed = job
    world = EmbeddedWorld(room)
    graph, _ = explore_room(world, SceneRef.of(room), None)
    task = Task(id=f"search-{Path(room).stem}", kind="simple", scene=SceneRef.of(room), subtasks=())
    wanted = {one["objectType"] for one in begun(world, task, seed) if one["pickupable"]}
    found = []
    for kind in sorted(wanted):
        for known in (graph, None):
            begun(world, task, seed)
            call = SkillCall(skill="Explore", objects=(kind,))
            result = Skills(world, Knowledge(world, known)).run(call)
            shown = result.ok or is_shown(world, kind)
            found.append((Path(room).stem, seed, bool(known), result, shown))
    return found


def begun(world, task, seed):
    """Return the things of a room as a day begins."""
    room = world.reset(task.scene.source)
    return (drawn(world, task, seed, 0) if seed else room).metadata["objects"]


def is_shown(world, wanted):
    """Return whether some pose shows a thing of a type; opens all that can be opened."""
    things = world.last_event.metadata["objects"]
    for thing in things:
        if thing["openable"] and not thing["isOpen"]:
            world.step("OpenObject", objectId=thing["objectId"], forceAction=True)
    return any(
        world.step("GetInteractablePoses", objectId=one["objectId"], maxPoses=1).metadata[
            "actionReturn"
        ]
        for one in things
        if one["objectType"] == wanted
    )


def found_in(rooms):
    """Search all rooms, print what came of it; returns how many were shown, and found."""
    with starting(), forking().Pool(2) as pool:
        jobs = [(room, seed) for room in rooms for seed in SEEDS]
        found = [one for part in pool.imap(searches, jobs) for one in part]
    for known in (True, False):
        some = [(result, shown) for *_, with_map, result, shown in found if with_map == known]
        print(
            f"{'with' if known else 'without'} a map: {len(some)} searches,"
            f" {sum(shown for _, shown in some)} shown, {sum(r.ok for r, _ in some)} found,"
            f" {mean(r.explorations for r, _ in some):.2f} places,"
            f" {mean(r.actions for r, _ in some):.1f} actions"
        )
    print(*(one for one in found if not one[3].ok), sep="\n")
    return sum(one[-1] for one in found), sum(one[3].ok for one in found)


def test_nearly_all_that_can_be_carried_is_found_in_our_rooms():
    rooms = sorted(path.stem for path in SCENES.glob("*.json"))
    shown, found = found_in(rooms if SAMPLE else rooms[::8])
    assert found >= 0.995 * shown - 1


def test_nearly_all_that_a_pose_shows_is_found_in_a_sample_of_ai2thor_s_rooms(shared, tmp_path):
    rooms = []
    for scene in floor_plans(shared, layouts=True):
        rooms.append(str(tmp_path / f"{scene.name}.json"))
        Path(rooms[-1]).write_bytes(to_json(scene))
    shown, found = found_in(rooms if SAMPLE else rooms[::30])
    assert shown > 100
    assert found >= 0.999 * shown - 1  # one in a sample of hundreds is chance
