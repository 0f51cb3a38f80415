"""What short-term memory saves over sequences of errands, and whether it ever costs anything.

    python scripts/measure_short_term.py [--only 13 117] [--lines] [--rows memory "map only"]
    python scripts/measure_short_term.py --tasks eval/alfred_l/tasks.jsonl

Three errands in a row in one of our 16 rooms: things are put somewhere, shut away, carried off in a
vessel, refused, and asked for again. What is to be so is given, and the expert's program is made of
it (`karma/agent/goal_lines.py`), so that rows differ by memory alone. The room judges. Rows:

    memory      short-term memory and the map
    home        the same, kept on the disk and read again before each errand
    map only    the map alone
    neither     no memory at all

With `--tasks` the rows are held against each other on written tasks, whose programs the planner
writes.
"""

import argparse
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from shutil import copytree
from typing import Any

import msgspec
from rich.progress import track

from karma import Agent
from karma.agent.perceive import digest_of
from karma.agent.program import WAYS
from karma.agent.prompt import GOALS
from karma.bench.episode import run_episode
from karma.contracts import (
    Completion,
    Decoding,
    MemoryChange,
    Outcome,
    Plan,
    Prompt,
    Resources,
    SceneRef,
    SkillResult,
    SubTask,
    World,
)
from karma.files import to_json
from karma.household.containment import goes_in, has_door
from karma.household.ids import short_type, type_of
from karma.household.saying import name_of, told_place
from karma.household.types import object_types, types_with
from karma.household.uses import BASIN_OF
from karma.loading.models import Models, load_resources
from karma.methods.karma import KarmaMethod
from karma.methods.tour import explore_room
from karma.offline import go_offline
from karma.seeds import stream
from karma.talk.replies import AgentReply
from karma.tasks.files import load_tasks
from karma.world.sim import EmbeddedWorld

SCENES = [
    f"{kind}_{n}" for n in (1, 2, 3, 4) for kind in ("kitchen", "living", "bedroom", "bathroom")
]
ROWS: Mapping[str, Mapping[str, Any]] = {
    "memory": {},
    "home": {},
    "map only": {"short_term": False},
    "neither": {"short_term": False, "long_term": False},
}
MAPS = Path("runs/maps-short")  # of the rooms as after the first visit
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
    errands: tuple[Errand, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """What an errand took."""

    results: tuple[SkillResult, ...]
    right: bool

    @property
    def places(self) -> int:
        """Return how many places were searched."""
        return sum(one.explorations for one in self.results)

    @property
    def steps(self) -> int:
        """Return how many actions of the world were done."""
        return sum(one.actions for one in self.results)

    @property
    def refused(self) -> int:
        """Return how many lines came to nothing."""
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
    """What sequences may be about: things of which there is one, and where each of them goes.

    Args:
        scene: name.
        number: of the sequence, for its random stream.
    """

    def __init__(self, scene: str, number: int) -> None:
        world = EmbeddedWorld()
        objects = world.reset(scene).metadata["objects"]
        self.rules = world.state.room.rules
        self._rng = stream(number, "short term", scene)
        count = Counter(one["objectType"] for one in objects)
        basins = BASIN_OF.values()
        self.here = set(count)
        self.things = sorted(
            one["objectType"] for one in objects
            if one["pickupable"] and count[one["objectType"]] == 1
        )  # fmt: skip
        self.places = sorted(
            {one["objectType"] for one in objects if one["receptacle"] and not one["pickupable"]}
            - {*NOWHERE, *basins}
        )

    def one(self, kinds: Sequence[str]) -> str:
        """Draw one of some types."""
        if not kinds:
            raise LookupError
        return kinds[int(self._rng.integers(len(kinds)))]

    def thing(self, *but: str, fits: Callable[[str], bool] = lambda kind: True) -> str:
        """Draw a thing that is none of some."""
        return self.one([one for one in self.things if one not in but and fits(one)])

    def place(self, thing: str, *but: str, doors: bool = False) -> str:
        """Draw a place that takes a thing, behind a door or open."""
        fits = (one for one in self.places if one not in but and has_door(one) == doors)
        return self.one([one for one in fits if goes_in(thing, one, self.rules)])

    def vessel(self, *, doors: bool = False) -> tuple[str, str]:
        """Draw a vessel that goes somewhere, and a thing that goes in it."""
        vessels = [
            one for one in self.things
            if object_types()[one].can("receptacle") and not object_types()[one].can("openable")
            and any(goes_in(one, p, self.rules) for p in self.places if has_door(p) == doors)
        ]  # fmt: skip
        vessel = self.one(vessels)
        return vessel, self.thing(vessel, fits=lambda one: goes_in(one, vessel, self.rules))


def put(thing: str, place: str, *, can_be: bool = True) -> Errand:
    """Return the errand that puts a thing somewhere."""
    text = f"put the {name_of(thing)} {told_place(place)}"
    return Errand(
        text=text,
        lines={text: f"Put(robot, '{thing}', '{place}')"},
        thing=thing,
        place=place if can_be else "",
    )


def _and(one: Errand, other: Errand) -> Errand:
    """Return two errands said in one sentence; it is judged by the first."""
    return replace(
        one, text=f"{one.text} and {other.text}", lines={**one.lines, **other.lines}
    )  # fmt: skip


def _moved(room: Room) -> list[Errand]:
    first, other = (thing := room.thing()), room.thing(thing)
    to = room.place(first)
    return [put(first, to), put(other, room.place(other)), put(first, room.place(first, to))]


def _shut_away(room: Room) -> list[Errand]:
    thing = room.thing(fits=lambda one: any(has_door(p) and goes_in(one, p) for p in room.places))
    other = room.thing(thing)
    to = room.place(thing, doors=True)
    return [put(thing, to), put(other, room.place(other)), put(thing, room.place(thing))]


def _carried(room: Room, *, doors: bool = False) -> list[Errand]:
    vessel, thing = room.vessel(doors=doors)
    to = room.place(vessel, doors=doors)
    return [put(thing, vessel), put(vessel, to), put(thing, room.place(thing, to))]


def _carried_behind_a_door(room: Room) -> list[Errand]:
    return _carried(room, doors=True)


def _carried_and_left(room: Room) -> list[Errand]:
    vessel, thing = room.vessel()
    to, other = room.place(vessel), room.thing(vessel, thing)
    both = put(vessel, to), put(other, room.place(other, to))
    return [put(thing, vessel), _and(*both), put(thing, room.place(thing, to))]


def _full_hand(room: Room) -> list[Errand]:
    held, other = (thing := room.thing()), room.thing(thing)
    text = f"take the {name_of(held)}"
    hold = Errand(text=text, lines={text: f"Hold(robot, '{held}')"}, thing=held)
    return [hold, put(other, room.place(other)), put(held, room.place(held))]


def _does_not_fit(room: Room) -> list[Errand]:
    thing = room.thing()
    never = [
        one
        for one in (*room.places, *room.things)
        if one != thing
        and object_types()[one].can("receptacle")
        and not goes_in(thing, one, room.rules)
    ]
    other = room.thing(thing)
    return [
        put(thing, room.one(never), can_be=False),
        put(other, room.place(other)),
        put(thing, room.place(thing)),
    ]


def _not_there(room: Room) -> list[Errand]:
    kinds = object_types()
    absent = [
        one
        for one, kind in kinds.items()
        if kind.can("pickupable")
        and one not in room.here
        and any(goes_in(one, p) for p in room.places)
    ]
    missing, thing = room.one(sorted(absent)), room.thing()
    to = room.place(thing)
    nowhere = next(p for p in room.places if goes_in(missing, p))
    return [
        put(thing, to), put(missing, nowhere, can_be=False), put(thing, room.place(thing, to)),
    ]  # fmt: skip


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
        return Drawn(number=number, scene=scene, kind=kind, errands=tuple(errands))
    raise AssertionError(kind)


# ----------------------------------------------------------------- what is done


class Given:
    """A planner that says what it is told to, however often it is asked."""

    name = "given"

    def __init__(self) -> None:
        self.lines: Mapping[str, str] = {}

    def complete(self, prompt: Prompt, **_: Any) -> Completion:
        """Return the line for the request that the prompt ends with."""
        asked = max(self.lines, key=(prompt.stable + prompt.changing).rfind)
        return Completion(
            text=f"{self.lines[asked]}\n", finish="stop", prompt_tokens=0, reused_tokens=0,
            completion_tokens=0, first_token_s=None, total_s=0.0,
        )  # fmt: skip


def given_planner(models: Models | None = None) -> Resources:
    """Return the models of a run, with a planner that is told what to say."""
    loaded = load_resources(models or Models(), maps=None, seed=0, learn=True)
    return replace(
        loaded, model=Given(), profile=GOALS, decoding=Decoding(),
        hints=None, examples=None, doubt=None,
    )  # fmt: skip


def done(
    sequence: Drawn, row: str, resources: Resources, options: Mapping[str, Any] | None = None
) -> list[Cost]:
    """Do the errands of a sequence in one row.

    Args:
        sequence: three errands.
        row: of `ROWS`.
        resources: with the planner that is told.
        options: of the agent, beside those of the row.
    """
    found: list[Cost] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        loaded = replace(resources, maps=copytree(first_map(sequence.scene), folder / "maps"))
        home = folder / "home" if row == "home" else None
        agent = None
        for number, errand in enumerate(sequence.errands):
            if agent is None or home is not None:
                agent = Agent(
                    "" if number else sequence.scene, resources=loaded, folder=folder / str(number),
                    maps=folder / "maps", home=home,
                    options={"guard": False, **ROWS[row], **(options or {})},
                )  # fmt: skip
            loaded.model.lines = errand.lines  # type: ignore[attr-defined]
            found.append(cost_of(agent.do(errand.text), agent, errand))
            if home is not None:
                agent.home.leave()
    return found


def first_map(scene: str) -> Path:
    """Return the folder of a room's map as it is after the first visit."""
    folder = MAPS / scene
    if not folder.exists():
        world = EmbeddedWorld()
        world.reset(scene)
        graph, _ = explore_room(world, SceneRef.of(scene), None)
        folder.mkdir(parents=True)
        graph.save(folder / f"{scene}.json")
    return folder


def cost_of(reply: AgentReply, agent: Agent, errand: Errand) -> Cost:
    """Return what an errand took, and whether it came true."""
    at = type_of(place_of(agent, errand.thing) or "")
    return Cost(
        results=tuple(one for part in reply.parts for one in part.results),
        right=not errand.place or at in (errand.place, BASIN_OF.get(errand.place)),
    )


def place_of(agent: Agent, kind: str) -> str | None:
    """Return the id of what the one thing of a type lies in, by the room itself."""
    objects = agent._world.last_event.metadata["objects"]
    found = next((one for one in objects if one["objectType"] == kind), None)
    return next(iter((found and found["parentReceptacles"]) or ()), None)


# ----------------------------------------------------------------- what memory cost


def cheaper(some: Sequence[Cost], others: Sequence[Cost]) -> int:
    """Return 1 if a row took less than another of places or steps and more of none, -1 if more."""
    places, steps = (sum(getattr(one, what) for one in some) - sum(getattr(one, what) for one in
                     others) for what in ("places", "steps"))  # fmt: skip
    if places > 0 or steps > 0:
        return -1
    return int(places < 0 or steps < 0)


def explained(mine: Sequence[Cost], others: Sequence[Cost]) -> bool:
    """Return whether memory took more steps by the way alone.

    In no errand a line more came to nothing, as it does where a belief is wrong, or a place more
    was searched; and in all it took no more steps to stand before the things asked for. What is
    left are ways onward from there, which a search may have ended nearer to by luck.
    """
    pairs = list(zip(mine, others, strict=True))
    return (
        all(one.refused <= other.refused and one.places <= other.places for one, other in pairs)
        and sum(one.finding - other.finding for one, other in pairs) <= 0
    )


def told(sequence: Drawn, rows: Mapping[str, Sequence[Cost]], *, lines: bool) -> Iterator[str]:
    """Yield what a sequence came to, with all lines of its programs where that is wanted."""
    texts = "; ".join(one.text for one in sequence.errands)
    yield f"{sequence.number} {sequence.scene}, {sequence.kind}: {texts}"
    for row, costs in rows.items():
        yield f"    {row}: " + "; ".join(f"{one.places} places, {one.steps} steps" for one in costs)
        for one in (result for cost in costs for result in cost.results if lines):
            why = "" if one.ok else f": {one.reason}"
            yield f"        {one.call}, {one.explorations} places, {one.actions} steps{why}"


def table(found: Sequence[Mapping[str, Sequence[Cost]]]) -> Iterator[str]:
    """Yield the sums of all rows, as Markdown."""
    yield "\n| row | errands | right | places searched | steps | cheaper, same, dearer |"
    yield "|---|---|---|---|---|---|"
    for row in found[0]:
        costs = [one for rows in found for one in rows[row]]
        sides = Counter(cheaper(rows[row], rows["map only"]) for rows in found)
        yield (
            f"| {row} | {len(costs)} | {sum(one.right for one in costs)} | "
            f"{sum(one.places for one in costs):,} | {sum(one.steps for one in costs):,} | "
            f"{sides[1]}, {sides[0]}, {sides[-1]} |"
        )


def main() -> None:
    """Do all sequences or tasks in all rows, and print what memory saved and cost."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--sequences", type=int, default=200)
    parser.add_argument("--only", type=int, nargs="*", help="numbers of sequences")
    parser.add_argument("--rows", nargs="*", choices=list(ROWS), default=list(ROWS))
    parser.add_argument("--lines", action="store_true", help="print all that was done")
    parser.add_argument("--tasks", type=Path, help="a file of tasks, in place of sequences")
    parser.add_argument("--planner", default=Models().planner, help="of tasks")
    given = parser.parse_args()
    go_offline()
    if given.tasks is not None:
        on_tasks(given.tasks, given.planner, given.rows)
    else:
        on_sequences(
            [drawn(n) for n in given.only or range(given.sequences)], given.rows, lines=given.lines
        )


def on_sequences(sequences: Sequence[Drawn], names: Sequence[str], *, lines: bool) -> None:
    """Do sequences in all rows; prints those that were dearer with memory, and the sums."""
    resources, found, unexplained = given_planner(), [], 0
    for one in track(sequences, description="sequences"):
        rows = {row: done(one, row, resources) for row in names}
        found.append(rows)
        dear = [row for row in ("memory", "home") if row in rows]
        dear = [row for row in dear if cheaper(rows[row], rows["map only"]) < 0]
        if dear or lines:
            print("\n".join(told(one, rows, lines=lines)), flush=True)
        for row in dear:
            by_the_way = explained(rows[row], rows["map only"])
            unexplained += not by_the_way
            print(f"    {row} is dearer{' by the way alone' if by_the_way else ''}", flush=True)
    print("\n".join(table(found)), f"\n{unexplained} dearer ones are not explained")


# ----------------------------------------------------------------- on written tasks


class Kept:
    """A method whose memory goes to the disk after each instruction, and is read again before."""

    def __init__(self, method: KarmaMethod) -> None:
        self._method, self.name = method, method.name

    def begin(self, world: World, scene: SceneRef, *, seed: int, folder: Path) -> "KeptEpisode":
        """Start an episode."""
        return KeptEpisode(self._method, world, scene, seed, folder)


class KeptEpisode:
    """One sequence of instructions, of which each is another agent's that reads what was kept."""

    def __init__(
        self, method: KarmaMethod, world: World, scene: SceneRef, seed: int, folder: Path
    ) -> None:
        self._world, self._kept = world, folder / "log.jsonl"
        self._begin = lambda: method.begin(world, scene, seed=seed, folder=folder)
        self._begin()  # makes the map
        self._kept.unlink(missing_ok=True)

    def do(self, subtask: SubTask) -> Iterator[Plan | SkillResult | Outcome]:
        """Be an agent that remembers what was kept, and keep what this one learns."""
        before = digest_of(self._world.last_event)
        episode = self._begin()
        assert digest_of(self._world.last_event) == before, "the room was toured again"
        for line in self._kept.read_bytes().splitlines() if self._kept.exists() else ():
            episode.learn(msgspec.json.decode(line, type=MemoryChange))
        yield from episode.do(subtask)
        with self._kept.open("ab") as log:
            log.writelines(map(to_json, episode.changes))


def on_tasks(path: Path, planner: str, rows: Sequence[str]) -> None:
    """Do written tasks in all rows, and print which were solved and what they took."""
    print("| row | solved | places searched | steps | of each kind |\n|---|---|---|---|---|")
    for row in rows:
        solved, sums = Counter[str](), Counter[str]()
        with tempfile.TemporaryDirectory() as name:
            maps = Path(name, "maps")
            resources = load_resources(Models(planner=planner), maps=maps, seed=0)
            method: Any = KarmaMethod.build(resources, ROWS[row])
            method = Kept(method) if row == "home" else method
            for task in track(load_tasks(path), description=row):
                folder = Path(name, task.id)
                folder.mkdir()
                record = run_episode(method, EmbeddedWorld(), task, row=row, seed=0, folder=folder)
                calls = [call for one in record.subtasks for call in one.calls]
                solved[task.kind] += record.success
                sums["places"] += sum(call.explorations for call in calls)
                sums["steps"] += sum(call.actions for call in calls)
        kinds = ", ".join(f"{kind} {count}" for kind, count in solved.items())
        print(f"| {row} | {solved.total()} | {sums['places']:,} | {sums['steps']:,} | {kinds} |",
              flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
