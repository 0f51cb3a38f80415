"""One request served: memory is asked, doubt is weighed, places are looked at, things are brought.

The loop is closed after every look: what is seen goes into memory at once, and a plan whose ground
is gone is made anew from there, within a budget of places. Open loop (the paper's) ends there.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice

from karma.household.places import HAND
from karma.plugins.homes.lived.body import HomeRobot, look_cost, looks
from karma.plugins.homes.lived.experiment import LivedRow
from karma.plugins.homes.lived.recalling import Recollection, fits, ids_of, plain, recollect
from karma.plugins.homes.memory.setting import is_of_past, is_said_place, types_meant
from karma.plugins.homes.types import (
    Fact,
    HomeAnswer,
    HomeMemory,
    HomeMoment,
    HomeQuestion,
    LikelyPlace,
    SaidThing,
    Sighting,
)

COUNTED = 0.2  # chance from which on a thing is counted, where it was seen or where it may lie
MOST_PLACES = 16  # looked at for one errand
MOST_LOOKS = 8  # for one question
WRONG_COSTS = 400.0  # actions that a wrong answer is as bad as


@dataclass(slots=True)
class Effort:
    """What one request has cost so far."""

    places: int = 0  # looked at
    wasted: int = 0  # of them, where the thing was not
    believed: int = 0  # of them, because memory says that it is there
    stale: int = 0  # of these, where it was not
    stale_actions: int = 0  # world actions spent on those
    repairs: int = 0  # plans made anew
    recalls: int = 0
    tokens: int = 0
    first: Sighting | None = None  # the thing that it took to be meant, where memory had it
    doubts: list[Fact] = field(default_factory=list)  # of now, before anything was done


@dataclass(frozen=True, slots=True, kw_only=True)
class MeantThing:
    """A thing that a request may mean, as memory knows it."""

    object_id: str
    object_type: str
    fact: Fact | None  # the newest one about where it is


class Server:
    """Serves requests with one memory, used as a row says; `tokens` of facts in one prompt."""

    def __init__(self, robot: HomeRobot, memory: HomeMemory, row: LivedRow, tokens: int) -> None:
        self._robot, self._memory, self._row, self._tokens = robot, memory, row, tokens
        self._places = robot.map.places
        self.effort = Effort()

    def serve(self, question: HomeQuestion) -> HomeAnswer:
        """Answer a question, or carry an errand out; an errand's answer says whether it gave up."""
        self.effort = Effort()
        if question.unread:
            return HomeAnswer(unknown=True, unread=question.unread)
        match question.asked:
            case "errand":
                return self._errand(question)
            case "place" | "state" if not self._of_past_place(question):
                return self._where_now(question)
            case "place":
                return self._where_then(question)
            case "count":
                return self._count(question)
            case _:
                return self._when_or_who(question)

    # ------------------------------------------------------------- what memory says

    def _recall(self, question: HomeQuestion) -> Recollection:
        found = recollect(self._memory, question, self._places, budget_tokens=self._tokens)
        self.effort.recalls += 1
        self.effort.tokens += found.tokens
        return found

    def _of_past_place(self, question: HomeQuestion) -> bool:
        """Return whether it is asked where a thing was, not where one is that is known by then."""
        said = question.thing
        then = said.after_s is not None or said.before_s is not None
        return question.asked == "place" and then and not said.who and not said.action

    def _targets(self, question: HomeQuestion, said: SaidThing) -> list[MeantThing]:
        """Return the things that may be meant, the likeliest first, with where they are."""
        asked = replace(question, thing=said)
        told = self._recall(asked)
        beside = self._place_of(question, said.beside, said) if said.beside is not None else None
        if said.beside is not None and beside is None:
            return []
        meant = [fact for fact in told.facts if fits(fact, said, self._places, beside=beside)]
        if is_of_past(said):
            meant.sort(key=lambda fact: -_seen_s(fact))
            found = replace(said, ids=ids_of(meant))
            now = self._recall(plain(asked, found)) if meant else told
        else:
            meant = [fact for fact in meant if told.latest(fact.sighting.object_id) in (fact, None)]
            now = told
        targets = []
        known = set(ids_of(now.facts))  # of these, what has ended is lost
        for object_id in ids_of(meant):
            fact = (now if object_id in known else told).latest(object_id)
            kind = next(f.sighting.object_type for f in meant if f.sighting.object_id == object_id)
            targets.append(MeantThing(object_id=object_id, object_type=kind, fact=fact))
        return targets

    def _place_of(self, question: HomeQuestion, other: SaidThing, said: SaidThing) -> str | None:
        """Return where another thing is, or was at the time that is said."""
        timed = replace(
            other,
            after_s=other.after_s if other.after_s is not None else said.after_s,
            before_s=other.before_s if other.before_s is not None else said.before_s,
        )
        asked = replace(question, asked="place", thing=timed, destination=None)
        newest = max(self._fitting(asked, timed), key=_seen_s, default=None)
        return None if newest is None else newest.sighting.place_id

    def _fitting(self, question: HomeQuestion, said: SaidThing) -> list[Fact]:
        """Return what memory says of a thing as it was said."""
        return [fact for fact in self._recall(question).facts if fits(fact, said, self._places)]

    # ------------------------------------------------------------- questions

    def _meant(self, question: HomeQuestion) -> list[MeantThing]:
        """Return what may be meant, and note what memory takes it to be."""
        found = self._targets(question, question.thing)
        if found and found[0].fact is not None:
            self.effort.first = found[0].fact.sighting
        return found

    def _where_now(self, question: HomeQuestion) -> HomeAnswer:
        targets = self._meant(question)
        if not targets:
            return HomeAnswer(unknown=True)
        fact = targets[0].fact
        if fact is not None:
            self.effort.doubts.append(fact)
            if not self._looks_first(fact):
                return _answer(self._robot, fact.sighting, fact.holds)
        seen = self._find(question, targets[:1], MOST_LOOKS)
        return HomeAnswer(unknown=True) if seen is None else _answer(self._robot, seen, 1.0)

    def _looks_first(self, fact: Fact) -> bool:
        """Return whether a look is worth its way: what it costs against a wrong answer."""
        place_id = fact.sighting.place_id or ""
        if self._row.verify == "never" or place_id not in self._robot.map.spots:
            return False
        if self._row.verify == "always":
            return True
        wrong = 0.0 if fact.holds is None else 1.0 - fact.holds  # its chance; none is told
        return wrong * WRONG_COSTS > look_cost(self._robot, place_id)

    def _where_then(self, question: HomeQuestion) -> HomeAnswer:
        """Answer where a thing was: the newest fact of that time, else the last one before it."""
        said = question.thing
        facts = self._fitting(question, replace(said, after_s=None, before_s=None))
        before = said.before_s if said.before_s is not None else question.time_s
        at = max((fact for fact in facts if _seen_s(fact) <= before), key=_seen_s, default=None)
        if at is None:
            return HomeAnswer(unknown=True)
        return _answer(self._robot, at.sighting, None)

    def _when_or_who(self, question: HomeQuestion) -> HomeAnswer:
        facts = self._fitting(question, question.thing)
        if question.asked == "who":
            facts = [fact for fact in facts if fact.deed is not None]
        newest = max(
            facts, key=lambda fact: fact.deed.time_s if fact.deed else _seen_s(fact), default=None
        )
        if newest is None:
            return HomeAnswer(unknown=True)
        if question.asked == "who":
            return HomeAnswer(who=newest.deed.who if newest.deed else "")
        by_deed = newest.deed if question.thing.action else None
        seen_s = by_deed.time_s if by_deed else _seen_s(newest)
        return HomeAnswer(time_s=seen_s)

    def _count(self, question: HomeQuestion) -> HomeAnswer:
        """Count what memory believes to be there, and what is lost and most likely lies there.

        A look may miss some, so none is made.
        """
        said = question.thing
        told = self._recall(question)
        newest = [(one, told.latest(one)) for one in ids_of(told.facts)]
        facts = [fact for _, fact in newest if fact and fits(fact, said, self._places)]
        self.effort.doubts += facts
        if not facts and not self._recall(plain(question)).facts:
            return HomeAnswer(unknown=True)
        there = [fact for fact in facts if fact.holds is None or fact.holds >= COUNTED]
        lost = {one for one, fact in newest if fact is None}
        anywhere = replace(said, place_types=(), room="")
        fitting = {
            fact.sighting.object_id
            for fact in told.facts
            if fact.sighting.object_id in lost and fits(fact, anywhere, self._places)
        }
        likely = sum(self._likely_there(question, one) for one in fitting)
        return HomeAnswer(count=len(there) + likely)

    def _likely_there(self, question: HomeQuestion, object_id: str) -> bool:
        """Return whether a lost thing may well be where it is asked for."""
        said = question.thing
        lost = replace(said, place_types=(), room="", ids=(object_id,))
        likely = self._memory.likely_places(replace(question, thing=lost))
        there = (
            one.chance for one in likely if is_said_place(self._places.get(one.place_id), said)
        )
        return sum(there) >= COUNTED

    # ------------------------------------------------------------- errands

    def _errand(self, question: HomeQuestion) -> HomeAnswer:
        targets = self._meant(question)
        if targets and targets[0].fact is not None and targets[0].fact.ended_s is None:
            self.effort.doubts.append(targets[0].fact)
        said = question.thing  # one that memory does not know may be told by looking at it
        told = bool(types_meant(said)) and not is_of_past(said) and said.beside is None
        if not targets and not (self._row.closed_loop and told):
            return HomeAnswer(unknown=True)
        seen = self._find(question, targets, MOST_PLACES)
        if seen is None or not self._take(seen):
            return HomeAnswer(unknown=True)
        for place_id in self._destinations(question):
            if self._robot.put(place_id):
                return _answer(self._robot, replace(seen, place_id=place_id), 1.0)
            self.effort.repairs += 1
            if not self._row.closed_loop:
                break
        self._robot.put_down()
        return HomeAnswer(unknown=True)

    def _take(self, seen: Sighting) -> bool:
        if seen.place_id == HAND:
            return self._robot.held == seen.object_id
        taken = self._robot.take(seen.object_id)
        if seen.place_id is not None:
            self._robot.close(seen.place_id)
        return taken

    def _destinations(self, question: HomeQuestion) -> list[str]:
        """Return the places that an errand may mean, the nearest first."""
        said = question.destination
        if said is None:
            return []
        if said.beside is not None:
            place_id = self._beside_now(question, said.beside)
            return [place_id] if place_id in self._places else []  # not in the hand
        kinds = set(said.place_types) | set(types_meant(said))
        found = [
            place_id
            for place_id, place in self._places.items()
            if place.place_type in kinds
            and (not said.room or said.room in (place.room_kind, place.room))
        ]
        return sorted(found, key=lambda one: (look_cost(self._robot, one), one))[:4]

    def _beside_now(self, question: HomeQuestion, other: SaidThing) -> str | None:
        """Return where another thing is now, looked for where memory doubts it."""
        asked = replace(question, thing=other, destination=None)
        targets = self._targets(asked, other)
        if not targets:
            return None
        fact = targets[0].fact
        if fact is not None and not self._looks_first(fact):
            return fact.sighting.place_id
        seen = self._find(asked, targets[:1], MOST_LOOKS)
        if seen is not None:
            return seen.place_id
        return None if fact is None else fact.sighting.place_id

    # ------------------------------------------------------------- looking

    def _find(
        self, question: HomeQuestion, targets: Sequence[MeantThing], budget: int
    ) -> Sighting | None:
        """Look for one of several things; memory learns from every look."""
        said = question.thing
        known = {target.object_id for target in targets}
        kinds = types_meant(said)
        facts = [target.fact for target in targets if target.fact is not None]
        believed = {fact.sighting.place_id for fact in facts}
        kind = targets[0].object_type if targets else (kinds[0] if kinds else None)
        found: list[Sighting] = []

        def likely() -> Sequence[LikelyPlace]:
            meant = replace(said, ids=tuple(sorted(known)))
            now = replace(question, thing=meant, time_s=self._robot.time_s)
            return self._memory.likely_places(now)

        def is_it(moment: HomeMoment) -> bool:
            for seen in moment.seen:
                alike = not known and fits(Fact(sighting=seen), said, self._places)
                if seen.object_id in known or alike:
                    found.append(seen)
                    return True
            return False

        for place_id in islice(looks(self._robot, kind, facts, likely), budget):
            if not self._row.closed_loop and place_id not in believed:
                break
            if self._look_at(place_id, is_it, believed=place_id in believed):
                return found[0]
            self.effort.repairs += 1
            if not self._row.closed_loop:
                break
        return None

    def _look_at(
        self, place_id: str, is_it: Callable[[HomeMoment], bool], *, believed: bool
    ) -> bool:
        effort, before = self.effort, self._robot.actions
        found = self._robot.look_at(place_id, until=is_it)
        effort.places += 1
        effort.believed += believed
        if not found:
            effort.wasted += 1
            if believed:
                effort.stale += 1
                effort.stale_actions += self._robot.actions - before
        return found


def _seen_s(fact: Fact) -> float:
    return fact.sighting.time_s


def _answer(robot: HomeRobot, seen: Sighting, sure: float | None) -> HomeAnswer:
    place = robot.map.places.get(seen.place_id or "")
    return HomeAnswer(
        place_id=seen.place_id,
        place_type=place.place_type if place else "",
        room=place.room if place else seen.room,
        states=seen.states,
        sure=sure,
    )
