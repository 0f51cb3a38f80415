"""Logged actions done again in the embedded world: where the agent stood and what it saw.

Where the things were that unmet goals ask for is told by the world's truth, not by memory.
"""

from collections.abc import Callable, Collection, Hashable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, cast, get_args

from karma.agent.goals.goals import alternatives, object_names, parse_goal
from karma.agent.goals.objects import ObjectIndex
from karma.agent.seeing.perceive import truth_of
from karma.bench.report.html import Frames
from karma.bench.report.story import EpisodeStory, Moment
from karma.contracts import Event, TrueObject, Vec3
from karma.errors import KarmaError
from karma.household.ids import type_of
from karma.household.places import FLOOR
from karma.world.core.state import WorldState
from karma.world.home import Home
from karma.world.sim import EmbeddedWorld

MOST = 8  # things that are told of one name


@dataclass(frozen=True, slots=True, kw_only=True)
class WantedThing:
    """One thing that a name covers, at one moment."""

    object_id: str
    where: str  # what it is in or on, from the inside out; "in the hand"
    states: tuple[str, ...]
    x_m: float
    z_m: float
    loose: bool  # can be carried


@dataclass(frozen=True, slots=True, kw_only=True)
class WantedName:
    """One name in unmet goals, and what it covers in the room."""

    name: str
    things: tuple[WantedThing, ...]  # at most `MOST`, those that can be carried first
    count: int  # of all


def names_in(goals: Sequence[str]) -> tuple[str, ...]:
    """Return the names of objects in goals, each once; none of a goal that cannot be read."""
    found: dict[str, None] = {}
    for text in goals:
        try:
            found.update(dict.fromkeys(object_names(parse_goal(text))))
        except KarmaError:
            continue  # of somebody else's benchmark
    return tuple(found)


def wanted_in(event: Event, names: Sequence[str]) -> tuple[WantedName, ...]:
    """Return for each name what it covers after an event."""
    index = ObjectIndex(truth_of(event))
    return tuple(_wanted(name, index) for name in names)


def _wanted(name: str, index: ObjectIndex) -> WantedName:
    found = sorted(
        index.named(alternatives(name)), key=lambda one: (not one.pickupable, one.object_id)
    )
    things = tuple(_thing(one, index) for one in found[:MOST])
    return WantedName(name=name, things=things, count=len(found))


def _thing(one: TrueObject, index: ObjectIndex) -> WantedThing:
    x, _, z = one.box_center_m
    return WantedThing(
        object_id=one.object_id,
        where=_where(one, index),
        states=one.states,
        x_m=round(x, 2),
        z_m=round(z, 2),
        loose=one.pickupable,
    )


def _where(one: TrueObject, index: ObjectIndex) -> str:
    """Return what a thing is in or on, and what that is in or on: "Bowl, Fridge (closed)"."""
    if one.object_id in index.held:
        return "in the hand"
    words, seen, here = [], {one.object_id}, one
    while parents := [p for p in here.parent_ids if p in index.by_id and p not in seen]:
        here = index.by_id[parents[0]]
        seen.add(here.object_id)
        if here.object_id in index.held:
            words.append(f"{type_of(here.object_id)} in the hand")
            break
        if words and here.object_type == FLOOR:
            break
        state = [word for word in ("closed", "opened") if word in here.states]
        words.append(type_of(here.object_id) + (f" ({state[0]})" if state else ""))
    return "at " + ", ".join(words) if words else ""


FrameChoice = Literal["auto", "every", "calls", "ends", "none"]
LONG, VERY_LONG = 300, 1000  # actions of a page from which on "auto" is "calls", "ends"
BEAT = 50  # moments between two words on how far a replay is
APART = 10  # moments between two pictures, at most, in "calls"
SIZE_PX = 300
_WALKING = (
    "MoveAhead", "MoveBack", "MoveLeft", "MoveRight", "RotateLeft", "RotateRight", "LookUp",
    "LookDown", "Pass", "Done", "Teleport", "TeleportFull", "Stand", "Crouch",
)  # fmt: skip


def frame_choice(text: str) -> FrameChoice:
    """Return the choice that a word stands for; KarmaError where it is none."""
    if text in get_args(FrameChoice):
        return cast(FrameChoice, text)
    raise KarmaError(f"--frames {text!r}\n  To fix: {', '.join(get_args(FrameChoice))}")


class Rooms(Home):
    """The rooms of one episode's home; `place` returns where the scene of a name lies."""

    def __init__(self, place: Callable[[str], str] = str) -> None:
        super().__init__(lambda: EmbeddedWorld(width=SIZE_PX, height=SIZE_PX))
        self._place = place

    def enter(self, scene: str) -> Event:
        """Go into a room; FileError where there is no such scene, or it is damaged."""
        return super().enter(self._place(scene))

    @property
    def state(self) -> WorldState:
        """The room that the agent is in."""
        room = self._room()
        assert isinstance(room, EmbeddedWorld)
        return room.state


@dataclass(frozen=True, slots=True, kw_only=True)
class Sight:
    """The world after one moment."""

    x_m: float
    z_m: float
    yaw_deg: float
    held: str | None  # object id
    targets: tuple[tuple[float, float], ...] = ()  # x, z of what a skill call was about
    frame: int = -1  # number of the picture, the last one that there is; -1 before any
    wanted: tuple[
        WantedName, ...
    ] = ()  # what the instruction's unmet goals ask for, after each call


@dataclass(frozen=True, slots=True, kw_only=True)
class Replay:
    """One story with what was to be seen."""

    sights: tuple[Sight, ...]  # one a moment, up to the last that is shown
    actions: int  # replayed
    differing: tuple[int, ...]  # numbers of the moments whose action did not go as logged


def replaying(
    story: EpisodeStory,
    rooms: Rooms,
    frames: Frames,
    choice: FrameChoice,
    shown: Collection[int] | None = None,
    goals: Sequence[Sequence[str]] = (),
) -> Iterator[float | Replay]:
    """Do a story's actions again, exactly as logged, up to the last instruction that is shown.

    Yields now and then the share that is done, in [0, 1], and at last the replay.

    Pictures are taken after "every" action; after those that do more than walk, at the end of
    "calls", and now and then between; at the "ends" of calls only; or "none"; and only in the
    instructions that are shown. Goals are needed where the log breaks off before it judges them.

    Raises:
        FileError: a scene is missing or damaged.
    """
    parts = set(range(-1, len(story.parts)) if shown is None else (-1, *shown))
    last_part = max(parts)
    moments = [moment for moment in story.moments if moment.part <= last_part]
    sights: list[Sight] = []
    differing: list[int] = []
    seen: WorldState | None = None
    frame, last = -1, 0
    rooms.enter(story.scene)
    sought = _Sought(story, goals)
    for number, moment in enumerate(moments):
        if number % BEAT == 0:
            yield number / len(moments)
        if not _happens(rooms, moment):
            differing.append(number)
        here = moment.part in parts
        if here and rooms.state is not seen and _is_pictured(moment, choice, number - last):
            frame = frames.of(_looks(rooms.state), lambda: rooms.last_event.frame)
            seen, last = rooms.state, number
        wanted = sought.at(rooms, moment) if here else ()
        pose, held = rooms.state.pose, rooms.state.held
        sights.append(
            Sight(
                x_m=round(pose.position_m[0], 3), z_m=round(pose.position_m[2], 3),
                yaw_deg=round(pose.yaw_deg, 1), held=held,
                targets=_targets(rooms.state, moment, story), frame=frame, wanted=wanted,
            )
        )  # fmt: skip
    actions = sum(moment.action is not None for moment in moments)
    yield Replay(sights=tuple(sights), actions=actions, differing=tuple(differing))


class _Sought:
    """What unmet goals ask for, looked up again at what is no action and after something moved."""

    def __init__(self, story: EpisodeStory, goals: Sequence[Sequence[str]]) -> None:
        unjudged = [*goals, *[()] * len(story.parts)]
        self._names = [
            names_in(unjudged[number] if part.after is None else part.unmet)
            for number, part in enumerate(story.parts)
        ]
        self._part = -1
        self._objects: object = None  # that were looked at
        self._found: tuple[WantedName, ...] = ()

    def at(self, rooms: Rooms, moment: Moment) -> tuple[WantedName, ...]:
        """Return it after a moment; after an action, as it was before it."""
        names = self._names[moment.part] if moment.part >= 0 and moment.kind != "enter" else ()
        objects = rooms.state.objects if names else None
        is_new = moment.part != self._part
        if is_new or (moment.action is None and objects is not self._objects):
            self._found = wanted_in(rooms.last_event, names) if names else ()
            self._part, self._objects = moment.part, objects
        return self._found


def _looks(state: WorldState) -> Hashable:
    """Return all that decides what the agent sees; equal in episodes that have come to the same."""
    objects = tuple(state.objects.values())
    hand = (state.held, state.hand_m, state.hand_turn_deg)
    return state.room.name, state.pose, hand, objects


def automatic(actions: int) -> FrameChoice:
    """Return the first choice that does not get too much for a page of so many actions."""
    if actions < LONG:
        return "every"
    return "calls" if actions < VERY_LONG else "ends"


def _happens(rooms: Rooms, moment: Moment) -> bool:
    """Do a moment's action, or go to its room; returns whether it went as logged."""
    if moment.kind == "enter":
        rooms.enter(moment.text)
    if moment.action is None:
        return True
    try:
        event = rooms.step(moment.action.action, **moment.action.arguments)
    except ValueError:  # misuse; the event says so, and the log too
        return not moment.ok
    return bool(event) == moment.ok


def _is_pictured(moment: Moment, choice: FrameChoice, since: int) -> bool:
    if choice == "none":
        return False
    if choice == "every" or moment.action is None:
        return True
    if choice == "ends":
        return False
    return since >= APART or moment.action.action not in _WALKING


def _targets(
    state: WorldState, moment: Moment, story: EpisodeStory
) -> tuple[tuple[float, float], ...]:
    """Return where the things are that the moment's skill call was about."""
    if moment.call < 0:
        return ()
    ids = story.parts[moment.part].calls[moment.call].object_ids
    centers: list[Vec3] = [state.objects[one].center for one in ids if one in state.objects]
    return tuple((round(x, 2), round(z, 2)) for x, _, z in centers)
