"""Execute a parsed request.

Conditions are checked first, the objects of a plural follow each other, and failures are reported.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from karma.agent.attempts import Attempts
from karma.agent.planning.inspector import put_down
from karma.agent.seeing.perceive import place_of
from karma.agent.session import SURVEY
from karma.household.containment import has_door
from karma.household.ids import root_id, type_of
from karma.household.pieces import is_piece
from karma.household.places import HAND
from karma.household.saying import name_of, spoken, told_place
from karma.household.states import ENDS, SAID_AS
from karma.household.types import Capability, object_types, types_with
from karma.household.uses import BURNER, LAMPS, kind_of
from karma.plugins.rules.answer_checker import advice_for
from karma.plugins.rules.conditions import ConditionCheck
from karma.plugins.rules.deeds import FOR_GOOD, able_to, deed_kind
from karma.plugins.rules.language.clauses import said
from karma.plugins.rules.language.request_words import request_words
from karma.plugins.rules.object_finder import (
    PLACES,
    ObjectFinder,
    Steps,
    is_all,
    is_several,
    refusal,
    states_told,
)
from karma.plugins.rules.put_back import put_back
from karma.plugins.rules.request_checker import Guard, cannot_serve, here_of, meant_by
from karma.plugins.rules.types import Mention, Request, SaidDeed
from karma.types.planning import RefusedRequest, SkillCall
from karma.types.tasks import SubTask

_HEATED: tuple[Capability, ...] = ("cookable", "sliceable", "canFillWithLiquid")
_MAX_FAILURES = 2  # failed objects of a plural after which the others are left
_SWITCHED = (*LAMPS, "LightSwitch", "Television")  # switched off by "everything"


@dataclass(slots=True)
class RequestExecutor(ObjectFinder):
    """Executes a request; `is_clause`: an assistant has cut it out of a longer text."""

    subtask: SubTask
    is_clause: bool = False
    meant: dict[str, str] = field(default_factory=dict)  # objects of its conditions: type -> id

    def carry_out(self) -> Steps[bool]:
        """Execute the request if its conditions hold, then undo its side effects.

        Where it cannot be, it is said why. Returns whether all of it was done.
        """
        asked, progress = self.asked, self.progress
        refused = cannot_serve(asked, self.here) or self.not_told_apart()
        if refused is not None:
            yield refusal(refused)
            return False
        conditions = ConditionCheck(self.session, asked, self.earlier, progress, meant=self.meant)
        if (yield from conditions.hold()):
            if not self.is_clause:  # the planner sees the requests only
                text = asked.errand or self.subtask.instruction
                self.subtask = replace(self.subtask, instruction=text)
            yield from self._in_turn()
            for one in asked.mentions if self._has_acted() else ():
                if one.marks:
                    self.say(f"whether that is the {' '.join(one.marks)} one", "unseen")
        if self._has_acted():
            yield from put_back(asked, self.session)
        return progress.finished

    def _has_acted(self) -> bool:
        return self.progress.acted or any(one.results for one in self.progress.programs)

    def _planned(
        self, subtask: SubTask, asked: Request, only: Mapping[str, str] | None = None
    ) -> Steps[Attempts]:
        """Let the planner execute a request under the answer checker."""
        return (yield from self.session.do(subtask, advice_for(asked, only)))

    def _plan_all(self, only: Mapping[str, str] | None) -> Steps[None]:
        """Let the planner execute the whole request."""
        attempts = yield from self._planned(self.subtask, self.asked, only)
        self.progress.programs.append(attempts)

    def _in_turn(self) -> Steps[None]:
        """Execute the request; the objects of a plural one after the other."""
        deeds = self.asked.deeds
        alone = len(deeds) == 1 and len(deeds[0].things) == 1
        if alone and _is_sought(deeds[0]):
            yield from self._find()
        elif alone and deeds[0].things[0].anything and deeds[0].things[0].told:
            words = (deeds[0].things[0].text,)  # "whatever you left there" identifies no object
            yield refusal(RefusedRequest(kind="unclear", by="guard", words=words))
        elif alone and is_several(deeds[0].things[0]):
            along = self._goes_along(deeds[0].things[0], deeds[0])
            yield from (self._each_along if along else self._each)()
        elif [one.deed for one in deeds] == ["go"]:
            yield from self._go(deeds[0])
        elif alone:
            yield from self._the_same()
        else:
            yield from self._plan_all(self._own() or None)

    def _own(self) -> dict[str, str]:
        """Return the ids that earlier words gave to types; none for "the other mug"."""
        single = (
            one for one in self.asked.mentions
            if not (is_several(one) or one.other or one.at or one.told)
        )  # fmt: skip
        kinds = {kind_of(kind) for one in single for kind in one.types}
        mine = {kind: name for kind, name in self.earlier.owned.items() if kind in kinds}
        return {**mine, **self.meant}

    # ------------------------------------------------------------- without a planner

    def _find(self) -> Steps[None]:
        """Search for objects without the planner; for a plural, for all of them."""
        progress, thing, found = self.progress, self.asked.deeds[0].things[0], list[str]()
        wanted = None if thing.every else thing.number or 1
        while wanted is None or len(found) < wanted:
            one = yield from self._one_more({*found})
            if one is None or one in found:
                break
            found.append(one)
            if not object_types()[kind_of(type_of(one))].can("pickupable"):  # known by the map
                yield self.go_to(one)
            sight = self.sights.get(one)
            if sight is not None and not (sight.pickupable or has_door(sight.object_type)):
                yield self.look_over(sight)
            where = told_place(place_of(sight)) if sight and sight.pickupable else "here"
            self.say(f"the {name_of(one)} is {where}", "seen")
        progress.nothing_to_do, progress.short = bool(found), len(found) < (wanted or 1)
        if progress.short:
            more = f"more than {len(found)}: " if found else "no "
            self.say(f"I found {more}{thing.text}", "otherwise")

    def _go(self, deed: SaidDeed) -> Steps[None]:
        """Go to an object without the planner; refuse "here"."""
        goal = deed.place or next(iter(deed.things), None)
        kinds = [] if goal is None else self.kinds_of(goal)
        if goal is None or not kinds:
            yield refusal(RefusedRequest(kind="unclear", by="guard", words=(deed.verb,)))
            return
        for way in ("GoToObject", "Explore"):  # to a known object, else search
            result = self.call(SkillCall.of(way, kinds[0]))
            yield result
            if result.ok:
                break
        self.progress.nothing_to_do, self.progress.short = result.ok, not result.ok
        self.say(f"I am at the {goal.text}", "seen" if result.ok else "otherwise")

    # ------------------------------------------------------------- one thing, or each of several

    def _the_same(self) -> Steps[None]:
        """Do one action to one object: the object that the same word meant before, if any."""
        asked, progress = self.asked, self.progress
        thing = asked.deeds[0].things[0]
        kinds = list(dict.fromkeys(self.kinds_of(thing)))
        key = (asked.whole or asked.text, thing.start)
        own = self._own()
        before = self.earlier.chosen.get(key) or next(
            (own[kind] for kind in kinds if kind in own), None
        )
        if before is None:
            before = yield from self.told_apart_by_words(kinds)
            if before == "":
                return
        if asked.deeds[0].deed == "take":
            before = yield from self._hand_freed(kinds, before)
        before = before and _piece_of(self.sights, before)
        if before and self.holds_already(before, asked.deeds[0], own):
            progress.nothing_to_do = True
            self.say(f"the {name_of(before)}: that is so already", "seen")
            return
        place = yield from self.place_told()
        if place is None:
            return
        own = {**own, **place}
        only = {**own, kind_of(before): before} if before and kind_of(before) in kinds else own
        one_kind = before and len(kinds) > 1  # "the lamp that is on"
        subtask, request = self.subtask, asked
        if before and one_kind:
            subtask, request = self._of_one(kind_of(before))
        progress.programs.append((yield from self._planned(subtask, request, only)))
        self.tell_left_behind(kinds)
        for result in progress.programs[-1].results:
            used = [one for one in result.object_ids if kind_of(one) in kinds]
            if used and result.ok:
                # "it" of an earlier text means nothing later, but "the other one" is another one
                at = thing.start if thing.start >= 0 else -2 - asked.deeds[0].start
                self.earlier.chosen.setdefault((key[0], at), used[0])

    def _hand_freed(self, kinds: Collection[str], before: str | None) -> Steps[str | None]:
        """Return the object to take; put down the held object if it is another one."""
        held = next((one for one, sight in self.sights.items() if place_of(sight) == HAND), "")
        if not held or kind_of(type_of(held)) not in kinds or before == held:
            return before
        if before is not None:  # "another mug"
            for call in put_down(held if held != before else None, self.here):
                yield self.call(call)
        return before or held

    def _each(self) -> Steps[None]:
        """Do an action to each object of a plural: to known objects, then to found ones."""
        progress, deed, thing = self.progress, self.asked.deeds[0], self.asked.deeds[0].things[0]
        kinds: list[str] = []
        found: list[str] = []
        if thing.anything:
            kinds, found = yield from self._whatever()
            kinds = self._not_ruled_out(kinds)
        place = yield from self.place_told()
        if place is None:
            return
        wanted = thing.number
        done: list[str] = []
        failed: list[str] = []
        others = self.meant_before(thing) if thing.other else set()  # not as they are described
        while (wanted is None or len(done) < wanted) and len(failed) < _MAX_FAILURES:
            if done and deed.deed == "take" and not self._is_taken_out():
                self.say("I can hold one thing at a time", "otherwise")
                progress.short = True
                thing = replace(thing, number=len(found) or thing.number)
                break
            tried = {*done, *failed, *others}
            if thing.anything:
                rest = (one for one in found if one not in tried and kind_of(one) in kinds)
                one = next(rest, None)
            else:
                one = yield from self._one_more(tried)
            if one is None or one in tried:
                break
            fits = thing.anything or self.fits(one, thing)
            if not fits or one in self.left_aside([kind_of(one)]):
                told = fits or bool(thing.at or states_told(thing, [kind_of(one)]))
                (others.add if told else failed.append)(one)
                continue
            place = place or self._vessel(done)
            if self.holds_already(one, deed, place):
                done.append(one)
                continue
            only = {**place, kind_of(one): one}
            attempts = yield from self._planned(*self._of_one(kind_of(one)), only)
            progress.programs += [attempts] if attempts.results else []
            (done if attempts.finished else failed).append(one)
        if not (done or failed) and _is_ended(deed, thing):
            progress.nothing_to_do = True
            state = SAID_AS.get(thing.states[0], thing.states[0])
            self.say(f"nothing that I have seen is {state}", "seen")
            return
        self._tell_count(thing, done, failed)

    def _each_along(self) -> Steps[None]:
        """Move objects in their container: "the forks in a bowl on the table"."""
        deed = self.asked.deeds[0]
        thing = deed.things[0]
        carrier = replace(
            thing, types=thing.at, text=spoken(thing.at[0]).lower(), start=-1, number=None,
            every=False, at=(), states=(), marks=(),
        )  # fmt: skip
        into = replace(deed, things=(replace(thing, at=()),), place=carrier)
        yield from self._asking(into)._each()
        kinds = {*self.kinds_of(thing)}
        only = self._vessel([one for one in sorted(self.sights) if kind_of(one) in kinds], carrier)
        if self.progress.short or not only:
            return
        carried = self._asking(replace(deed, things=(carrier,)))
        place = yield from carried.place_told()
        if place is None:
            return
        (kind, name), *_ = only.items()
        if carried.holds_already(name, deed, place):
            self.say(f"the {name_of(name)}: that is so already", "seen")
            return
        self.progress.nothing_to_do = False
        attempts = yield from self._planned(*carried._of_one(kind), {**place, **only})
        self.progress.programs.append(attempts)

    def _asking(self, deed: SaidDeed) -> "RequestExecutor":
        """Return this request with another action."""
        asked = replace(self.asked, deeds=(deed,))
        return RequestExecutor(
            self.session, asked, self.earlier, self.progress, self.subtask, self.is_clause
        )

    def _vessel(self, things: Iterable[str], place: Mention | None = None) -> dict[str, str]:
        """Return the portable container of the first of some objects, type -> id.

        `place`: where they were to go, the deed's by default; {} where that is several.
        """
        place = place or self.asked.deeds[0].place
        if place is None or is_several(place):
            return {}
        kinds = {kind for kind in self.kinds_of(place) if object_types()[kind].can("pickupable")}
        sights = self.sights
        lain_in = (one for name in things if name in sights for one in sights[name].parent_ids)
        vessel = next((one for one in lain_in if kind_of(one) in kinds), None)
        return {kind_of(vessel): vessel} if vessel is not None else {}

    def _of_one(self, kind: str) -> tuple[SubTask, Request]:
        """Return the request for one object of a type, for the planner."""
        deed = self.asked.deeds[0]
        single = replace(
            deed.things[0], types=(kind,), text=spoken(kind).lower(), number=None, every=False,
            anything=False, at=(), states=(),
        )  # fmt: skip
        request = replace(self.asked, deeds=(replace(deed, things=(single,)),))
        text = said(request.deeds[0])
        return replace(self.subtask, instruction=text, whole=text), request

    def _is_taken_out(self) -> bool:
        """Return whether objects only leave a place: "take everything out of the fridge"."""
        me = request_words().me & {*self.asked.text.lower().split()}
        return bool(self.asked.deeds[0].things[0].at) and not me

    def _one_more(self, tried: set[str]) -> Steps[str | None]:
        """Return another object of a plural: a known object, else search for it."""
        thing = self.asked.deeds[0].things[0]
        kinds = self._not_ruled_out(meant_by(thing, self.here))
        if not self._counts_pieces():
            roots = {*map(root_id, tried)}
            tried = tried | {name for name in self.sights if root_id(name) in roots}
        one = self.next_known(kinds, tried, thing)
        places = self.places([*map(kind_of, thing.at)]) if one is None else []
        if 0 < len(places) <= PLACES:
            return (
                yield from self.looked_over(places, partial(self.next_known, kinds, tried, thing))
            )
        if one is None and kinds:
            one = yield from self.another(kinds, tried)
            if one is None and not tried:  # no bottle, but a spray bottle was seen on the way
                kinds = self._not_ruled_out(meant_by(thing, self.here))
                one = self.next_known(kinds, tried, thing)
        return one

    def _counts_pieces(self) -> bool:
        """Return whether slices count as objects; they do not for "slice two potatoes"."""
        deed = self.asked.deeds[0]
        whole = deed.things[0].number is not None or deed.deed in FOR_GOOD
        return not whole or bool(Guard(self.asked, self.here).in_pieces())

    def _not_ruled_out(self, kinds: Iterable[str]) -> list[str]:
        """Return the object types that the request does not exclude."""
        whole = (one for one in self.asked.exclusions if not (one.at or one.states))
        ruled_out = {kind_of(kind) for one in whole for kind in one.types}
        return [kind for kind in dict.fromkeys(map(kind_of, kinds)) if kind not in ruled_out]

    def _tell_count(self, thing: Mention, done: Sequence[str], failed: Sequence[str]) -> None:
        """Report how many objects succeeded and list the failures."""
        progress = self.progress
        wanted = thing.number if thing.number is not None else len(done) + len(failed)
        text = f"{len(done)} of {wanted}: {thing.text}"
        if thing.states:
            text += f" that I saw to be {SAID_AS.get(thing.states[0], thing.states[0])}"
        if failed and len(done) < wanted:
            text += f"; not the {', the '.join(map(name_of, failed))}"
        if len(done) < wanted or not done:
            progress.short = True
            if not failed:
                text = f"{text}; I found no more" if done else f"I found none: {thing.text}"
            self.say(text, "otherwise")
        else:
            progress.nothing_to_do = progress.nothing_to_do or not progress.programs
            self.say(text, "seen")

    # ------------------------------------------------------------- looking

    def _whatever(self) -> Steps[tuple[list[str], list[str]]]:
        """Look at a place, or everywhere; return types and ids of the objects meant there."""
        deed = self.asked.deeds[0]
        thing, switched = deed.things[0], deed.deed in ("on", "off")
        if not thing.at and (thing.states or switched):
            yield self.call(SkillCall.of(SURVEY))
            return self._all_that_are_so() if thing.states else self._all_switches()
        places = {kind_of(kind) for kind in here_of(thing.at, self.here)}
        for name in self.places(places)[:PLACES] or sorted(places)[:1]:
            yield self.go_to(name)
        for sight in self.of_kinds(places)[:PLACES]:
            yield self.look_over(sight)
        there = sorted(
            sight.object_id for sight in self.sights.values()
            if {kind_of(parent) for parent in sight.parent_ids} & places
            and object_types()[sight.object_type].can("pickupable")
            and is_all(thing.states, sight) and _is_for(deed, kind_of(sight.object_type))
        )  # fmt: skip
        return sorted({*map(kind_of, there)}), there

    def _all_switches(self) -> tuple[list[str], list[str]]:
        """Return types and ids of the devices that "everything" means."""
        here, sights = self.here, sorted(self.sights.items())
        kinds = [kind for kind in _SWITCHED if kind in here or kind == "LightSwitch"]
        found = [name for name, sight in sights if kind_of(sight.object_type) in kinds]
        if self.asked.deeds[0].deed == "off":  # also a tap or a burner that runs
            runs = [(name, one.object_type) for name, one in sights if "on" in one.states]
            apart = {*kinds, BURNER} | types_with("pickupable")
            found += [name for name, kind in runs if kind not in apart]
        return [*dict.fromkeys(map(kind_of, found))], found

    def _all_that_are_so(self) -> tuple[list[str], list[str]]:
        """Return types and ids of the objects observed in the described states."""
        deed = self.asked.deeds[0]
        thing, takes = deed.things[0], deed_kind(deed.deed).takes
        found = [
            name for name, sight in sorted(self.sights.items())
            if sight.states and is_all(thing.states, sight)
            and (takes is None or able_to(kind_of(name), takes))
        ]  # fmt: skip
        return sorted({*map(kind_of, found)}), found


def not_to_open(asked: Request) -> set[str]:
    """Return the types that a request forbids to open or to touch."""
    kinds = {kind for one in asked.exclusions if not (one.at or one.states) for kind in one.types}
    for deed in asked.forbidden:
        if deed.verb == "open":  # not "leave open"
            kinds |= {kind for one in deed.things for kind in one.types} or types_with("openable")
    return kinds


def _is_sought(deed: SaidDeed) -> bool:
    """Return whether an action is a search without a location."""
    thing = deed.things[0]
    return deed.deed == "find" and deed.place is None and not (thing.at or thing.anything)


def _is_ended(deed: SaidDeed, thing: Mention) -> bool:
    """Return whether an action ends the state in its description: "close what is open"."""
    leaves = deed_kind(deed.deed).leaves
    ends = {ENDS.get(one, "empty" if one == "filled" else "") for one in thing.states}
    return bool(leaves) and leaves in ends


def _is_for(deed: SaidDeed, kind: str) -> bool:
    """Return whether an action applies to a type among all objects there: no knife is heated."""
    heats = deed.deed in ("heat", "cook", "toast")
    return not heats or any(map(object_types()[kind].can, _HEATED))


def _piece_of(sights: Collection[str], object_id: str) -> str:
    """Return a slice of an object that was cut since, or the object itself."""
    pieces = (one for one in sorted(sights) if is_piece(type_of(one)) and root_id(one) == object_id)
    return next(pieces, object_id)
