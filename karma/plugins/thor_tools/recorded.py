"""Replay recorded sessions of the real simulator here, and compare them flag by flag.

A recording is a file of lines {"action": {...}, "metadata": {...}}, one per step; the first is
Initialize, and its metadata is the scene. Every following action is done by `EmbeddedWorld.step`,
and what the world then reports is held against what AI2-THOR reported.

Compared: `differences.FLAGS` of every object, lists of ids as sets; the inventory, the agent's
pose, and whether the action succeeded. An object that only one side has counts as different in all
its flags. Apart stand `visible` and `isInteractable` (geometry of boxes) and `isMoving`
(physics): they are counted, but are no state. Not compared: positions and boxes of objects.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from karma.errors import FileError
from karma.household.ids import made_at
from karma.household.uses import BASINS
from karma.plugins.thor_tools.differences import (
    KINDS,
    MISSING,
    Attribution,
    Key,
    MomentPair,
    Row,
    Values,
    alike,
    shown,
    values,
)
from karma.plugins.thor_tools.importing.dump import EXPORT, AgentStance, read_layouts, rows, stance
from karma.plugins.thor_tools.importing.scenes import scene_from_dump
from karma.world.core.ground import Cell
from karma.world.core.scene import Scene, SceneObject
from karma.world.core.thing import bottom, gaps
from karma.world.sim import EmbeddedWorld

_SETTINGS = ("visibilityDistance", "fieldOfView", "rotateStepDegrees", "snapToGrid")
_OF_THE_CLIENT = ("sequenceId", "raise_for_failure")
_LAYOUT_M = 0.25  # ALFRED's cells
_ON_GRID = 0.05  # of a step
_SUNK_M = 0.0065  # more than an id's rounding
_FLOOR_M = 0.03  # of a basin: what was made on it was made no farther below its lower side

# ----------------------------------------------------------------- the report


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """One value on which the two simulators do not agree."""

    step: int  # 1 is the first action after Initialize
    action: str
    object_id: str  # "" for the agent, the inventory and the action's success
    field: str
    ours: Any
    theirs: Any
    cause: str  # one of `differences.CAUSES`; it counts as a difference whatever the cause


@dataclass(frozen=True, slots=True, kw_only=True)
class EqualShare:
    """How many of some values agree."""

    compared: int
    equal: int

    @property
    def rate(self) -> float | None:
        """Share in [0, 1]; None when nothing was compared."""
        return self.equal / self.compared if self.compared else None


@dataclass(frozen=True, slots=True, kw_only=True)
class EventReport:
    """One recording: how many values were compared, and those that differ."""

    path: str
    scene: str
    steps: int
    compared: int
    equal: int
    changes: EqualShare  # of the values that AI2-THOR's actions changed, those that do so here
    seen: EqualShare  # `visible` and `isInteractable`; not part of `compared`
    motion: EqualShare  # `isMoving`; not part of `compared`
    differences: tuple[Difference, ...]  # of what `compared` counts

    @property
    def rate(self) -> float | None:
        """Share of equal values; None when nothing was compared."""
        return self.equal / self.compared if self.compared else None

    @property
    def causes(self) -> dict[str, int]:
        """How many differences each cause has, the most frequent first."""
        return dict(Counter(one.cause for one in self.differences).most_common())


def total_rate(reports: Sequence[EventReport]) -> float | None:
    """Return the share of equal values over several recordings; None when none was compared."""
    compared = sum(report.compared for report in reports)
    return sum(report.equal for report in reports) / compared if compared else None


# ----------------------------------------------------------------- reading


class _Named(msgspec.Struct, frozen=True, rename="camel"):
    object_id: str


class _Metadata(msgspec.Struct, frozen=True, rename="camel"):
    scene_name: str
    last_action_success: bool
    agent: AgentStance
    objects: list[_Named]
    inventory_objects: list[_Named]


class _Action(msgspec.Struct, frozen=True):
    action: str


class _RecordedStep(msgspec.Struct, frozen=True):
    action: _Action
    metadata: _Metadata


def read_events(path: str | Path) -> list[tuple[Row, Row]]:
    """Return a recording's steps, each (action, metadata).

    Raises:
        FileError: unreadable, or a line is not a step; names it.
    """
    steps: list[tuple[Row, Row]] = []
    for place, row in rows(Path(path)):
        try:
            msgspec.convert(row, _RecordedStep)
        except msgspec.ValidationError as error:
            reason = f"{place}: not a recorded step: {error}"
            raise FileError(path, reason, fix=EXPORT) from error
        steps.append((row["action"], row["metadata"]))
    return steps


def scene_of(
    action: Row,
    metadata: Row,
    *,
    reachable: Sequence[Cell] | None = None,
    stood: Sequence[Cell] = (),
) -> Scene:
    """Return the scene that a recording's first event describes, Initialize's.

    Cells are (x, z), and computed from the boxes when None; those stood on are free.

    Raises:
        FileError: the metadata is no scene; the path is the scene's name.
    """
    name = str(metadata["sceneName"])
    agent, _ = stance(metadata, name, "Initialize")
    scene = scene_from_dump(
        name.removesuffix("_physics"),
        metadata["objects"],
        reachable=reachable,
        stood=stood,
        agent=agent,
        grid_m=float(action.get("gridSize") or _LAYOUT_M),
    )
    return msgspec.structs.replace(scene, objects=with_falling(scene.objects))


# ----------------------------------------------------------------- replaying


def replay_events(path: str | Path, *, layouts: str | Path | None = None) -> EventReport:
    """Replay one recording and compare every step.

    `layouts` are ALFRED's cells by scene name, used where the recording's grid is theirs; without
    them cells are computed from the boxes.

    Raises:
        FileError: unreadable, not a recording, or its scene does not import.
    """
    steps = read_events(path)
    cells = {} if layouts is None else read_layouts(layouts)
    moments = list(_replayed(str(path), steps, cells))
    return _compared(str(path), str(steps[0][1]["sceneName"]), moments)


def _replayed(
    path: str, steps: Sequence[tuple[Row, Row]], cells: Mapping[str, Sequence[Cell]]
) -> Iterator[MomentPair]:
    """Yield both sides after each step; an Initialize further on begins a room anew."""
    world = EmbeddedWorld()
    for number, (action, theirs) in enumerate(steps):
        if number == 0 or action["action"] == "Initialize":
            world = _begun(f"{path}, step {number}", steps[number:], cells)
        else:
            arguments = {k: v for k, v in action.items() if k not in _OF_THE_CLIENT}
            with suppress(ValueError):  # misuse: the world keeps the refusal as its last event
                world.step(arguments)
        yield MomentPair(action=action, ours=world.last_event.metadata, theirs=theirs)


def _begun(
    place: str, steps: Sequence[tuple[Row, Row]], cells: Mapping[str, Sequence[Cell]]
) -> EmbeddedWorld:
    """Return a world with the room that an Initialize reported, the first of some steps."""
    action, theirs = steps[0]
    usual = float(action.get("gridSize") or _LAYOUT_M) == _LAYOUT_M
    known = cells.get(str(theirs["sceneName"]).removesuffix("_physics")) if usual else None
    settings = {key: action[key] for key in _SETTINGS if action.get(key) is not None}
    try:
        scene = scene_of(action, theirs, reachable=known, stood=_stood(steps))
        return EmbeddedWorld(scene, **settings)
    except FileError as error:
        raise FileError(place, error.reason, fix=error.fix) from error
    except ValueError as error:
        raise FileError(place, f"Initialize: {error}", fix=EXPORT) from error


def _stood(steps: Sequence[tuple[Row, Row]]) -> list[Cell]:
    """Return where the agent stood until the next room: whole steps of the grid from its start."""
    grid_m = float(steps[0][0].get("gridSize") or _LAYOUT_M)
    found: dict[Cell, None] = {}
    for number, (action, metadata) in enumerate(steps):
        if number and action["action"] == "Initialize":
            break
        at = metadata["agent"]["position"]
        found[float(at["x"]), float(at["z"])] = None
    x, z = next(iter(found))
    off = {cell: ((cell[0] - x) / grid_m, (cell[1] - z) / grid_m) for cell in found}
    return [c for c in found if max(abs(part - round(part)) for part in off[c]) < _ON_GRID]


# ----------------------------------------------------------------- comparing


def _compared(path: str, scene: str, moments: Sequence[MomentPair]) -> EventReport:
    counts = Counter[tuple[str, str]]()
    found: list[Difference] = []
    attribution = Attribution(moments[0])
    before = values(moments[0].theirs)
    for step, moment in enumerate(moments[1:], 1):
        ours, theirs = values(moment.ours), values(moment.theirs)
        attribution.follow(moment, before, theirs)
        unlike = _count(counts, ours, before, theirs)
        for object_id, field in unlike:
            mine, real = (side.get((object_id, field), MISSING) for side in (ours, theirs))
            cause = attribution.cause(object_id, field, mine, real)
            found.append(
                Difference(
                    step=step, action=str(moment.action["action"]), object_id=object_id,
                    field=field, ours=shown(mine), theirs=shown(real), cause=cause,
                )
            )  # fmt: skip
        before = theirs
    return EventReport(
        path=path,
        scene=scene,
        steps=len(moments) - 1,
        compared=counts["state", "all"],
        equal=counts["state", "equal"],
        changes=_share(counts, "changes"),
        seen=_share(counts, "seen"),
        motion=_share(counts, "motion"),
        differences=tuple(found),
    )


def _share(counts: Mapping[tuple[str, str], int], kind: str) -> EqualShare:
    return EqualShare(compared=counts[kind, "all"], equal=counts[kind, "equal"])


def _count(
    counts: Counter[tuple[str, str]], ours: Values, before: Values, theirs: Values
) -> list[Key]:
    """Count what is equal after one action, and return the keys of the states that are not."""
    unlike = []
    for key in (*theirs, *(key for key in ours if key not in theirs)):
        kind, real = KINDS.get(key[1], "state"), theirs.get(key, MISSING)
        same = alike(ours.get(key, MISSING), real)
        counts[kind, "all"] += 1
        counts[kind, "equal"] += same
        if kind != "state":
            continue
        if not alike(before.get(key, MISSING), real):
            counts["changes", "all"] += 1
            counts["changes", "equal"] += same
        if not same:
            unlike.append(key)
    return unlike


def with_falling(things: Iterable[SceneObject]) -> tuple[SceneObject, ...]:
    """Return the objects, with those that sink through a basin in nothing, and falling."""
    every = tuple(things)
    basins = [one for one in every if one.type in BASINS]
    return tuple(
        msgspec.structs.replace(one, parents=(), is_falling=True)
        if any(_sinks_through(one, basin) for basin in basins)
        else one
        for one in every
    )


def _sinks_through(thing: SceneObject, basin: SceneObject) -> bool:
    made, floor = made_at(thing.id), bottom(basin)
    if made is None or "pickupable" not in thing.capabilities:
        return False
    if thing.parents and basin.id not in thing.parents:
        return False
    x, y, z = thing.position
    over = max(gaps(basin, x, z)) <= 0.0
    return over and made[1] - y > _SUNK_M and made[1] > floor - _FLOOR_M and bottom(thing) < floor
