"""Live one home with one memory, day by day, and say what came of every request."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice

from karma.plugins.homes.houses import build_home
from karma.plugins.homes.lived.body import HomeRobot, nearest_next
from karma.plugins.homes.lived.designs import DESIGNS, NoMemory
from karma.plugins.homes.lived.drawing import draw_request
from karma.plugins.homes.lived.experiment import EXPERT, HomeSpec, LivedExperiment, LivedRow
from karma.plugins.homes.lived.home_map import HomeMap
from karma.plugins.homes.lived.reading import Reader
from karma.plugins.homes.lived.recalling import fits, ids_of
from karma.plugins.homes.lived.request import (
    DAY_S,
    HOUR_S,
    CheckedDoubt,
    DayItem,
    HomeView,
    LivedRecord,
    LivedRequest,
    ServedRequest,
    answered_rightly,
    day_plan,
    done,
    room_right,
)
from karma.plugins.homes.lived.serve import Server
from karma.plugins.homes.memory.setting import MemorySetting, is_of_past, types_meant
from karma.plugins.homes.residents import Household
from karma.plugins.homes.types import Fact, HomeMemory, HomeMoment, HomeQuestion, Sighting
from karma.seeds import stream
from karma.world.core.placement import find_place

PLACED = frozenset(("exact", "attribute", "event", "place", "several", "changed"))  # of a thing
COUNTED_EFFORT = (
    "places", "wasted", "believed", "stale", "stale_actions", "repairs", "tokens", "recalls",
)  # fmt: skip
TOUR_H = 6.0  # of the first day, when the tour begins


@dataclass(frozen=True, slots=True, kw_only=True)
class TouredHome:
    """A home after the first tour of the robot, which is the same for every row."""

    map: HomeMap
    household: Household  # to be forked
    actions: int
    start: dict[str, Sighting]  # where all things were before
    moments: tuple[HomeMoment, ...]  # that the tour showed


@lru_cache(maxsize=2)  # shared by all rows of a home
def toured(spec: HomeSpec, seed: int) -> TouredHome:
    """Return a home whose robot has looked at and into everything once, before the first day."""
    scene = build_home(
        spec.rooms, seed + spec.number, name=f"home_{spec.number}", things=spec.setting.things
    )
    home, household = HomeMap(scene), Household(
        scene, seed=seed + spec.number, people=spec.people(seed),
        disturbance=spec.setting.disturbance,
    )  # fmt: skip
    moments: list[HomeMoment] = []
    robot = HomeRobot(household, home, moments.append)
    start = household.now(home.places)
    robot.wait(TOUR_H * HOUR_S)
    for place_id in nearest_next(robot, home.places):
        robot.look_at(place_id)
    return TouredHome(
        map=home,
        household=household,
        actions=robot.actions,
        start=start,
        moments=tuple(moments),
    )


class HomeLife:
    """One row in one home, from the first tour on."""

    def __init__(
        self, experiment: LivedExperiment, row: LivedRow, spec: HomeSpec, seed: int,
        reader: Reader,
    ) -> None:  # fmt: skip
        self._experiment, self._row, self._spec, self._seed = experiment, row, spec, seed
        self._reader = reader
        home = toured(spec, seed)
        self._map, self._start, self._people = home.map, home.start, spec.people(seed)
        self._household = home.household.fork()
        self._robot = HomeRobot(self._household, self._map, self._take_in)
        self._robot.actions = home.actions
        self._memory = self._made()
        self._server = Server(self._robot, self._memory, row, experiment.tokens)
        self._scheduled: list[HomeMoment] = []  # learnt on rounds and waits: the same for every row
        self._serving = False
        self._seen: dict[str, Sighting] = {}  # the last of each thing, whatever its memory
        self._rooms = tuple(self._map.in_rooms())
        for moment in home.moments:
            self._take_in(moment)

    def now(self) -> dict[str, Sighting]:
        """Return where every movable thing is."""
        return self._household.now(self._map.places)

    def day(self, day: int) -> LivedRecord:
        """Live one day."""
        plan = day_plan(self._seed, self._spec.number, day, self._rooms, self._experiment.requests)
        before, logged = self.now(), len(self._household.log)
        served: list[ServedRequest] = []
        missing = rounds = 0
        for number, planned in enumerate(plan):
            self._robot.wait(max(planned.time_s, self._robot.time_s))
            if planned.what == "request":
                one = self._request(planned, day, number)
                served += [one] if one is not None else []
                missing += one is None
            elif planned.what == "round":
                rounds += self._round()
            elif places := self._map.in_rooms().get(planned.room):
                self._robot.go(self._map.spots[places[0]][0])
        self._robot.wait(max((day + 1) * DAY_S, self._robot.time_s))
        moved = {
            deed.object_id
            for deed in self._household.log[logged:]
            if deed.action == "PutObject" and deed.who != "robot"
        }
        return LivedRecord(
            row=self._row.name,
            task=f"{self._spec.name}/day_{day}",
            seed=self._seed,
            success=all(one.right for one in served),
            end="day over",
            setting=self._spec.setting.name,
            home=self._spec.number,
            day=day,
            rooms=self._spec.rooms,
            people=self._people,
            things=len(before),
            moved=round(len(moved & before.keys()) / max(len(before), 1), 4),
            requests=tuple(served),
            missing=missing,
            round_actions=rounds,
            memory_bytes=self._memory.size_bytes(),
            units=self._spec.setting.units,
        )

    def close(self) -> None:
        """Let go of what the memory holds."""
        self._memory.close()

    # ------------------------------------------------------------- parts

    def _made(self) -> HomeMemory:
        setting = MemorySetting(
            embedder=self._reader.embedder,
            places=self._map.places,
            units=self._spec.setting.units,
            seed=self._seed,
        )
        if self._row.design == EXPERT:
            return ExpertMemory(setting, self.now)
        return DESIGNS[self._row.design](setting)

    def _take_in(self, moment: HomeMoment) -> None:
        self._memory.take_in(moment)
        self._seen.update((seen.object_id, seen) for seen in moment.seen)
        if not self._serving:
            self._scheduled.append(moment)

    def _round(self) -> int:
        """Walk through all rooms and look at all open furniture; return the actions."""
        before = self._robot.actions
        shown = tuple(one for one, place in self._map.places.items() if not place.openable)
        for place_id in nearest_next(self._robot, shown):
            self._robot.look_at(place_id)
        return self._robot.actions - before

    def _request(self, planned: DayItem, day: int, number: int) -> ServedRequest | None:
        assert planned.kind is not None
        rng = stream(
            self._seed, "lived", "request", self._spec.name, str(day), str(number), planned.kind
        )
        request = draw_request(self._view(), planned.kind, rng)
        if request is None:
            return None
        question = self._reader.read(request.text, request.speaker, self._robot.time_s)
        before, truth, known_s = self._robot.actions, self.now(), None
        if request.kind in PLACED:
            known_s = max(self._times_seen(request, truth), default=None)
        self._serving = True
        answer = self._server.serve(question)
        if self._robot.held is not None:
            self._robot.put_down()
        self._serving = False
        now = self.now()
        if request.asked == "errand":
            right = bool(answer.unknown) if request.unknown else done(request, now)
        else:
            right = answered_rightly(request, answer, now)
        effort = self._server.effort
        return ServedRequest(
            kind=request.kind,
            asked=request.asked,
            text=request.text,
            time_s=round(request.time_s, 1),
            right=right,
            unknown=answer.unknown,
            room_right=room_right(request, answer, now) if request.asked == "place" else None,
            actions=self._robot.actions - before,
            **{name: getattr(effort, name) for name in COUNTED_EFFORT},
            read=question.asked == request.asked
            and (not request.object_type or request.object_type in types_meant(question.thing)),
            knew=_knew(request, effort.first, truth) if request.kind in PLACED else None,
            known_s=known_s if known_s is None else round(known_s, 1),
            doubts=tuple(_checked(fact, truth) for fact in effort.doubts),
        )

    def _times_seen(self, request: LivedRequest, now: dict[str, Sighting]) -> Iterator[float]:
        """Yield when the things that may be meant were seen last, of those that are still there."""
        for object_id in request.object_ids:
            seen = self._seen.get(object_id)
            if seen is not None and seen.place_id == now[object_id].place_id:
                yield seen.time_s

    def _takes(self, object_id: str, place_id: str) -> bool:
        """Return whether a place has room for a thing now."""
        state = self._household.world.state
        thing, place = state.objects[object_id], state.objects[place_id]
        return find_place(state, thing, place) is not None

    def _view(self) -> HomeView:
        return HomeView(
            time_s=self._robot.time_s,
            people=tuple(one.name for one in self._household.residents),
            places=self._map.places,
            log=tuple(self._household.log),
            seen=tuple(self._scheduled),
            now=self.now(),
            start=self._start,
            takes=self._takes,
            words=self._spec.setting.words,
        )


def _knew(request: LivedRequest, taken: Sighting | None, truth: Mapping[str, Sighting]) -> bool:
    """Return whether what was taken to be meant is, and lies where it was said to lie."""
    if taken is None or taken.object_id not in request.object_ids:
        return False
    return taken.place_id == truth[taken.object_id].place_id


def _checked(fact: Fact, truth: Mapping[str, Sighting]) -> CheckedDoubt:
    """Return what a memory thought of a fact of now, and whether it is so."""
    there = truth.get(fact.sighting.object_id)
    return CheckedDoubt(
        holds=None if fact.holds is None else round(fact.holds, 4),
        was_so=there is not None and there.place_id == fact.sighting.place_id,
    )


class ExpertMemory(NoMemory):
    """A `HomeMemory` that is never wrong about the present; a ceiling, no design, of 0 bytes.

    It knows where everything is that the robot has ever seen, and only that: of things never seen
    it knows nothing, as every other memory.
    """

    def __init__(self, setting: MemorySetting, now: Callable[[], Mapping[str, Sighting]]) -> None:
        super().__init__(setting)
        self._now = now
        self._facts: list[Fact] = []

    def take_in(self, moment: HomeMoment) -> None:
        """Keep everything."""
        self._facts += (Fact(sighting=seen, deed=moment.deed) for seen in moment.seen)

    def recall(self, question: HomeQuestion, k: int) -> Sequence[Fact]:
        """Return what fits: the truth of now, and what was, the newest first."""
        said = question.thing
        types = types_meant(said)

        def is_meant(seen: Sighting) -> bool:
            return not types or seen.object_type in types

        if not is_of_past(said) and question.asked not in ("time", "who"):
            now = self._now()
            there = (now[one] for one in ids_of(self._facts) if one in now)
            found = [Fact(sighting=seen, holds=1.0) for seen in there if is_meant(seen)]
            found.sort(key=lambda fact: not fits(fact, said, self._places))
            return found[:k]
        then = question.asked == "place" and not said.who and not said.action
        before_s = math.inf if said.before_s is None else said.before_s
        past = (
            fact
            for fact in reversed(self._facts)
            if (then and fact.sighting.time_s <= before_s and is_meant(fact.sighting))
            or fits(fact, said, self._places)
        )
        return list(islice(past, k))
