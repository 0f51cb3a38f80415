"""The first visit to a home: walk about, look around everywhere, and build the map."""

from collections.abc import Sequence
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import msgspec

from karma.agent.body.skills import Skills
from karma.agent.knowledge import RoomKnowledge
from karma.agent.seeing.eyes import Eyes
from karma.agent.seeing.perceive import cells_of, digest_of, fixed_of, pose_of
from karma.files import read_json, to_json, write_atomic
from karma.memory.scene_graph import SceneGraph
from karma.types.memory import Area, Tour
from karma.types.observation import SeenObject
from karma.types.planning import SkillCall
from karma.types.roles import World
from karma.types.space import SceneRef, Vec3

_NOTABLE = frozenset({"on", "opened"})
LOOKOUT_M = 0.75  # every cell is this near to a place looked around from; the eye reaches 1.5 m


def explore_room(
    world: World, scene: SceneRef, saved: Path | None, eyes: Eyes | None = None
) -> tuple[SceneGraph, bool]:
    """Return long-term memory of a scene and whether it was made just now, not `saved` before.

    A saved map is of this room only if its fixed things are where they were when it was made:
    another file of the same name, or the same file edited, has another. The world is back at the
    scene's start afterwards, whether the map was loaded or explored.
    """
    cells, room = floor_of(world), contents_of(world)
    graph = SceneGraph.over(cells, height_m=position_of(world)[1], room=room)
    if saved is not None and saved.exists():
        known = SceneGraph.load(saved)
        places, ours = ([area.position_m for area in one.areas()] for one in (known, graph))
        if known.room == room and places == ours:
            return known, False
    knowledge = RoomKnowledge(world, SceneGraph.over(cells, spacing_m=LOOKOUT_M))
    lookouts, skills = knowledge.areas(), Skills(world, knowledge, eyes=eyes)
    skills.look_around()
    for area in tour(lookouts, position_of(world)):
        skills.run(SkillCall.of("GoToObject", area.name))
        skills.look_around()
        graph.observe(skills.experience.seen.values())
    graph.tour = Tour(scene=scene.name, places=len(lookouts), actions=skills.actions)
    world.reset(scene.source)
    return graph, True


class _Sights(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    start: str  # digest of the room when they were seen
    seen: tuple[SeenObject, ...]


def seen_on_tour(
    world: World, scene: SceneRef, graph: SceneGraph, saved: Path | None, eyes: Eyes | None = None
) -> tuple[SeenObject, ...]:
    """Return what is in view from the areas of a map, nothing being opened.

    Of furniture what is open or on. The sights are kept in a file beside the map, `saved`, as long
    as the room starts as it did. The world is back at the scene's start afterwards. FileError where
    the file is damaged.
    """
    start = digest_of(world.last_event)
    path = saved.with_suffix(".seen.json") if saved is not None else None
    if path is not None and path.exists():
        kept = read_json(path, _Sights, fix="delete it; the room is looked at again")
        if kept.start == start:
            return kept.seen
    skills = Skills(world, RoomKnowledge(world, graph), eyes=eyes)
    for area in tour(graph.areas(), position_of(world)):
        skills.run(SkillCall.of("GoToObject", area.name))
        skills.look_around()
    seen = tuple(
        replace(sight, region=None, silhouette=())
        for sight in skills.experience.seen.values()
        if sight.pickupable or not _NOTABLE.isdisjoint(sight.states)
    )
    world.reset(scene.source)
    if path is not None:
        write_atomic(path, to_json(_Sights(start=start, seen=seen)))
    return seen


def contents_of(world: World) -> str:
    """Return the SHA-256 of what is fixed in a room that was just reset, and where, to the cm.

    It tells one room from another and nothing else: no plan is made from it.
    """
    fixed = (f"{name} {_centimetres(place)}" for name, place in fixed_of(world.last_event))
    return sha256("\n".join(sorted(fixed)).encode()).hexdigest()


def _centimetres(position_m: Vec3) -> str:
    """Return a position as text such as [1.00, 0.00, 2.35]."""
    return "[" + ", ".join(f"{round(v, 2) + 0.0:.2f}" for v in position_m) + "]"


def floor_of(world: World) -> list[tuple[float, float]]:
    """Return the (x, z) of every cell that can be stood on: the robot's map of the floor."""
    return [(x, z) for x, _, z in cells_of(world.step("GetReachablePositions"))]


def tour(areas: Sequence[Area], start: Vec3) -> list[Area]:
    """Return all areas, always the nearest next."""
    rest, here, order = list(areas), start, []
    while rest:
        rest.sort(key=lambda area: (_gap(area.position_m, here), area.name))
        order.append(rest.pop(0))
        here = order[-1].position_m
    return order


def _gap(one: Vec3, other: Vec3) -> float:
    return (one[0] - other[0]) ** 2 + (one[2] - other[2]) ** 2


def position_of(world: World) -> Vec3:
    """Return where the agent stands."""
    return pose_of(world.last_event).position_m
