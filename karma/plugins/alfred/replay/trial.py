"""Read ALFRED's files as strict records: demonstrations, and the side files of their rooms.

A trial is a line of JSON (or a lone `traj_data.json`) with `id` or `task_id`, `task_type`,
`pddl_params`, `scene` and `plan`, as ALFRED publishes them, and `turk_annotations` where people
described it. Keys that are not read are allowed.
"""

import json
import re
import struct
from collections.abc import Iterator
from decimal import ROUND_HALF_EVEN, ROUND_HALF_UP, Context, Decimal
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import msgspec

from karma.errors import FileError
from karma.household.ids import made_at, root_id, type_of
from karma.plugins.thor_tools.importing.dump import COPY, Coordinate, Xyz, read_unzipped
from karma.types.space import Vec3

_SEVEN_DIGITS = Context(prec=7, rounding=ROUND_HALF_EVEN)
_CENT = Decimal("0.01")


def object_id(kind: str, position: Vec3) -> str:
    """Return the id of an object that spawned at a position, metres.

    The simulator holds a coordinate as a 32-bit float, takes its text of 7 significant digits, and
    rounds that to 2 decimals, halves away from zero; what rounds to zero from below has no sign.

    >>> object_id("Apple", (-0.465, 1.125, -0.0049))
    'Apple|-00.47|+01.13|00.00'
    """
    return "|".join([kind, *map(_coordinate, position)])


def _coordinate(value: float) -> str:
    single = struct.unpack("f", struct.pack("f", value))[0]
    rounded = _SEVEN_DIGITS.create_decimal_from_float(single).quantize(_CENT, ROUND_HALF_UP)
    digits = f"{abs(rounded):05.2f}"
    if value >= 0:
        return f"+{digits}"
    return f"-{digits}" if rounded else digits


def spelt_out(name: str) -> str:
    """Return the id of what a side file names by type and exact place only, e.g. `Type@[x, y, z]`.

    >>> spelt_out("Shelf@[-1.029, 1.529, -1.593]"), spelt_out("Bed|+00.00|+00.10|+01.00")
    ('Shelf|-01.03|+01.53|-01.59', 'Bed|+00.00|+00.10|+01.00')
    """
    kind, at, rest = name.partition("@")
    try:
        x, y, z = map(float, rest.strip("[]").split(","))
    except ValueError:
        return name
    return object_id(kind, (x, y, z)) if at else name


_BETWEEN = re.compile(r"[\s,\[\]]*")  # JSON values
T = TypeVar("T")
TYPES_OF_TASK = (
    "pick_and_place_simple",
    "pick_two_obj_and_place",
    "look_at_obj_in_light",
    "pick_clean_then_place_in_recep",
    "pick_heat_then_place_in_recep",
    "pick_cool_then_place_in_recep",
    "pick_and_place_with_movable_recep",
)
_ROUNDED_M = 0.0052  # half a hundredth, which ids round away, and a little
_LOCATION = re.compile(r"loc\|(-?\d+)\|(-?\d+)\|([0-3])\|(-?\d+)")
_FORM = "this takes ALFRED's files; recordings of AI2-THOR: karma world replay-events"


class SpawnPose(msgspec.Struct, frozen=True, kw_only=True, rename="camel"):
    """Where one movable object spawned."""

    object_name: str
    position: Xyz
    rotation: Xyz = Xyz(0.0, 0.0, 0.0)
    object_id: str | None = None

    @property
    def kind(self) -> str:
        """Its type: the name of its model up to the underscore."""
        return self.object_name.partition("_")[0]

    @property
    def id(self) -> str:
        """Its id: as given, else by the rule."""
        return self.object_id or object_id(self.kind, self.position.tuple)


class ToggleState(msgspec.Struct, frozen=True, kw_only=True, rename="camel"):
    """Whether all objects of a type are switched on at the start."""

    object_type: str
    is_on: bool


class StartPose(msgspec.Struct, frozen=True, kw_only=True):
    """The agent's first pose: metres, degrees."""

    x: Coordinate
    y: Coordinate
    z: Coordinate
    rotation: Coordinate
    horizon: Coordinate


class SceneFacts(msgspec.Struct, frozen=True, kw_only=True):
    """The room and what differs in it."""

    floor_plan: str
    init_action: StartPose
    object_poses: tuple[SpawnPose, ...]
    object_toggles: tuple[ToggleState, ...] = ()
    dirty_and_empty: bool = False


class Targets(msgspec.Struct, frozen=True, kw_only=True):
    """What the task is about; "" where it does not ask for one."""

    object_target: str
    parent_target: str = ""
    toggle_target: str = ""
    mrecep_target: str = ""
    object_sliced: bool = False


class Spot(NamedTuple):
    """A receptacle or object that the planner names by type and place."""

    kind: str
    position: Vec3


class PlannerAction(msgspec.Struct, frozen=True, kw_only=True, rename="camel"):
    """One sub-goal as the planner wrote it."""

    action: str
    location: str | None = None
    object_id: str | None = None
    receptacle_object_id: str | None = None
    coordinate_object_id: tuple[str, tuple[float, ...]] | None = None
    coordinate_receptacle_object_id: tuple[str, tuple[float, ...]] | None = None

    @property
    def pose(self) -> tuple[int, int, int, int] | None:
        """Where a GotoLocation ends: x and z in quarter metres, quarter turns, degrees."""
        found = _LOCATION.fullmatch(self.location or "")
        if found is None:
            return None
        x, z, turns, horizon = map(int, found.groups())
        return (x, z, turns, horizon)

    @property
    def thing(self) -> Spot | None:
        """The object, with its place in the planner's words."""
        return _spot(self.coordinate_object_id)

    @property
    def receptacle(self) -> Spot | None:
        """The receptacle, with its place in the planner's words."""
        return _spot(self.coordinate_receptacle_object_id)


def _spot(given: tuple[str, tuple[float, ...]] | None) -> Spot | None:
    """Return the place of six numbers: x, z and y in quarter metres, each twice."""
    if given is None or len(given[1]) != 6:
        return None
    kind, (x, _, z, _, y, _) = given
    return Spot(kind, (x / 4, y / 4, z / 4))


class HighLevelStep(msgspec.Struct, frozen=True, kw_only=True):
    """One step of the plan."""

    high_idx: int
    planner_action: PlannerAction


class ApiAction(msgspec.Struct, frozen=True, kw_only=True, rename="camel"):
    """One action as it was sent to the simulator; other keys are dropped."""

    action: str
    object_id: str | None = None
    receptacle_object_id: str | None = None
    force_action: bool = False
    place_stationary: bool | None = None
    move_magnitude: float | None = None


class LowAction(msgspec.Struct, frozen=True, kw_only=True):
    """One recorded action and the sub-goal that it belongs to."""

    high_idx: int
    api_action: ApiAction


class DemonstratedPlan(msgspec.Struct, frozen=True, kw_only=True):
    """The planner's sub-goals and the actions that carried them out."""

    high_pddl: tuple[HighLevelStep, ...]
    low_actions: tuple[LowAction, ...]


class Annotation(msgspec.Struct, frozen=True, kw_only=True):
    """What one person said of a demonstration."""

    task_desc: str  # the goal in a sentence
    high_descs: tuple[str, ...] = ()  # each sub-goal


class _Annotations(msgspec.Struct, frozen=True, kw_only=True):
    """The form in which a lone `traj_data.json` has them."""

    anns: tuple[Annotation, ...]


class Trial(msgspec.Struct, frozen=True, kw_only=True):
    """One demonstration."""

    id: str = ""
    task_id: str = ""
    task_type: str
    pddl_params: Targets
    scene: SceneFacts
    plan: DemonstratedPlan
    turk_annotations: tuple[Annotation, ...] | _Annotations = ()

    @property
    def annotations(self) -> tuple[Annotation, ...]:
        """What people said of it, in their order."""
        said = self.turk_annotations
        return said.anns if isinstance(said, _Annotations) else said


# ----------------------------------------------------------------- reading


def read_trials(path: str | Path) -> Iterator[Trial]:
    """Yield the trials of a file, or of ALFRED's tree of folders.

    A file holds JSON lines, or JSON values one after another or in an array, also gzipped.

    Raises:
        FileError: missing, torn, or not of ALFRED's form; names the line and the field.
    """
    if Path(path).is_dir():
        for one in trial_files(Path(path)):
            yield from read_trials(one)
        return
    data = read_unzipped(path)
    if data.strip() in (b"", b"[]"):
        raise FileError(path, "line 1: the file is empty", fix=COPY)
    decoder = msgspec.json.Decoder(Trial)
    for place, text in _documents(data):
        try:
            trial = decoder.decode(text)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise FileError(path, f"{place}: {error}", fix=_help(error)) from error
        trial = msgspec.structs.replace(
            trial, id=trial.id or trial.task_id, scene=_as_named(trial.scene, trial.plan)
        )
        if wrong := next(_wrong(trial), None):
            raise FileError(path, f"{place}: {wrong}", fix=_FORM)
        yield trial


def _documents(data: bytes) -> Iterator[tuple[str, bytes]]:
    lines = data.splitlines()
    if data.lstrip()[:1] == b"[" or lines[0].strip() == b"{":  # objects over many lines
        return _values(data)
    return ((f"line {number}", line) for number, line in enumerate(lines, 1) if line.strip())


def _values(data: bytes) -> Iterator[tuple[str, bytes]]:
    """Yield the JSON values of a text, one after another or in an array; what is torn as it is."""
    text = data.decode(errors="replace")
    decode, at = json.JSONDecoder(strict=False).raw_decode, 0
    while (at := _BETWEEN.match(text, at).end()) < len(text):  # type: ignore[union-attr]
        try:
            _, end = decode(text, at)
        except (ValueError, RecursionError):
            end = len(text)
        yield f"line {text.count(chr(10), 0, at) + 1}", text[at:end].encode()
        at = end


def trial_files(path: Path) -> list[Path]:
    """Return the files of trials: the one that is given, or those of ALFRED's tree in a folder.

    Raises:
        FileError: there is none in the folder.
    """
    if not path.is_dir():
        return [path]
    for name in ("traj_data.json", "ann_0.json"):
        if found := sorted(path.rglob(name)):
            return found
    raise FileError(path, "no traj_data.json in it, or in a folder below", fix=COPY)


def _as_named(scene: SceneFacts, plan: DemonstratedPlan) -> SceneFacts:
    """Return the facts with the ids that actions use, where the rule misses them by a hundredth.

    It does for some poses that were rounded before their ids were left out.
    """
    actions = [low.api_action for low in plan.low_actions]
    said = {one for act in actions for one in (act.object_id, act.receptacle_object_id) if one}
    named = sorted({root_id(one) for one in said})
    taken = {pose.id for pose in scene.object_poses}
    poses = list(scene.object_poses)
    for one in named:
        off = {
            row: _off(pose, one)
            for row, pose in enumerate(poses)
            if pose.object_id is None and pose.kind == type_of(one) and pose.id not in named
        }
        nearest = min(off, key=off.__getitem__, default=None)
        if one not in taken and nearest is not None and off[nearest] <= _ROUNDED_M:
            poses[nearest] = msgspec.structs.replace(poses[nearest], object_id=one)
    return msgspec.structs.replace(scene, object_poses=tuple(poses))


def _off(pose: SpawnPose, named: str) -> float:
    """Return by how much a pose misses the place that an id tells, along the worst axis."""
    place = made_at(named)
    if place is None:
        return float("inf")
    return max(abs(a - b) for a, b in zip(pose.position.tuple, place, strict=True))


def _help(error: Exception) -> str:
    return _FORM if isinstance(error, msgspec.ValidationError) else COPY


def _wrong(trial: Trial) -> Iterator[str]:
    """Yield what makes a well-formed trial useless, with its field."""
    if not trial.id:
        yield "`id` and `task_id` are both missing"
    if trial.task_type not in TYPES_OF_TASK:
        yield f"{trial.task_type!r} is not a task type of ALFRED - at `$.task_type`"
    for number, pose in enumerate(trial.scene.object_poses):
        if type_of(pose.id) != pose.kind:
            field = f"at `$.scene.object_poses[{number}]`"
            yield f"{pose.id!r} is not an id of {pose.object_name!r} - {field}"
    for number, goal in enumerate(trial.plan.high_pddl):
        step = goal.planner_action
        if step.action == "GotoLocation" and step.pose is None:
            field = f"at `$.plan.high_pddl[{number}].planner_action.location`"
            yield f"{step.location!r} is not loc|x|z|quarter turns|horizon - {field}"


def read_ids(path: str | Path) -> tuple[str, ...]:
    """Read trial ids: a list, or an object that holds exactly one list of ids.

    Raises:
        FileError: torn, or neither.
    """
    given: Any = read_table(path, object)
    if isinstance(given, dict):
        lists = [value for value in given.values() if isinstance(value, list)]
        given = lists[0] if len(lists) == 1 else None
    if not isinstance(given, list) or not all(isinstance(one, str) for one in given):
        reason = "expected a list of trial ids, or an object with one such list"
        raise FileError(path, reason, fix="write one, or name trials with --only")
    return tuple(given)


def read_table(path: str | Path, kind: type[T]) -> T:
    """Read a side file of a form, as a rule one row for each FloorPlan.

    Raises:
        FileError: missing, torn, or of another form; names the field.
    """
    try:
        return msgspec.json.decode(read_unzipped(path), type=kind)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise FileError(path, str(error), fix=_help(error)) from error
