"""ALFRED's trials as tasks of ours, whose goals agree with its own conditions.

The words follow `karma.world.alfred.goal`, which decides on metadata. A target there means any
part of an id: Pen becomes `Pen/Pencil`. For each kind of task:

    pick_and_place_simple             ON(thing, place)
    pick_two_obj_and_place            2*ON(thing, place)
    look_at_obj_in_light              HOLDON(robot, thing), STATE(lamp, shining)
    pick_{clean,heat,cool}_then_place STATE(thing, {cleaned, heated, cooled}), ON(thing, place)
    pick_and_place_with_movable       ON(thing, dish), ON(dish, place)

Of sliced targets the thing is the type of the slices, so that a slice itself has to be treated, and
STATE(whole, sliced) comes first. `GoalTracker.progress` then counts what ALFRED counts. One thing
differs: "heated" is also what a burner made hot, where ALFRED knows only the microwave.
"""

from karma.contracts import Goal, SceneRef, SubTask, Task
from karma.household.pieces import piece_type
from karma.household.types import Capability, object_types
from karma.household.uses import covers
from karma.world.alfred.ids import names_then, type_now
from karma.world.alfred.trial import Trial

_DEEDS = {
    "pick_clean_then_place_in_recep": "cleaned",
    "pick_heat_then_place_in_recep": "heated",
    "pick_cool_then_place_in_recep": "cooled",
}


def task_of(trial: Trial, instruction: str, *, scene: SceneRef | None = None, id: str = "") -> Task:
    """Return a trial's task, asked for in some words.

    Where no scene or id is given, they are the trial's FloorPlan by name and the trial's id.
    """
    subtask = SubTask(instruction=instruction, whole=instruction, goals=goals_of(trial))
    return Task(
        id=id or trial.id,
        kind="simple",
        scene=scene or SceneRef(name=trial.scene.floor_plan),
        subtasks=(subtask,),
    )


def goals_of(trial: Trial) -> tuple[Goal, ...]:
    """Return what is to hold when a trial's task is done."""
    wanted, kind = trial.pddl_params, trial.task_type
    count = 2 if kind == "pick_two_obj_and_place" else 1
    target = wanted.object_target
    thing = _name(piece_type(target) if wanted.object_sliced else target, "pickupable")
    goals: list[Goal] = []
    if wanted.object_sliced:
        goals.append(_goal("STATE", _name(target, "sliceable"), "sliced", count=count))
    if kind == "look_at_obj_in_light":
        lamp = _name(wanted.toggle_target, "toggleable")
        return (*goals, _goal("HOLDON", "robot", thing), _goal("STATE", lamp, "shining"))
    if kind in _DEEDS:
        goals.append(_goal("STATE", thing, _DEEDS[kind]))
    place = _name(wanted.parent_target, "receptacle")
    if kind == "pick_and_place_with_movable_recep":
        dish = _name(wanted.mrecep_target, "pickupable", "receptacle")
        return (*goals, _goal("ON", thing, dish), _goal("ON", dish, place))
    return (*goals, _goal("ON", thing, place, count=count))


def _name(target: str, *needed: Capability) -> str:
    """Return the types that ALFRED finds by a target, itself first: all with it in their names."""
    found = [target]
    for name in sorted(names_then()):
        now = type_now(name)
        kind = object_types().get(now or "")
        if kind is None or target not in name or not all(map(kind.can, needed)):
            continue
        if not any(covers(one, name) for one in found):
            found.append(name)
    return "/".join(found)


def _goal(predicate: str, *arguments: str, count: int = 1) -> Goal:
    return Goal(predicate=predicate, arguments=arguments, count=count)
