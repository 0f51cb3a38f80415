"""Tasks that need looking: two things of a kind, one of which somebody left dirty, open or on.

The agent did not bring the state about and nothing tells it in words, so of the two it has to see
which is meant. It stands before both when it begins. Things that can be carried are asked for by
their state after something else has been done; of furniture the wrong one is simply left alone.

Tasks come as twins: the same room, start and words, once with the one and once with the other thing
in the state. One who does not look does the same in both, so a guess is right in one of the two at
most, whatever its habit; only who is refused by the world and tries the other can do better.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from karma.agent.perceive import truth_of
from karma.contracts import Goal, SceneRef, SubTask, Task
from karma.household.places import ROOMS, STAND_CLOSED, SURFACES
from karma.household.types import object_types
from karma.household.uses import (
    BIN,
    BURNER,
    COFFEE_CUP,
    FAUCET,
    FRIDGE,
    KNOB,
    LAMPS,
    MICROWAVE,
    SINK,
)
from karma.seeds import stream
from karma.tasks.drawing.lexicon import lexicon
from karma.tasks.drawing.memories import Rng, pick
from karma.tasks.files import with_whole
from karma.world.core.scene import AgentPose, Scene, SceneObject
from karma.world.generation.generate import build_scene
from karma.world.sim import EmbeddedWorld

ROOM_SEED = 211  # rooms of their own: neither those that ship nor those of any training
LEAST_PIXELS = 150  # that each of the two shows at the start
_NEAR_M = 1.4
_HORIZONS = (30.0, 0.0, 60.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Left:
    """A state that things are left in."""

    word: str  # of it, in goals
    said: tuple[str, ...]  # adjectives
    field: str  # of `SceneObject`
    value: Any
    kinds: tuple[str, ...]  # types, of which one is drawn
    room: str


_KITCHEN, _LIVING, _BEDROOM, _BATHROOM = ROOMS
_CUPS = ("Bowl", COFFEE_CUP, "Cup", "Pot")
_DESK_LAMP, _FLOOR_LAMP = LAMPS
LEFT = {
    "dirty": _Left(word="dirty", said=("dirty", "unwashed"), field="is_dirty", value=True,
                   kinds=("Plate", *_CUPS, "Pan"), room=_KITCHEN),
    "filled": _Left(word="filled", said=("full", "filled"), field="is_filled", value=True,
                    kinds=_CUPS, room=_KITCHEN),
    "cooked": _Left(word="cooked", said=("cooked",), field="is_cooked", value=True,
                    kinds=("Potato",), room=_KITCHEN),
    "used up": _Left(word="used up", said=("empty",), field="is_used_up", value=True,
                     kinds=("SoapBottle", "ToiletPaper", "TissueBox"), room=_BATHROOM),
    "opened": _Left(word="opened", said=("open", "opened"), field="openness", value=1.0,
                    kinds=("Book", "Laptop"), room=_BEDROOM),
    "on": _Left(word="on", said=("lit",), field="is_toggled", value=True,
                kinds=("Candle",), room=_BATHROOM),
    "drawer": _Left(word="opened", said=(), field="openness", value=1.0,
                    kinds=("Drawer",), room=_BEDROOM),
    "cabinet": _Left(word="opened", said=(), field="openness", value=1.0,
                     kinds=("Cabinet",), room=_KITCHEN),
    "burner": _Left(word="on", said=(), field="is_toggled", value=True,
                    kinds=(KNOB,), room=_KITCHEN),
}  # fmt: skip
_FIRST = (
    ("open the fridge", "OPEN", FRIDGE), ("open the microwave", "OPEN", MICROWAVE),
    ("turn on the faucet", "TOGGLEON", FAUCET), ("turn on the tv", "TOGGLEON", "Television"),
    ("turn on the desk lamp", "TOGGLEON", _DESK_LAMP),
    ("turn on the floor lamp", "TOGGLEON", _FLOOR_LAMP), ("open the safe", "OPEN", "Safe"),
    ("open the toilet", "OPEN", "Toilet"),
)  # what is done before, that has nothing to do with the two  # fmt: skip
_ASKED = ("put {x} {in} {r}", "move {x} to {r}", "place {x} {in} {r}", "bring me {x}",
          "wash {x}", "throw {x} away")  # fmt: skip
_CLOSING = ("close the {s}", "shut the {s}", "please close the {s}")
_BURNERS = ("turn off the stove burner", "switch off the stove burner", "turn the burner off")


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawn:
    """One task with its room."""

    scene: Scene
    task: Task


def draw_twins(kind: str, number: int, seed: int, path: str) -> tuple[Drawn, ...]:
    """Draw one room and its two tasks; () when the room has no place for them.

    Args:
        kind: a key of `LEFT`.
        number: of the draw.
        seed: of all draws.
        path: where the room's file will lie, "{}" for its name.
    """
    rng, left = stream(seed, "looking", kind, str(number)), LEFT[kind]
    scene = build_scene(left.room, 9000 + number, seed + ROOM_SEED)
    scene = msgspec.structs.replace(scene, name=f"{kind.replace(' ', '_')}_{number}")
    type_name = pick(rng, left.kinds)
    fixed = not object_types()[type_name].can("pickupable")
    world = EmbeddedWorld(scene)
    pair = _all(world, type_name) if fixed else _pair_on_a_surface(world, type_name, rng)
    start = _start(world, pair, rng) if len(pair) > 1 else None
    if start is None:
        return ()
    agent, shown = start
    chosen = [shown[int(index)] for index in rng.permutation(len(shown))[:2]]
    twins = []
    for letter, meant in zip("ab", chosen, strict=True):
        words = stream(seed, "looking words", kind, str(number))  # the same for both
        subtasks = (_fixed if fixed else _carried)(words, left, meant, world)
        if subtasks is None:
            return ()
        things = _with_states(list(world.state.objects.values()), left, meant, pair)
        twin = msgspec.structs.replace(
            scene, name=f"{scene.name}{letter}", objects=things, agent=agent
        )
        reference = SceneRef.of(path.format(twin.name))
        task = Task(id=twin.name, kind="simple", scene=reference, subtasks=tuple(subtasks))
        twins.append(Drawn(scene=twin, task=with_whole(task)))
    return tuple(twins)


def _all(world: EmbeddedWorld, type_name: str) -> list[str]:
    return sorted(one.id for one in world.state.objects.values() if one.type == type_name)


def _pair_on_a_surface(world: EmbeddedWorld, type_name: str, rng: Rng) -> list[str]:
    """Bring two of a type onto one surface; returns their ids, or fewer where it has no room."""
    kinds, things = object_types(), world.state.objects.values()
    there = _all(world, type_name)
    places = sorted(
        one.id for one in things if one.type in SURFACES and kinds[type_name].fits(kinds[one.type])
    )
    if not places or not there or len(there) > 2:
        return []
    place = pick(rng, places)
    world.step(
        "InitialRandomSpawn",
        randomSeed=int(rng.integers(1 << 30)),
        objectIds=there,
        numDuplicatesOfType=[{"objectType": type_name, "count": 2}],
        receptacleObjectIds=[place],
        forceVisible=True,
    )
    objects = world.state.objects
    return [name for name in _all(world, type_name) if place in objects[name].parents]


def _start(
    world: EmbeddedWorld, ids: Sequence[str], rng: Rng
) -> tuple[AgentPose, list[str]] | None:
    """Return a place from which two of the things or more are well in view, and which they are."""
    cells = [world.state.cells[key] for key in sorted(world.state.cells)]
    y = world.state.pose.position_m[1]
    for index in rng.permutation(len(cells)):
        x, z = cells[int(index)]
        near = [world.state.objects[name].center for name in ids]
        if sum(np.hypot(c[0] - x, c[2] - z) < _NEAR_M for c in near) < 2:
            continue
        for yaw, horizon in (
            (yaw, tilt) for tilt in _HORIZONS for yaw in (0.0, 90.0, 180.0, 270.0)
        ):
            world.step(
                "TeleportFull", position={"x": x, "y": y, "z": z}, horizon=horizon,
                rotation={"x": 0.0, "y": yaw, "z": 0.0}, standing=True, forceAction=True,
            )  # fmt: skip
            shown = _well_in_view(world, ids)
            if len(shown) > 1:
                return AgentPose(position=(x, y, z), yaw=yaw, horizon=horizon), shown
    return None


def _well_in_view(world: EmbeddedWorld, ids: Sequence[str]) -> list[str]:
    truth = truth_of(world.last_event)
    visible = [one.object_id for one in truth.objects if one.visible and one.object_id in ids]
    if len(visible) < 2:
        return []
    rows = world.last_event.picture.rows
    counts = np.bincount(rows[rows >= 0], minlength=len(world.state.objects))
    pixels = dict(zip(world.state.objects, counts.tolist(), strict=True))
    return [name for name in visible if pixels[name] >= LEAST_PIXELS]


def _with_states(
    things: Sequence[SceneObject], left: _Left, meant: str, pair: Sequence[str]
) -> tuple[SceneObject, ...]:
    """Return the room with one thing in the state and the others of its kind out of it."""
    blank = {"openness": 0.0, "is_filled": False}.get(left.field, False)
    found = []
    burners = next((one.controls for one in things if one.id == meant), ())
    for one in things:
        value = left.value if one.id == meant else blank
        if one.id in pair:
            one = msgspec.structs.replace(one, **{left.field: value})
            if left.field == "is_filled":
                one = msgspec.structs.replace(one, liquid="water" if value else None)
        elif one.type == BURNER:
            one = msgspec.structs.replace(one, is_toggled=one.id in burners)
        found.append(one)
    return tuple(found)


def _fixed(rng: Rng, left: _Left, meant: str, world: EmbeddedWorld) -> Sequence[SubTask] | None:
    kind = world.state.objects[meant].type
    if kind == KNOB:
        burner = next(iter(world.state.objects[meant].controls), "")
        goal = Goal(predicate="TOGGLEOFF", arguments=(burner,))
        return [_subtask(pick(rng, _BURNERS), goal)] if burner else None
    said = pick(rng, _CLOSING).format(s=lexicon()[kind].names[0])
    return [_subtask(said, Goal(predicate="CLOSED", arguments=(meant,)))]


def _carried(rng: Rng, left: _Left, meant: str, world: EmbeddedWorld) -> Sequence[SubTask] | None:
    types = {one.type for one in world.state.objects.values()}
    kind = object_types()[world.state.objects[meant].type]
    first = [
        (text, Goal(predicate=p, arguments=(name,))) for text, p, name in _FIRST if name in types
    ]
    here = {world.state.objects[name].type for name in world.state.objects[meant].parents}
    places = [
        name
        for name in (*SURFACES, SINK, FRIDGE)
        if name in types - here and kind.fits(object_types()[name])
    ]
    asked = [text for text in _ASKED if "{r}" not in text or places]
    asked = [text for text in asked if "wash" not in text or left.word == "dirty"]
    asked = [
        text for text in asked if "throw" not in text or (left.word == "used up" and BIN in types)
    ]
    if not first or not asked:
        return None
    text, place = pick(rng, asked), pick(rng, places) if places else ""
    x = f"the {pick(rng, left.said)} {lexicon()[kind.name].names[0]}"
    words = {"x": x, "in": "in" if place in (SINK, *STAND_CLOSED) else "on", "r": ""}
    if place:
        words["r"] = f"the {lexicon()[place].names[0]}"
    return [_subtask(*pick(rng, first)), _subtask(text.format(**words), _goal(text, meant, place))]


def _goal(text: str, meant: str, place: str) -> Goal:
    if "{r}" in text:
        return Goal(predicate="ON", arguments=(meant, place))
    if "wash" in text:
        return Goal(predicate="STATE", arguments=(meant, "clean"))
    if "throw" in text:
        return Goal(predicate="INSIDE", arguments=(meant, BIN))
    return Goal(predicate="HOLDON", arguments=("robot", meant))


def _subtask(text: str, goal: Goal) -> SubTask:
    return SubTask(instruction=f"{text[0].upper()}{text[1:]}.", goals=(goal,))
