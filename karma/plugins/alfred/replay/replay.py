"""Replay a demonstration through the world's public `step`, and check where it leads.

1. Every action succeeds.
2. The agent's pose at the end of each GotoLocation is the planner's: same quarter-metre cell, same
   quarter turn, same horizon.
3. The task's goal is false at the start and true at the end. At the end ALFRED's evaluation
   decides. At the start types are exact, as they were to the planner, which would have had nothing
   to plan: that evaluation takes a pencil for a pen, and some rooms begin with one in place.

Only PutObject is recorded with `forceAction`. The others have to find their object in view, and
where boxes instead of meshes hide it from where the demonstrator saw it, they are done once more
with `forceAction`; such actions are counted as `unseen`, and with `strict` they fail. What is shut
in behind a door stays out of reach.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial

from karma.errors import KarmaError
from karma.offline.children import forking, starting
from karma.plugins.alfred.replay.build import build
from karma.plugins.alfred.replay.facts import RoomFacts
from karma.plugins.alfred.replay.goal import Deeds, goal_met, noteworthy
from karma.plugins.alfred.replay.steps import UntranslatableError, translated
from karma.plugins.alfred.replay.trial import ApiAction, HighLevelStep, LowAction, Trial
from karma.seeds import stream
from karma.world.core.hiding import hidden_rows
from karma.world.core.scene import Scene
from karma.world.sim import EmbeddedWorld

REACH_M, FOV_DEG = 1.5, 60.0  # ALFRED's visibility distance and vertical field of view
_CELL_M, _TURN_DEG = 0.25, 90.0
_NEAR = 0.01
_WIDER, _WIDEST = 1.3, 3.0  # times
_NO_ROOM = "No valid positions"


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialResult:
    """How the replay of one trial went."""

    id: str
    scene: str
    task: str
    ok: bool
    reason: str = ""  # what was found first; "" when ok
    step: int | None = None  # number of the low-level action it was found at, from 0
    deleted: int | None = None  # number of the action left out, when one was
    handled: int = 0  # actions done on objects
    unseen: int = 0  # of these, done on what is hidden here


class _Mismatch(KarmaError):
    """What a replay stops at."""

    def __init__(self, reason: str, step: int | None) -> None:
        super().__init__(reason)
        self.reason, self.step = reason, step


def replay(
    trial: Trial, facts: RoomFacts, *, mutate: int | None = None, strict: bool = False
) -> TrialResult:
    """Replay one trial in a world of its own.

    The facts are of its FloorPlan, with this trial among those gathered; `mutate` is the seed of
    the one action that is left out. If strict, an action on what is hidden here fails.
    """
    actions, deleted = trial.plan.low_actions, None
    if mutate is not None:
        actions, deleted = without_one(trial, mutate)
    reason, step, tally = "", None, _Tally(strict=strict)
    try:
        scene = fitted(trial, facts)
        world = EmbeddedWorld(scene, visibilityDistance=REACH_M, fieldOfView=FOV_DEG)
        _follow(world, trial, actions, tally)
    except _Mismatch as found:
        reason, step = found.reason, found.step
    except KarmaError as error:
        reason = f"there is no scene: {error}"
    return TrialResult(
        id=trial.id, scene=trial.scene.floor_plan, task=trial.task_type, ok=not reason,
        reason=reason, step=step, deleted=deleted, handled=tally.handled, unseen=tally.unseen,
    )  # fmt: skip


def replay_all(
    trials: Iterable[Trial],
    facts: Mapping[str, RoomFacts],
    *,
    mutate: int | None = None,
    strict: bool = False,
    workers: int = 1,
) -> Iterator[TrialResult]:
    """Replay trials as `replay`, yielding each result in their order, whatever the workers."""
    job = partial(replay, mutate=mutate, strict=strict)
    played = list(trials)
    rooms = [facts[trial.scene.floor_plan] for trial in played]
    if workers <= 1:
        yield from map(job, played, rooms)
        return
    with ProcessPoolExecutor(max_workers=workers, mp_context=forking(__name__)) as pool:
        with starting():
            found = pool.map(job, played, rooms, chunksize=4)
        yield from found


def fitted(trial: Trial, facts: RoomFacts) -> Scene:
    """Return the trial's scene with boxes in which everything finds room that was put there.

    Boxes are of another version of the room, or typical ones. Where a recorded PutObject finds no
    valid position, its receptacle is widened, and the demonstration is begun again.

    Raises:
        FileError: the trial contradicts itself.
    """
    widened: dict[str, float] = {}
    while True:
        scene = build(trial, facts, widened=widened)
        world = EmbeddedWorld(scene, visibilityDistance=REACH_M, fieldOfView=FOV_DEG)
        full = _first_full(world, trial)
        if full is None or widened.get(full, 1.0) >= _WIDEST:
            return scene
        widened[full] = widened.get(full, 1.0) * _WIDER


def _first_full(world: EmbeddedWorld, trial: Trial) -> str | None:
    """Return the first receptacle of a demonstration in which there is no room."""
    tally = _Tally(strict=False)
    for number, low in enumerate(trial.plan.low_actions):
        try:
            _act(world, low.api_action, number, tally)
        except _Mismatch as found:
            return low.api_action.receptacle_object_id if _NO_ROOM in found.reason else None
    return None


# ----------------------------------------------------------------- one replay


@dataclass(slots=True)
class _Tally:
    """What is counted along the way."""

    strict: bool
    handled: int = 0
    unseen: int = 0


def _follow(
    world: EmbeddedWorld, trial: Trial, actions: Sequence[LowAction], tally: _Tally
) -> None:
    """Do the actions and check; raises _Mismatch at the first thing that is not as it was."""
    deeds = Deeds()
    if goal_met(trial, world.last_event.metadata, deeds, exact=True):
        raise _Mismatch("the goal is met at the start", None)
    waiting = list(trial.plan.high_pddl)
    for number, low in enumerate(actions):
        while waiting and waiting[0].high_idx < low.high_idx:
            _check_arrival(world, waiting.pop(0), number)
        name, target = _act(world, low.api_action, number, tally)
        if noteworthy(name, target):
            deeds.note(name, target, world.last_event.metadata)
    for goal in waiting:
        _check_arrival(world, goal, len(actions))
    if not goal_met(trial, world.last_event.metadata, deeds):
        raise _Mismatch("the goal is not met at the end", len(actions))


def _act(world: EmbeddedWorld, given: ApiAction, number: int, tally: _Tally) -> tuple[str, str]:
    """Do one action; return its name and its object, "" if it has none."""
    state = world.state
    try:
        name, arguments = translated(given, held=state.held, present=state.objects)
        target = str(arguments.get("objectId", ""))
        tally.handled += bool(target)
        event = world.step(name, **arguments)
        if not event.success and target and _only_hidden(world, target):
            tally.unseen += 1
            if not tally.strict:
                event = world.step(name, **{**arguments, "forceAction": True})
    except (UntranslatableError, ValueError) as error:
        raise _Mismatch(f"{given.action}: {error}", number) from error
    if not event.success:
        raise _Mismatch(f"{name} {target}: {event.message}", number)
    return name, target


def _only_hidden(world: EmbeddedWorld, object_id: str) -> bool:
    """Return whether an object is there and not shut in, but not to be handled by sight."""
    state = world.state
    if object_id not in state.objects or object_id in state.sight.interactable:
        return False
    return not hidden_rows(state.objects)[state.objects.rows[object_id]]


def _check_arrival(world: EmbeddedWorld, goal: HighLevelStep, number: int) -> None:
    """Compare the agent with where a GotoLocation should have taken it."""
    wanted = goal.planner_action.pose
    if goal.planner_action.action != "GotoLocation" or wanted is None:
        return
    pose = world.state.pose
    x, _, z = pose.position_m
    here = (x / _CELL_M, z / _CELL_M, pose.yaw_deg / _TURN_DEG, pose.horizon_deg)
    if any(abs(a - b) > _NEAR for a, b in zip(here, wanted, strict=True)):
        shown = "|".join(f"{value:g}" for value in here)
        reason = f"is at loc|{shown}, the planner's {goal.planner_action.location}"
        raise _Mismatch(reason, number)


def without_one(trial: Trial, seed: int) -> tuple[tuple[LowAction, ...], int | None]:
    """Return a trial's actions but one drawn by lot, and which it was.

    Each trial has a stream of its own, so the draw does not depend on which others are replayed.
    A trial without actions is returned as it is, with None.
    """
    actions = trial.plan.low_actions
    if not actions:
        return actions, None
    left_out = int(stream(seed, "alfred", "mutate", trial.id).integers(len(actions)))
    return (*actions[:left_out], *actions[left_out + 1 :]), left_out
