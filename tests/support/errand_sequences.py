"""Three errands in a row in one of our rooms, drawn, and done with memory and without.

What is to be so is given, and the expert's program is made of it
(`karma/agent/planning/goal_lines.py`), so that rows differ by memory alone. The room judges.
"""

import tempfile
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from shutil import copytree
from typing import Any

from karma.agent.loading.models import Models, load_resources
from karma.agent.planning.program import WAYS
from karma.agent.planning.prompt import GOALS
from karma.agent.tour import explore_room
from karma.assistant.agent import Agent
from karma.household.containment import goes_in, has_door
from karma.household.ids import short_type, type_of
from karma.household.saying import name_of, told_place
from karma.household.types import object_types, types_with
from karma.household.uses import BASIN_OF
from karma.seeds import stream
from karma.types.completion import Completion, Decoding
from karma.types.events import SkillResult
from karma.types.planning import Prompt
from karma.types.roles import Resources
from karma.types.space import SceneRef
from karma.world.sim import EmbeddedWorld

SCENES = [
    f"{kind}_{n}" for n in (1, 2, 3, 4) for kind in ("kitchen", "living", "bedroom", "bathroom")
]
ROWS: Mapping[str, Mapping[str, Any]] = {  # options of the agent
    "memory": {},
    "home": {},
    "map only": {"short_term": False},
    "neither": {"short_term": False, "long_term": False},
}
CARRIED = types_with("pickupable")
NOWHERE = ("Floor", "Toilet")  # nothing is put there


@dataclass(frozen=True, slots=True, kw_only=True)
class Errand:
    """What is said, and what is to be so afterwards."""

    text: str
    lines: Mapping[str, str]  # request -> the answer of the planner
    thing: str
    place: str = ""  # type; "": it cannot be, or it is to be in the hand


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawn:
    """Three errands in a room."""

    number: int
    scene: str
    kind: str
    errands: Sequence[Errand]


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """What an errand took: places searched, actions of the world, lines that came to nothing."""

    results: tuple[SkillResult, ...]
    right: bool

    @property
    def places(self) -> int:
        return sum(one.explorations for one in self.results)

    @property
    def steps(self) -> int:
        return sum(one.actions for one in self.results)

    @property
    def refused(self) -> int:
        return sum(not one.ok for one in self.results)

    @property
    def finding(self) -> int:
        """Return the actions until the robot stood before the things that it was to carry."""
        return sum(
            one.actions
            for one in self.results
            if one.call.skill in WAYS and short_type(type_of(one.call.objects[-1])) in CARRIED
        )


# ----------------------------------------------------------------- what is drawn


class Room:
    """What a sequence may be about: things of which there is one, and where each of them goes."""

    def __init__(self, scene: str, number: int) -> None:
        world = EmbeddedWorld()
        objects = world.reset(scene).metadata["objects"]
        count = Counter(one["objectType"] for one in objects)
        self._rng, self.rules = stream(number, "short term", scene), world.state.room.rules
        self.here, movable = set(count), {o["objectType"] for o in objects if o["pickupable"]}
        self.things = sorted(kind for kind in movable if count[kind] == 1)
        self.fixed = {one["objectType"] for one in objects if one["receptacle"]} - movable
        self.places = sorted(self.fixed - {*NOWHERE, *BASIN_OF.values()})

    def one(self, kinds: Sequence[str]) -> str:
        """Draw one of some types."""
        if not kinds:
            raise LookupError
        return kinds[int(self._rng.integers(len(kinds)))]

    def thing(self, *but: str, fits: Callable[[str], bool] = lambda kind: True) -> str:
        """Draw a thing that is none of some."""
        return self.one([one for one in self.things if one not in but and fits(one)])

    def two(self, fits: Callable[[str], bool] = lambda kind: True) -> tuple[str, str]:
        """Draw a thing of some, and any other."""
        return (thing := self.thing(fits=fits)), self.thing(thing)

    def place(self, thing: str, *but: str, doors: bool = False) -> str:
        """Draw a place that takes a thing, behind a door or open."""
        fits = (one for one in self.places if one not in but and has_door(one) == doors)
        return self.one([one for one in fits if goes_in(thing, one, self.rules)])

    def vessel(self, *, doors: bool = False) -> tuple[str, str]:
        """Draw a vessel that goes somewhere, and a thing that goes in it."""
        places = [one for one in self.places if has_door(one) == doors]
        vessel = self.thing(
            fits=lambda one: (
                object_types()[one].can("receptacle")
                and not object_types()[one].can("openable")
                and any(goes_in(one, place, self.rules) for place in places)
            )
        )
        return vessel, self.thing(vessel, fits=lambda one: goes_in(one, vessel, self.rules))


def put(thing: str, place: str, *, can_be: bool = True) -> Errand:
    """Return the errand that puts a thing somewhere."""
    text = f"put the {name_of(thing)} {told_place(place)}"
    lines = {text: f"Put(robot, '{thing}', '{place}')"}
    return Errand(text=text, lines=lines, thing=thing, place=place if can_be else "")


def _then(room: Room, first: Errand, other: str, *but: str) -> list[Errand]:
    """Return an errand, one with another thing, and the first thing put somewhere else."""
    return [first, put(other, room.place(other)), put(first.thing, room.place(first.thing, *but))]


def _moved(room: Room) -> list[Errand]:
    thing, other = room.two()
    return _then(room, put(thing, to := room.place(thing)), other, to)


def _shut_away(room: Room) -> list[Errand]:
    thing, other = room.two(lambda one: any(has_door(p) and goes_in(one, p) for p in room.places))
    return _then(room, put(thing, room.place(thing, doors=True)), other)


def _carried(room: Room, *, doors: bool = False) -> list[Errand]:
    vessel, thing = room.vessel(doors=doors)
    to = room.place(vessel, doors=doors)
    return [put(thing, vessel), put(vessel, to), put(thing, room.place(thing, to))]


def _carried_behind_a_door(room: Room) -> list[Errand]:
    return _carried(room, doors=True)


def _carried_and_left(room: Room) -> list[Errand]:
    vessel, thing = room.vessel()
    to, other = room.place(vessel), room.thing(vessel, thing)
    one, more = put(vessel, to), put(other, room.place(other, to))
    both = replace(one, text=f"{one.text} and {more.text}", lines={**one.lines, **more.lines})
    return [put(thing, vessel), both, put(thing, room.place(thing, to))]  # `both` by the vessel


def _full_hand(room: Room) -> list[Errand]:
    held, other = room.two()
    text = f"take the {name_of(held)}"
    hold = Errand(text=text, lines={text: f"Hold(robot, '{held}')"}, thing=held)
    return _then(room, hold, other)


def _does_not_fit(room: Room) -> list[Errand]:
    thing, kinds = room.thing(), object_types()
    never = [
        one for one in (*room.places, *room.things)
        if one != thing and kinds[one].can("receptacle") and not goes_in(thing, one, room.rules)
    ]  # fmt: skip
    other = room.thing(thing)
    return _then(room, put(thing, room.one(never), can_be=False), other)


def _not_there(room: Room) -> list[Errand]:
    absent = [
        one for one in sorted(CARRIED - room.here) if any(goes_in(one, p) for p in room.places)
    ]  # fmt: skip
    missing, thing = room.one(absent), room.thing()
    to, nowhere = room.place(thing), next(p for p in room.places if goes_in(missing, p))
    again = put(thing, room.place(thing, to))
    return [put(thing, to), put(missing, nowhere, can_be=False), again]


KINDS: Mapping[str, Callable[[Room], list[Errand]]] = {
    "moved": _moved,
    "shut away": _shut_away,
    "carried": _carried,
    "carried behind a door": _carried_behind_a_door,
    "carried and left": _carried_and_left,
    "full hand": _full_hand,
    "does not fit": _does_not_fit,
    "not there": _not_there,
}


def drawn(number: int) -> Drawn:
    """Draw a sequence; where a room has nothing for it, the next room is taken."""
    kind = list(KINDS)[number % len(KINDS)]
    for more in range(len(SCENES)):
        scene = SCENES[(number // len(KINDS) + number + more) % len(SCENES)]
        try:
            errands = KINDS[kind](Room(scene, number))
        except (LookupError, StopIteration):
            continue
        return Drawn(number=number, scene=scene, kind=kind, errands=errands)
    raise AssertionError(kind)


# ----------------------------------------------------------------- what is done


class Given:
    """A planner that says what it is told to, however often it is asked."""

    name = "given"
    lines: Mapping[str, str]

    def complete(self, prompt: Prompt, **_: Any) -> Completion:
        """Return the line for the request that the prompt ends with."""
        asked = max(self.lines, key=(prompt.stable + prompt.changing).rfind)
        return Completion(
            text=f"{self.lines[asked]}\n", finish="stop", prompt_tokens=0, reused_tokens=0,
            completion_tokens=0, first_token_s=None, total_s=0.0,
        )  # fmt: skip


def given_planner(maps: Path) -> Resources:
    """Return the models of a run, with a planner that is told what to say, and maps of rooms."""
    loaded = load_resources(Models(), maps=None, seed=0, learn=True)
    return replace(
        loaded, model=Given(), profile=GOALS, decoding=Decoding(),
        reader=None, examples=None, maps=maps,
    )  # fmt: skip


def done(sequence: Drawn, row: str, resources: Resources) -> list[Cost]:
    """Do the errands of a sequence in one row, with the planner that is told."""
    found: list[Cost] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        maps = copytree(first_map(sequence.scene, resources.maps), folder / "maps")
        home = folder / "home" if row == "home" else None
        agent = None
        for number, errand in enumerate(sequence.errands):
            if agent is None or home is not None:
                agent = Agent(
                    "" if number else sequence.scene, resources=replace(resources, maps=maps),
                    folder=folder / str(number), maps=maps, home=home,
                    options=ROWS[row],
                )  # fmt: skip
            resources.model.lines = errand.lines
            parts = agent.do(errand.text).parts
            at = type_of(place_of(agent, errand.thing) or "")
            found.append(
                Cost(
                    results=tuple(result for part in parts for result in part.results),
                    right=not errand.place or at in (errand.place, BASIN_OF.get(errand.place)),
                )
            )
            if home is not None:
                agent.home.leave()
    return found


def first_map(scene: str, maps: Path) -> Path:
    """Return the folder of a room's map as it is after the first visit."""
    folder = maps / scene
    if not folder.exists():
        world = EmbeddedWorld()
        world.reset(scene)
        graph, _ = explore_room(world, SceneRef.of(scene), None)
        folder.mkdir(parents=True)
        graph.save(folder / f"{scene}.json")
    return folder


def place_of(agent: Agent, kind: str) -> str | None:
    """Return the id of what the one thing of a type lies in, by the room itself."""
    objects = agent._world.last_event.metadata["objects"]
    found = next((one for one in objects if one["objectType"] == kind), None)
    return next(iter((found and found["parentReceptacles"]) or ()), None)


# ----------------------------------------------------------------- what memory cost


def difference(what: str, some: Sequence[Cost], others: Sequence[Cost]) -> int:
    """Return how much more of something a row took than another."""
    return sum(getattr(one, what) for one in some) - sum(getattr(one, what) for one in others)


def cheaper(some: Sequence[Cost], others: Sequence[Cost]) -> int:
    """Return 1 if a row took less than another of places or steps and more of none, -1 if more."""
    more = [difference(what, some, others) for what in ("places", "steps")]
    return -1 if max(more) > 0 else int(min(more) < 0)


def explained(mine: Sequence[Cost], others: Sequence[Cost]) -> bool:
    """Return whether memory took more steps by the way alone.

    In no errand a line more came to nothing, as it does where a belief is wrong, or a place more
    was searched; and in all it took no more steps to stand before the things asked for. What is
    left are ways onward from there, which a search may have ended nearer to by luck.
    """
    pairs = list(zip(mine, others, strict=True))
    return (
        all(one.refused <= other.refused and one.places <= other.places for one, other in pairs)
        and difference("finding", mine, others) <= 0
    )
