"""Logged actions done again in the embedded world: where the agent stood and what it saw."""

from dataclasses import dataclass
from typing import Literal, cast, get_args

from karma.contracts import Vec3
from karma.errors import KarmaError
from karma.report.frames import Frames
from karma.report.story import Moment, Story
from karma.world.sim import EmbeddedWorld
from karma.world.state import WorldState

FrameChoice = Literal["auto", "every", "calls", "none"]
LONG = 300  # actions of an episode from which on "auto" is "calls"
APART = 10  # moments between two pictures, at most, in "calls"
SIZE_PX = 300
_WALKING = (
    "MoveAhead", "MoveBack", "MoveLeft", "MoveRight", "RotateLeft", "RotateRight", "LookUp",
    "LookDown", "Pass", "Done", "Teleport", "TeleportFull", "Stand", "Crouch",
)  # fmt: skip


def frame_choice(text: str) -> FrameChoice:
    """Return the choice that a word stands for.

    Raises:
        KarmaError: it is none.
    """
    for known in get_args(FrameChoice):
        if text == known:
            return cast(FrameChoice, known)
    raise KarmaError(f"--frames {text!r}\n  To fix: {', '.join(get_args(FrameChoice))}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Sight:
    """The world after one moment."""

    x_m: float
    z_m: float
    yaw_deg: float
    held: str | None  # object id
    targets: tuple[tuple[float, float], ...] = ()  # x, z of what a skill call was about
    frame: int = -1  # number of the picture, the last one that there is; -1 before any


@dataclass(frozen=True, slots=True, kw_only=True)
class Replay:
    """One story with what was to be seen."""

    sights: tuple[Sight, ...]  # one a moment
    actions: int  # replayed
    differing: tuple[int, ...]  # numbers of the moments whose action did not go as logged


def replay(story: Story, world: EmbeddedWorld, frames: Frames, choice: FrameChoice) -> Replay:
    """Do a story's actions again, exactly as logged.

    Args:
        story: what happened.
        world: where; at the episode's start.
        frames: takes the pictures.
        choice: a picture after "every" action; after those that do more than walk, at the end of
            "calls", and now and then between; or "none". "auto" is "every" in an episode that is
            not long.
    """
    if choice == "auto":
        choice = "calls" if _actions(story) >= LONG else "every"
    sights: list[Sight] = []
    differing: list[int] = []
    seen: WorldState | None = None
    frame, last = -1, 0
    for number, moment in enumerate(story.moments):
        if not _happens(world, moment):
            differing.append(number)
        if world.state is not seen and _wanted(moment, choice, number - last):
            picture = world.last_event.frame
            frame = frame if picture is None else frames.add(picture)
            seen, last = world.state, number
        sights.append(_sight(world.state, moment, story, frame))
    return Replay(sights=tuple(sights), actions=_actions(story), differing=tuple(differing))


def _actions(story: Story) -> int:
    return sum(moment.action is not None for moment in story.moments)


def _happens(world: EmbeddedWorld, moment: Moment) -> bool:
    """Do a moment's action, if it has one; returns whether it went as logged."""
    if moment.action is None:
        return True
    try:
        event = world.step(moment.action.action, **moment.action.arguments)
    except ValueError:  # misuse; the event says so, and the log too
        return not moment.ok
    return bool(event) == moment.ok


def _wanted(moment: Moment, choice: FrameChoice, since: int) -> bool:
    if choice == "none":
        return False
    if choice == "every" or moment.action is None or since >= APART:
        return True
    return moment.action.action not in _WALKING


def _sight(state: WorldState, moment: Moment, story: Story, frame: int) -> Sight:
    x, _, z = state.pose.position_m
    return Sight(
        x_m=round(x, 3),
        z_m=round(z, 3),
        yaw_deg=round(state.pose.yaw_deg, 1),
        held=state.held,
        targets=_targets(state, moment, story),
        frame=frame,
    )


def _targets(state: WorldState, moment: Moment, story: Story) -> tuple[tuple[float, float], ...]:
    """Return where the things are that the moment's skill call was about."""
    if moment.call < 0:
        return ()
    ids = story.parts[moment.part].calls[moment.call].object_ids
    centers: list[Vec3] = [state.objects[one].center for one in ids if one in state.objects]
    return tuple((round(x, 2), round(z, 2)) for x, _, z in centers)
