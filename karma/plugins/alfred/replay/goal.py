"""Decide whether a task of ALFRED's is done, as ALFRED's own evaluation does on metadata.

A target names objects by any part of their id: Pen also finds Pencil, Pot also Potato, Knife also
ButterKnife. "In" means listed among a receptacle's `receptacleObjectIds`.

    pick_and_place_simple             an object in a receptacle
    pick_two_obj_and_place            two objects in one and the same receptacle
    look_at_obj_in_light              the object is held, and a lamp is on and in view
    pick_{clean,heat,cool}_then_place an object in a receptacle that was {cleaned, heated, cooled}
    pick_and_place_with_movable       an object in a movable receptacle that is in a receptacle

For sliced targets the object is `<type>Sliced`, and there have to be as many pieces as objects.
Cleaned, heated and cooled are told by events, not by looks: `Deeds` keeps what lay in the basin
nearest to a faucet at the moment it was switched on, in a microwave switched on, in a fridge being
closed. Beyond ALFRED's rule the world has to agree at that moment, unless `Deeds` is told not to
ask: what was heated is Hot, what was cooled Cold, and what was cleaned not dirty.

Each task is a number of conditions, as ALFRED counts them for partial success; it is done when all
are met. Where the object is sliced, every piece that is needed is one more.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from karma.household.ids import type_of
from karma.household.pieces import piece_type
from karma.household.uses import BASIN_OF, FAUCET, FRIDGE, MICROWAVE, SINK
from karma.plugins.alfred.replay.trial import Trial

Thing = Mapping[str, Any]  # one object of the metadata
Metadata = Mapping[str, Any]


@dataclass(slots=True)
class Deeds:
    """Ids of what an episode's actions have cleaned, heated and cooled, for ever."""

    agreeing: bool = True  # the world has to agree
    cleaned: set[str] = field(default_factory=set)
    heated: set[str] = field(default_factory=set)
    cooled: set[str] = field(default_factory=set)

    def note(self, action: str, object_id: str, after: Metadata) -> None:
        """Take in a successful action on an object."""
        for does, kind, deed, (key, value) in _EFFECTS:
            if action == does and kind in object_id:
                place = (_nearest_basin if kind == FAUCET else _by_id)(object_id, after)
                ids = _contents(place)
                if self.agreeing:
                    things = {one["objectId"]: one for one in after["objects"]}
                    ids = {one for one in ids if one in things and things[one][key] == value}
                getattr(self, deed).update(ids)


_EFFECTS = (  # an action, a type in the id of its object, the deed, and how it looks afterwards
    ("ToggleObjectOn", FAUCET, "cleaned", ("isDirty", False)),
    ("ToggleObjectOn", MICROWAVE, "heated", ("temperature", "Hot")),
    ("CloseObject", FRIDGE, "cooled", ("temperature", "Cold")),
)


def noteworthy(action: str, object_id: str) -> bool:
    """Return whether `Deeds.note` would look at the metadata after an action."""
    return any(action == does and kind in object_id for does, kind, *_ in _EFFECTS)


def _by_id(object_id: str, metadata: Metadata) -> Thing | None:
    return next((one for one in metadata["objects"] if one["objectId"] == object_id), None)


def _nearest_basin(faucet: str, metadata: Metadata) -> Thing | None:
    source = _by_id(faucet, metadata)
    basins: list[Thing] = [
        one for one in metadata["objects"] if one["objectType"] == BASIN_OF[SINK]
    ]
    if source is None or not basins:
        return None
    here = _place(source)
    return min(basins, key=lambda one: (math.dist(_place(one), here), str(one["objectId"])))


def _place(one: Thing) -> list[float]:
    return [float(one["position"][axis]) for axis in "xyz"]


def _contents(receptacle: Thing | None) -> set[str]:
    return set() if receptacle is None else set(receptacle["receptacleObjectIds"] or ())


# ----------------------------------------------------------------- the tasks


@dataclass(frozen=True, slots=True, kw_only=True)
class _EndState:
    """What a task's condition looks at."""

    metadata: Metadata
    deeds: Deeds
    objects: Sequence[Thing]  # that the target names
    receptacles: Sequence[Thing]
    movables: Sequence[Thing]
    lamps: Sequence[Thing]


class Conditions(NamedTuple):
    """How many of a task's conditions are met."""

    met: int
    of: int

    @property
    def all_met(self) -> bool:
        """Whether the task is done."""
        return self.met == self.of


def goal_met(trial: Trial, metadata: Metadata, deeds: Deeds, *, exact: bool = False) -> bool:
    """Return whether the trial's task is done; arguments as in `conditions`."""
    return conditions(trial, metadata, deeds, exact=exact).all_met


def conditions(
    trial: Trial, metadata: Metadata, deeds: Deeds, *, exact: bool = False
) -> Conditions:
    """Count the conditions of a trial's task.

    If `exact`, targets name types, as they did to the planner, not parts of ids.
    """
    targets, wanted = trial.pddl_params, trial.pddl_params.object_target

    def find(name: str, capability: str) -> list[Thing]:
        able = [one for one in metadata["objects"] if one[capability]]
        if exact:
            return [one for one in able if type_of(one["objectId"]) == name]
        return [one for one in able if name in one["objectId"]]

    case = _EndState(
        metadata=metadata,
        deeds=deeds,
        objects=find(piece_type(wanted) if targets.object_sliced else wanted, "pickupable"),
        receptacles=find(targets.parent_target, "receptacle"),
        movables=find(targets.mrecep_target, "pickupable"),
        lamps=find(targets.toggle_target, "toggleable"),
    )
    met = _CONDITIONS[trial.task_type](case)
    if targets.object_sliced:
        needed = _COUNT.get(trial.task_type, 1)
        met += tuple(number < len(case.objects) for number in range(needed))
    return Conditions(sum(met), len(met))


def _placed(case: _EndState) -> set[str]:
    inside = {one for place in case.receptacles for one in _contents(place)}
    return {one["objectId"] for one in case.objects} & inside


def _two_placed(case: _EndState) -> tuple[bool, ...]:
    wanted = {one["objectId"] for one in case.objects}
    most = max((len(wanted & _contents(place)) for place in case.receptacles), default=0)
    return most >= 1, most >= 2


def _treated(case: _EndState, ids: set[str]) -> tuple[bool, ...]:
    placed, done = _placed(case), ids & {one["objectId"] for one in case.objects}
    return bool(placed), bool(done), bool(placed & done)


def _stacked(case: _EndState) -> tuple[bool, ...]:
    wanted = {one["objectId"] for one in case.objects}
    goals = {one["objectId"] for one in case.receptacles}
    inside = {one for place in case.receptacles for one in _contents(place)}
    full = [stack for stack in case.movables if wanted & _contents(stack)]
    moved = any(stack["objectId"] in inside for stack in case.movables)
    both = any(goals & set(stack["parentReceptacles"] or ()) for stack in full)
    return bool(full), moved, both


def _lit(case: _EndState) -> tuple[bool, ...]:
    held = {one["objectId"] for one in case.metadata["inventoryObjects"]}
    shining = any(lamp["isToggled"] and lamp["visible"] for lamp in case.lamps)
    return bool(held & {one["objectId"] for one in case.objects}), shining


_COUNT = {"pick_two_obj_and_place": 2}
_CONDITIONS: dict[str, Callable[[_EndState], tuple[bool, ...]]] = {
    "pick_and_place_simple": lambda case: (bool(_placed(case)),),
    "pick_two_obj_and_place": _two_placed,
    "look_at_obj_in_light": _lit,
    "pick_clean_then_place_in_recep": lambda case: _treated(case, case.deeds.cleaned),
    "pick_heat_then_place_in_recep": lambda case: _treated(case, case.deeds.heated),
    "pick_cool_then_place_in_recep": lambda case: _treated(case, case.deeds.cooled),
    "pick_and_place_with_movable_recep": _stacked,
}
