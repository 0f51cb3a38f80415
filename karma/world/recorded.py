"""Recorded sessions of the real simulator, replayed here and compared flag by flag.

A recording is a file of lines {"action": {...}, "metadata": {...}}, one per step; the first is
Initialize, and its metadata is the scene. Every following action is done by `EmbeddedWorld.step`,
and what the world then reports is held against what AI2-THOR reported.

Compared: the flags of `FLAGS` of every object, lists of ids as sets; the inventory, the agent's
pose, and whether the action succeeded. An object that only one side has counts as different in
all its flags. Apart stand `visible` and `isInteractable` (geometry of boxes) and `isMoving`
(physics): they are counted, but are no state. Not compared: positions and boxes of objects.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from karma.errors import FileError
from karma.world.dump import read_layouts, rows
from karma.world.importers import FLAGS as CAPABILITIES
from karma.world.importers import room_by_name, room_by_things, scene_from_dump
from karma.world.scene import AgentPose, Scene
from karma.world.sim import EmbeddedWorld

STATES = (
    "isToggled", "isBroken", "isFilledWithLiquid", "fillLiquid", "isDirty", "isUsedUp", "isCooked",
    "temperature", "isSliced", "isOpen", "openness", "isPickedUp",
)  # fmt: skip
LISTS = ("receptacleObjectIds", "parentReceptacles")
FLAGS = (*STATES, *LISTS, *CAPABILITIES)
SEEN = ("visible", "isInteractable")
MOTION = ("isMoving",)

CAUSES = {
    "jitter": "the real simulator changed it without an action: physics lets things settle, "
    "slide or fall",
    "start": "differs from the first event on: our scenes refuse two things in each other, and "
    "openness where isOpen is false",
    "place": "it came to lie elsewhere: where a put or a fall ends is chosen by physics",
    "pieces": "another number of slices: it belongs to the asset and is not published",
    "one side only": "an object that only one side has",
    "outcome": "the action ended otherwise here, and what follows from that",
    "heat": "heat and cold: the real simulator counts seconds of its own clock",
    "water": "a stream of water or coffee: the real simulator asks whether it is met",
    "breaking": "whether a fall or a throw breaks depends on the meshes that meet",
    "agent": "the agent's pose",
    "unexplained": "no rule tells",
}
ABSENT = "absent"  # the value of an object that one side does not have

_BY_FIELD = {
    "parentReceptacles": "place",
    "temperature": "heat",
    "isFilledWithLiquid": "water",
    "fillLiquid": "water",
    "isDirty": "water",
    "isBroken": "breaking",
}
_KINDS = {**dict.fromkeys(SEEN, "seen"), **dict.fromkeys(MOTION, "motion")}
_NEAR_POSE, _NEAR = 0.02, 1e-3
_SETTINGS = ("visibilityDistance", "fieldOfView", "rotateStepDegrees", "snapToGrid")
_LAYOUT_M = 0.25  # ALFRED's cells

Row = Mapping[str, Any]
Key = tuple[str, str]  # object id and field
Values = dict[Key, Any]  # lists of ids as frozen sets


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
    cause: str  # one of `CAUSES`; it counts as a difference whatever the cause


@dataclass(frozen=True, slots=True, kw_only=True)
class Share:
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
    changes: Share  # of the values that AI2-THOR's actions changed, those that changed alike here
    seen: Share  # `visible` and `isInteractable`; not part of `compared`
    motion: Share  # `isMoving`; not part of `compared`
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


class _Step(msgspec.Struct, frozen=True):
    action: dict[str, Any]
    metadata: dict[str, Any]


def read_events(path: str | Path) -> list[tuple[Row, Row]]:
    """Return a recording's steps, each (action, metadata).

    Raises:
        FileError: unreadable, or a line is not a step; names it.
    """
    steps: list[tuple[Row, Row]] = []
    for place, row in rows(Path(path)):
        try:
            step = msgspec.convert(row, _Step)
        except msgspec.ValidationError as error:
            raise FileError(path, f"{place}: not a recorded step: {error}") from error
        for key in ("agent", "objects", "sceneName", "inventoryObjects", "lastActionSuccess"):
            if key not in step.metadata:
                raise FileError(path, f"{place}: metadata: `{key}` is missing")
        if not isinstance(step.action.get("action"), str):
            raise FileError(path, f"{place}: action: `action` is missing")
        steps.append((step.action, step.metadata))
    if not steps:
        raise FileError(path, "there are no steps")
    return steps


class _Agent(msgspec.Struct, frozen=True, rename="camel"):
    position: dict[str, float]
    rotation: dict[str, float]
    camera_horizon: float


def scene_of(
    action: Row, metadata: Row, *, reachable: Sequence[tuple[float, float]] | None = None
) -> Scene:
    """Return the scene that a recording's first event describes.

    Args:
        action: Initialize and its arguments; `gridSize` is the grid.
        metadata: of its event.
        reachable: (x, z) cells; computed from the boxes when None.

    Raises:
        FileError: the metadata is no scene; the path is the scene's name.
    """
    name = str(metadata["sceneName"])
    try:
        agent = msgspec.convert(metadata["agent"], _Agent)
        x, y, z = (float(agent.position[axis]) for axis in "xyz")
        yaw = float(agent.rotation["y"]) % 360
    except (msgspec.ValidationError, KeyError) as error:
        raise FileError(name, f"agent: {error}") from error
    return scene_from_dump(
        name.removesuffix("_physics"),
        metadata["objects"],
        reachable=reachable,
        agent=AgentPose(position=(x, y, z), yaw=yaw, horizon=agent.camera_horizon + 0.0),
        grid_m=float(action.get("gridSize") or _LAYOUT_M),
        room=room_by_name(name) or room_by_things(metadata["objects"]),
    )


# ----------------------------------------------------------------- replaying


def replay_events(path: str | Path, *, layouts: str | Path | None = None) -> EventReport:
    """Replay one recording and compare every step.

    Args:
        path: .jsonl, also gzipped.
        layouts: ALFRED's cells by scene name, used where the recording's grid is theirs; without
            them cells are computed from the boxes.

    Raises:
        FileError: unreadable, not a recording, or its scene does not import.
    """
    steps = read_events(path)
    first, start = steps[0]
    name = str(start["sceneName"]).removesuffix("_physics")
    cells = None
    if layouts is not None and float(first.get("gridSize") or _LAYOUT_M) == _LAYOUT_M:
        cells = read_layouts(layouts).get(name)
    try:
        world = EmbeddedWorld(
            scene_of(first, start, reachable=cells),
            **{key: first[key] for key in _SETTINGS if first.get(key) is not None},
        )
    except FileError as error:
        raise FileError(path, f"line 1: {error.reason}") from error
    return _compared(str(path), str(start["sceneName"]), list(_replayed(world, steps)))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Moment:
    """Both sides after one action."""

    action: Row
    ours: Row
    theirs: Row


def _replayed(world: EmbeddedWorld, steps: Sequence[tuple[Row, Row]]) -> Iterator[_Moment]:
    for number, (action, theirs) in enumerate(steps):
        if number:
            arguments = {k: v for k, v in action.items() if k != "sequenceId"}
            with suppress(ValueError):  # misuse: the world keeps the refusal as its last event
                world.step(arguments)
        yield _Moment(action=action, ours=world.last_event.metadata, theirs=theirs)


# ----------------------------------------------------------------- comparing


def _compared(path: str, scene: str, moments: Sequence[_Moment]) -> EventReport:
    counts = Counter[tuple[str, str]]()
    found: list[Difference] = []
    blame = _Blame(moments[0])
    before = _values(moments[0].theirs)
    for step, moment in enumerate(moments[1:], 1):
        ours, theirs = _values(moment.ours), _values(moment.theirs)
        blame.follow(moment, before, theirs)
        unlike = _count(counts, ours, before, theirs)
        for object_id, field in unlike:
            mine, real = (side.get((object_id, field), ABSENT) for side in (ours, theirs))
            cause = blame.cause(object_id, field, mine, real)
            found.append(
                Difference(
                    step=step, action=str(moment.action["action"]), object_id=object_id,
                    field=field, ours=_shown(mine), theirs=_shown(real), cause=cause,
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


def _share(counts: Mapping[tuple[str, str], int], kind: str) -> Share:
    return Share(compared=counts[kind, "all"], equal=counts[kind, "equal"])


def _count(
    counts: Counter[tuple[str, str]], ours: Values, before: Values, theirs: Values
) -> list[Key]:
    """Count what is equal after one action, and return the keys of the states that are not."""
    unlike = []
    for key in (*theirs, *(key for key in ours if key not in theirs)):
        kind, real = _KINDS.get(key[1], "state"), theirs.get(key, ABSENT)
        alike = _alike(ours.get(key, ABSENT), real)
        counts[kind, "all"] += 1
        counts[kind, "equal"] += alike
        if kind != "state":
            continue
        if not _alike(before.get(key, ABSENT), real):
            counts["changes", "all"] += 1
            counts["changes", "equal"] += alike
        if not alike:
            unlike.append(key)
    return unlike


def _values(metadata: Row) -> Values:
    """Return every value that is compared."""
    agent = metadata["agent"]
    found: Values = {
        ("", "lastActionSuccess"): metadata["lastActionSuccess"],
        ("", "inventoryObjects"): frozenset(o["objectId"] for o in metadata["inventoryObjects"]),
        ("", "agent.isStanding"): agent.get("isStanding"),
    }
    for field in ("position", "rotation"):
        found["", f"agent.{field}"] = tuple(float(agent[field][axis]) for axis in "xyz")
    found["", "agent.cameraHorizon"] = (float(agent["cameraHorizon"]),)
    for thing in metadata["objects"]:
        for field in (*FLAGS, *_KINDS):
            value = thing.get(field)
            found[thing["objectId"], field] = (
                frozenset(value) if isinstance(value, list | tuple) else value
            )
    return found


def _alike(ours: Any, theirs: Any) -> bool:
    if isinstance(ours, tuple) and isinstance(theirs, tuple):
        return all(_near(a, b) for a, b in zip(ours, theirs, strict=True))
    if isinstance(ours, float) and isinstance(theirs, float | int):
        return abs(ours - theirs) <= _NEAR
    return bool(ours == theirs)


def _near(a: float, b: float) -> bool:
    """Return whether two metres or degrees of a pose are one."""
    return abs((a - b + 180) % 360 - 180) <= _NEAR_POSE


def _shown(value: Any) -> Any:
    return sorted(value) if isinstance(value, frozenset) else value


# ----------------------------------------------------------------- explaining


class _Blame:
    """Tells by rule where a difference comes from; a difference counts whatever its cause."""

    def __init__(self, start: _Moment) -> None:
        self._ours, self._theirs = _values(start.ours), _values(start.theirs)
        self._touched: set[str] = set()  # ids that an action concerned so far
        self._outcomes: set[str] = set()  # of them, those of an action that ended otherwise here
        self._alone: set[Key] = set()  # what the real simulator changed without an action

    def follow(self, moment: _Moment, before: Values, theirs: Values) -> None:
        """Take note of one action, and of what the real simulator changed beside it."""
        near = {str(moment.action.get("objectId", ""))}
        near |= before["", "inventoryObjects"] | theirs["", "inventoryObjects"]
        near |= {o["objectId"] for o in moment.ours["inventoryObjects"]}
        for object_id in tuple(near):
            near |= before.get((object_id, "receptacleObjectIds")) or frozenset()
        self._touched |= near - {""}
        if moment.ours["lastActionSuccess"] != moment.theirs["lastActionSuccess"]:
            self._outcomes |= near - {""}
        self._alone |= {
            key
            for key, value in theirs.items()
            if key[0] and not self._concerned(key[0]) and not _alike(before.get(key), value)
        }

    def _concerned(self, object_id: str) -> bool:
        whole = object_id.rsplit("|", 1)[0]  # of a slice
        return object_id in self._touched or whole in self._touched

    def cause(self, object_id: str, field: str, ours: Any, theirs: Any) -> str:
        """Return one of `CAUSES`."""
        key = (object_id, field)
        if ours is ABSENT or theirs is ABSENT or ours == ABSENT or theirs == ABSENT:
            return "pieces" if "Sliced_" in object_id else "one side only"
        if self._ours.get(key) == ours and self._theirs.get(key) == theirs:
            return "start"
        if field == "receptacleObjectIds":
            return self._of_contents(ours or frozenset(), theirs or frozenset())
        if key in self._alone:
            return "jitter"
        if not object_id:
            return "outcome" if field in ("lastActionSuccess", "inventoryObjects") else "agent"
        if object_id in self._outcomes:
            return "outcome"
        return _BY_FIELD.get(field, "unexplained")

    def _of_contents(self, ours: frozenset[str], theirs: frozenset[str]) -> str:
        """Return why two lists of contents differ: as their members' parents do."""
        strangers = ours ^ theirs
        if any("Sliced_" in member for member in strangers):
            return "pieces"
        if all((member, "parentReceptacles") in self._alone for member in strangers):
            return "jitter"
        return "outcome" if strangers & self._outcomes else "place"
