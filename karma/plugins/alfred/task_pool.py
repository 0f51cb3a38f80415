"""Read ALFRED's demonstrations as tasks of the policy laboratory."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path

import msgspec

from karma.bench.policies.tasks import Errand, Finds, Pool, distinct
from karma.errors import FileError
from karma.household.ids import root_type
from karma.household.places import ROOMS
from karma.household.types import types_with
from karma.household.uses import KNIVES
from karma.plugins.alfred.replay.trial import PlannerAction, Targets
from karma.plugins.alfred.sentences import read_demonstrations

_FLOOR_PLANS = dict(zip((0, 2, 3, 4), ROOMS, strict=True))  # by the hundred


class _Scene(msgspec.Struct, frozen=True):
    floor_plan: str


class _PlanStep(msgspec.Struct, frozen=True):
    planner_action: PlannerAction


class _Plan(msgspec.Struct, frozen=True):
    high_pddl: tuple[_PlanStep, ...]


class _Trial(msgspec.Struct, frozen=True):
    pddl_params: Targets
    scene: _Scene
    plan: _Plan


def alfred_pool(paths: Iterable[Path]) -> Pool:
    """Return the tasks of files of ALFRED demonstrations, one JSON record a line.

    FileError if a file is missing, torn, or holds something else.
    """
    paths = tuple(paths)
    movable = types_with("pickupable")
    errands: list[Errand] = []
    spots: dict[str, set[tuple[str, str]]] = defaultdict(set)
    found: dict[tuple[str, str], Counter[str]] = defaultdict(Counter)
    for path in paths:
        for trial in read_demonstrations(path, _Trial):
            errand = _errand(trial, path)
            errands.append(errand)
            picked: set[str] = set()
            for kind, receptacle, spot in _handled(trial):
                if receptacle in movable:
                    continue
                spots[errand.scene].add((receptacle, spot))
                if kind and kind not in picked:
                    picked.add(kind)
                    found[errand.room, kind][receptacle] += 1
    if not errands:
        raise FileError(paths[0], "no demonstrations in it")
    places = {scene: Counter(kind for kind, _ in at) for scene, at in spots.items()}
    source = "ALFRED, " + ", ".join(path.name.split(".")[0] for path in paths)
    return Pool(source=source, errands=tuple(errands), finds=Finds(places=places, found=found))


def _handled(trial: _Trial) -> Iterator[tuple[str, str, str]]:
    """Yield what is picked up ("" for what is put down), from which receptacle, and its place."""
    for act in (step.planner_action for step in trial.plan.high_pddl):
        where = act.coordinate_receptacle_object_id
        if where and act.action in ("PickupObject", "PutObject"):
            kind = root_type(act.object_id or "") if act.action == "PickupObject" else ""
            yield kind, where[0], str(where[1:])


def _errand(trial: _Trial, path: Path) -> Errand:
    wanted, plan = trial.pddl_params, trial.scene.floor_plan
    number = plan.removeprefix("FloorPlan")
    room = _FLOOR_PLANS.get(int(number) // 100) if number.isdigit() else None
    if room is None:
        raise FileError(path, f"{plan!r} is no floor plan of ALFRED's")
    subjects = distinct((wanted.object_target, wanted.mrecep_target))
    knives = [
        kind
        for step in trial.plan.high_pddl
        if wanted.object_sliced and step.planner_action.action == "PickupObject"
        if (kind := root_type(step.planner_action.object_id or "")) in KNIVES
    ]
    return Errand(
        scene=plan,
        room=room,
        r4=distinct((*subjects, wanted.toggle_target, wanted.parent_target)),
        m=distinct((*subjects, *knives)),
        subjects=subjects,
    )
