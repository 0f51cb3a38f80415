"""Which of several things is meant: told by its place, its state, or as "the other one".

What is told so is looked for until one is so; none is taken in its place.
"""

from collections.abc import Callable, Collection, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

from karma.agent.attempts import Attempts
from karma.agent.seeing.perceive import place_of
from karma.agent.session import LOOK_OVER, InstructionSession
from karma.household.ids import root_id, type_of
from karma.household.pieces import is_piece
from karma.household.places import HAND
from karma.household.saying import name_of, spoken, told_place
from karma.household.states import NOT_SO, SAID_AS
from karma.household.types import object_types
from karma.household.uses import BASINS, BURNER, KNOB, LAMPS, PARTS_OF_FURNITURE, kind_of
from karma.plugins.rules.answer_checker import by_no_model
from karma.plugins.rules.deeds import FOR_GOOD, deed_kind
from karma.plugins.rules.language.request_words import request_words
from karma.plugins.rules.request_checker import meant_by, stated
from karma.plugins.rules.types import Mention, Request, SaidDeed
from karma.types.events import AgentEvent, Found, Plan, SkillResult
from karma.types.observation import SeenObject
from karma.types.planning import Prompt, RefusedRequest, SkillCall

T = TypeVar("T")
Steps = Generator[AgentEvent, None, T]  # what happens on the way to a value
_PUT = SaidDeed(verb="put", deed="put", start=-1)
PLACES = 12  # of a kind that are looked over
_MADE_SO = frozenset(("heated", "cooled", "cooked", "sliced", "filled"))  # "the hot potato"
_SHOWS = frozenset(("on", "off", "opened", "closed", "sliced"))  # states that are so for any deed


@dataclass(slots=True)
class Earlier:
    """What earlier clauses and texts settled."""

    chosen: dict[tuple[str, int], str] = field(default_factory=dict)  # word of a text -> its id
    decided: dict[tuple[str, ...], bool] = field(default_factory=dict)  # conditions of this text
    owned: Mapping[str, str] = field(default_factory=dict)  # type -> id that its word means
    reported: Collection[str] = ()  # ids of which somebody else said where or how they are


@dataclass(slots=True)
class Progress:
    """How far a request has come."""

    programs: list[Attempts] = field(default_factory=list)
    acted: bool = False  # something was looked at beside the programs
    nothing_to_do: bool = False
    short: bool = False  # fewer objects than were asked for

    @property
    def finished(self) -> bool:
        """Whether all of it was done."""
        if self.short:
            return False
        programs = self.programs
        return self.nothing_to_do or (
            bool(programs) and all(attempts.finished for attempts in programs)
        )


def refusal(refused: RefusedRequest) -> Plan:
    """Return what stands for an answer where no planner is asked."""
    prompt = Prompt(stable="", changing="")
    return Plan(prompt=prompt, completion=by_no_model(), calls=(), names={}, refused=refused)


@dataclass(slots=True)
class ObjectFinder:
    """Finds the objects that one request means, among what was seen here or is looked for now."""

    session: InstructionSession
    asked: Request
    earlier: Earlier
    progress: Progress
    looked_at: set[str] = field(default_factory=set, kw_only=True)  # places, for this request

    @property
    def here(self) -> frozenset[str]:
        """The types that the agent knows of in this room."""
        return self.session.remembered().types

    @property
    def sights(self) -> Mapping[str, SeenObject]:
        """The latest sight of all that was seen in this room."""
        return self.session.seen()

    def places(self, kinds: Collection[str]) -> list[str]:
        """Return the ids of the furniture of some kinds, by the map."""
        fixtures = self.session.remembered().fixtures
        return sorted(name for name, kind in fixtures.items() if kind_of(kind) in kinds)

    def handled(self) -> list[str]:
        """Return the ids of what was handled in this room and is remembered, the last one last."""
        return [unit.object_id for unit in self.session.remembered().units if unit.handled]

    def say(self, text: str, found: Found) -> None:
        """Report how something stands that no program was to bring about."""
        self.session.say(text, found)

    def call(self, call: SkillCall, aside: Collection[str] = ()) -> SkillResult:
        """Run one skill."""
        self.progress.acted = True
        return self.session.call(call, aside)

    def look_over(self, sight: SeenObject) -> SkillResult:
        """Look at all that is on a surface, or in a container, which is open afterwards."""
        return self.call(SkillCall.of(LOOK_OVER, sight.object_id))

    def kinds_of(self, one: Mention) -> list[str]:
        """Return the types of wholes that a mention may mean here, in its order."""
        return [*map(kind_of, meant_by(one, self.here))]

    def go_to(self, name: str) -> SkillResult:
        """Go to a thing."""
        return self.call(SkillCall.of("GoToObject", name))

    # ------------------------------------------------------------- told apart by words

    def not_told_apart(self) -> RefusedRequest | None:
        """Return that one of several known things has marks that no look shows: "the red"."""
        here = self.here
        for one in self.asked.mentions:
            kinds = one.at if one.anything else meant_by(one, here)
            thing = replace(one, at=()) if one.anything else one
            if one.marks and len(self._alike(kinds, thing)) > 1:
                return RefusedRequest(kind="alike", by="guard", words=one.marks)
        return None

    def _alike(self, kinds: Collection[str], thing: Mention) -> list[str]:
        """Return the ids of what is known of some kinds, and may be what a mention tells of."""
        wholes = {*map(kind_of, kinds)}
        sights = self.sights
        seen = (one.object_id for one in self.of_kinds(wholes) if not is_piece(one.object_type))
        known = dict.fromkeys((*seen, *self._on_map(wholes)))
        return [one for one in known if one not in sights or self.fits(one, thing)]

    def place_told(self) -> Steps[dict[str, str] | None]:
        """Return the place that words tell of, type -> id; {}: any will do, None: there is none."""
        place = self.asked.deeds[0].place
        kinds = [] if place is None else self.kinds_of(place)
        if place is None or place.every:
            return {}
        if "empty" in states_told(place, kinds) and not object_types()[kinds[0]].can("pickupable"):
            return (yield from self._empty_place(place, kinds))
        if not self._is_told(place, kinds, _PUT):
            return {}
        alike = self._alike(kinds, replace(place, text="", states=(), at=()))
        if len(alike) < 2 and not object_types()[kinds[0]].can("pickupable"):
            return {}
        one = yield from self._the_one_told(place, kinds)
        return {kind_of(one): one} if one else None

    def _empty_place(self, place: Mention, kinds: Sequence[str]) -> Steps[dict[str, str] | None]:
        """Return the first place that is seen to hold nothing; None where there is none."""
        bare = replace(place, text="", states=())
        for name in self.places(kinds)[:PLACES]:
            yield self.go_to(name)
            if (sight := self.sights.get(name)) is None or not self.fits(name, bare):
                continue
            yield self.look_over(sight)
            if not self.holds_anything(name):
                return {kind_of(name): name}
        self.progress.short = True
        self.say(f"I found none that is empty: {spoken(kinds[0]).lower()}", "otherwise")
        return None

    def told_apart_by_words(self, kinds: Collection[str]) -> Steps[str | None]:
        """Return the one of several that words tell of; "" where none is, None: any will do."""
        deed = self.asked.deeds[0]
        thing = deed.things[0]
        found: str | None = None
        if thing.at and BURNER in kinds:
            found = self._burner_under(thing)
            on_it = [*map(kind_of, thing.at)]
            if not found and (yield from self.another(on_it, set())) is not None:
                found = self._burner_under(thing)
            if not found:
                yield refusal(RefusedRequest(kind="unclear", by="guard", words=(thing.text,)))
        elif self._is_told(thing, kinds, deed) or self.left_aside(kinds):
            found = yield from self._the_one_told(thing, kinds)
        elif thing.at or states_told(thing, kinds):  # "a clean plate": one that is, or is made so
            found = self.next_known(kinds, set(), thing)
        if found is None and self._is_one_of_some():
            found, alike = self._handled_last(kinds)
            if alike:
                yield refusal(RefusedRequest(kind="which", by="guard", words=alike))
                return ""
        if found is None and thing.other:
            found = yield from self._the_other(kinds)
        return self._not_so_yet(kinds, deed) if found is None else found

    def _not_so_yet(self, kinds: Collection[str], deed: SaidDeed) -> str | None:
        """Return the first that a deed would change, where others of its kinds are so already."""
        known = [one for one in self._alike(kinds, deed.things[0]) if one in self.sights]
        fresh = [one for one in known if not self.holds_already(one, deed, {})]
        switched = deed_kind(deed.deed).leaves in ("on", "off", "opened", "closed")
        return fresh[0] if switched and 0 < len(fresh) < len(known) else None

    def _is_told(self, thing: Mention, kinds: Collection[str], deed: SaidDeed) -> bool:
        """Return whether words tell which thing is meant: where it is, or how it is by now.

        "A clean plate" and "the hot potato" may be made so; "the clean plate" is one that is.
        """
        made = _MADE_SO | {deed_kind(deed.deed).leaves}
        made |= set() if self._is_definite(thing) else {"clean", "cleaned", "empty"}
        return self._lies_told(thing, deed) or bool({*states_told(thing, kinds)} - made)

    def _is_definite(self, thing: Mention) -> bool:
        words = self.asked.whole[thing.start :].lower()
        return thing.start < 0 or words.startswith(("the ", "my ", "that ", "this "))

    def _words_after(self, thing: Mention) -> str:
        return self.asked.whole[thing.end :].lower().lstrip()

    def _the_one_told(self, thing: Mention, kinds: Collection[str]) -> Steps[str]:
        """Return the thing that is as it is told, looked for there, then anywhere; "" for none."""

        def known() -> str | None:
            return self.next_known(kinds, self.left_aside(kinds), thing)

        one = known()
        places = [] if one else self.places({kind_of(kind) for kind in thing.at})
        if places:
            one = yield from self.looked_over(places[:PLACES], known)
        # where all such places were looked over it is nowhere else, save "from there" by mistake
        looked = 0 < len(places) <= PLACES and not self._words_after(thing).startswith("from ")
        while one is None:
            tried = {name for name in self.sights if kind_of(name) in kinds}
            found = None if looked else (yield from self.another(kinds, tried))
            if found is None and (one := self._only_one(thing, kinds)):
                where = " or ".join(told_place(kind) for kind in thing.at)
                self.say(f"the {name_of(one)} was {where}", "unseen")
                return one
            if found is None:
                self.progress.short = True
                where = " or ".join(spoken(kind).lower() for kind in thing.at)
                at = f" at the {where}" if where else ""
                so = "".join(f" that is {SAID_AS.get(one, one)}" for one in thing.states[:1])
                self.say(f"I found no {thing.text}{so}{at}", "otherwise")
                return ""
            one = known()
        return one

    def looked_over(
        self, places: Iterable[str], known: Callable[[], str | None]
    ) -> Steps[str | None]:
        """Look over places, each once, until a thing is known; returns it, None if it is not."""
        for place in (one for one in places if one not in self.looked_at):
            self.looked_at.add(place)
            yield self.go_to(place)
            if sight := self.sights.get(place):
                yield self.look_over(sight)
            if (one := known()) is not None:
                return one
        return None

    def _only_one(self, thing: Mention, kinds: Collection[str]) -> str:
        """Return the one thing there is that "from the desk" can be said of; "" for several."""
        if not self._words_after(thing).startswith("from ") or self.asked.deeds[0].deed in FOR_GOOD:
            return ""
        known = self._alike(kinds, replace(thing, at=()))
        return known[0] if len(known) == 1 else ""

    def left_aside(self, kinds: Collection[str]) -> set[str]:
        """Return the known things that a request leaves out: "but not the one on the desk"."""
        out = [one for one in self.asked.exclusions if one.at or one.states]
        return {
            name for name in self.sights if kind_of(name) in kinds
            for one in out
            if kind_of(name) in map(kind_of, one.types) and self.fits(name, one)
        }  # fmt: skip

    def _burner_under(self, thing: Mention) -> str:
        """Return the burner under a thing that it is told by; "" where none is known."""
        wanted = {*map(kind_of, thing.at)}
        stands = (
            parent for sight in self.sights.values() if kind_of(sight.object_id) in wanted
            for parent in sight.parent_ids if kind_of(parent) == BURNER
        )  # fmt: skip
        return next(stands, "")

    def _is_one_of_some(self) -> bool:
        """Return whether something is done for good to one thing, with no more words on which."""
        deed = self.asked.deeds[0]
        thing = deed.things[0]
        bare = not (thing.at or thing.other or thing.told or thing.vague or thing.holding)
        bare = bare and not stated(self.asked)  # "the cooked one"
        return deed.deed in FOR_GOOD and bare and thing.start >= 0 and self._is_definite(thing)

    def _handled_last(self, kinds: Collection[str]) -> tuple[str | None, tuple[str, ...]]:
        """Return the thing that was handled last, else in words those that fit alike: several."""
        seen = {
            name: one for name, one in self.sights.items()
            if kind_of(name) in kinds and not is_piece(one.object_type)
            and "sliced" not in one.states
        }  # fmt: skip
        last = next((one for one in reversed(self.handled()) if one in seen), None)
        words = (f"the {name_of(name)} {told_place(place_of(one))}" for name, one in seen.items())
        places = tuple(dict.fromkeys(words))
        return last, places if last is None and len(places) > 1 else ()

    def _lies_told(self, thing: Mention, deed: SaidDeed) -> bool:
        """Return whether the place behind a thing says which is meant, not where it is done."""
        kinds = object_types()
        own = (*LAMPS, *PARTS_OF_FURNITURE)  # what stands somewhere, or is of something
        carried = any(kinds[kind].can("pickupable") or kind in own for kind in thing.types)
        done_at = {*map(kind_of, deed_kind(deed.deed).put_in or deed_kind("wash").put_in)}
        there = deed.deed in ("put", "take") or not done_at & {*map(kind_of, thing.at)}
        holds = any(kinds[place].can("receptacle") for place in thing.at)  # not "from the tap"
        there = there and not self._goes_along(thing, deed)
        return holds and carried and (self._is_relative(thing) or there)

    def _is_relative(self, thing: Mention) -> bool:
        return self._words_after(thing).startswith(("that", "which"))

    def _goes_along(self, thing: Mention, deed: SaidDeed) -> bool:
        """Return whether it may go in what is carried: "the watch in the bowl on the shelf"."""
        carries = any(object_types()[place].can("pickupable") for place in thing.at)
        return deed.place is not None and carries and not self._is_relative(thing)

    def tell_left_behind(self, kinds: Collection[str]) -> None:
        """Say that nothing lies in what it was to go along in, where that is so."""
        deed = self.asked.deeds[0]
        thing = deed.things[0]
        seen = (one for one in self.sights.values() if kind_of(one.object_type) in kinds)
        if self._goes_along(thing, deed) and not any(_lies_at(one, thing.at) for one in seen):
            self.say(f"the {thing.text} is {told_place(thing.at[0])}", "otherwise")

    # ------------------------------------------------------------- one more of several

    def _the_other(self, kinds: Collection[str]) -> Steps[str | None]:
        """Return another thing than was meant before; "" for none, None: none was meant."""
        deed = self.asked.deeds[0]
        thing, whole = deed.things[0], self.asked.whole or self.asked.text
        meant = {one for (text, _), one in self.earlier.chosen.items() if text == whole}
        meant = {one for one in (*meant, *self.earlier.owned.values()) if kind_of(one) in kinds}
        pieces = thing.text.split()[-1] in request_words().pieces
        known = set() if pieces else {name for name in self.sights if kind_of(name) in kinds}
        if not meant:  # "another book", said after one was put away
            meant = {one for one in self.handled() if kind_of(one) in kinds}
            meant = {one for one in meant if self.holds_already(one, deed, {})}
        if not meant:  # "the other egg", "another mug": not the last one
            meant = self.meant_before(thing)
        if not meant:
            return None
        meant |= {name for name in known if root_id(name) in map(root_id, meant)}  # a cracked egg
        one = self.next_known(kinds, meant, thing)
        if one is None:
            one = yield from self.another(kinds, meant)
        if one is None or one in meant:
            self.progress.short = True
            self.say(f"I found no other {thing.text.removeprefix('other ')}", "otherwise")
            return ""
        return one

    def meant_before(self, thing: Mention) -> set[str]:
        """Return what was handled last of a kind, which "the other egg" is not."""
        kinds = {*self.kinds_of(thing)}
        last = [one for one in self.handled() if kind_of(one) in kinds]
        chosen = self.earlier.chosen.values()
        return {*(last or [one for one in chosen if kind_of(one) in kinds])[-1:]}

    def next_known(
        self, kinds: Collection[str], tried: Collection[str], thing: Mention
    ) -> str | None:
        """Return a thing that is known and was not tried."""
        for one in (*sorted(self.sights), *self._on_map(kinds)):
            fresh = kind_of(type_of(one)) in kinds and type_of(one) != KNOB and one not in tried
            if fresh and self.fits(one, thing):
                return one
        return None

    def another(self, kinds: Collection[str], tried: set[str]) -> Steps[str | None]:
        """Search for one more thing of some kinds; returns its id, None if there is none."""
        for kind in kinds:
            known = any(kind_of(one) == kind for one in tried)
            if known and not object_types()[kind].can("pickupable"):
                continue  # a tour has shown what stands or hangs free
            result = self.call(SkillCall.of("Explore", kind), aside=tried)
            yield result
            fresh = [one for one in result.object_ids if kind_of(one) == kind and one not in tried]
            if result.ok and fresh:
                return fresh[0]
        return None

    def _on_map(self, kinds: Collection[str]) -> list[str]:
        """Return the ids of the furniture of some kinds, each whole once: no knobs, no basins."""
        return [one for one in self.places(kinds) if type_of(one) in kinds]

    def of_kinds(self, kinds: Collection[str]) -> list[SeenObject]:
        """Return what was seen of some kinds, wholes before their basins."""
        found = [one for one in self.sights.values() if kind_of(one.object_type) in kinds]
        basins = [one for one in found if one.object_type in BASINS]
        return sorted(basins or found, key=lambda one: one.object_id)

    # ------------------------------------------------------------- how a thing is

    def fits(self, object_id: str, thing: Mention) -> bool:
        """Return whether a thing is at the place, and in the states, that a mention tells."""
        sight = self.sights.get(object_id)
        if thing.at and (sight is None or not self._is_at(sight, thing.at)):
            return False
        states = states_told(thing, [kind_of(object_id)])
        if "empty" in states and self.holds_anything(object_id):
            return False
        return not states or (sight is not None and is_all(states, sight))

    def holds_anything(self, name: str) -> bool:
        """Return whether something was seen in a place, or in its basin."""
        parents = (parent for one in self.sights.values() for parent in one.parent_ids)
        return any(parent.startswith(name) for parent in parents)

    def _is_at(self, sight: SeenObject, places: Sequence[str]) -> bool:
        """Return whether a thing lies at a place of some types, or is a part of one: its drawer."""
        kinds, part = {*map(kind_of, places)}, sight.object_type in PARTS_OF_FURNITURE
        wholes = (one for one in self.sights.values() if kind_of(one.object_type) in kinds)
        return _lies_at(sight, places) or (part and any(is_below(sight, one) for one in wholes))

    def holds_already(self, object_id: str, deed: SaidDeed, own: Mapping[str, str]) -> bool:
        """Return whether a deed would leave a thing as it is, by the agent's own eyes."""
        sight = self.sights.get(object_id)
        if sight is None or object_id in self.earlier.reported:  # so is only what its own eyes saw
            return False
        if deed.deed == "put" and deed.place is not None and not deed.near:
            kinds = {kind_of(kind) for kind in deed.place.types}
            places = {own[kind] for kind in kinds if kind in own}
            return any(
                parent in places if places else kind_of(parent) in kinds
                for parent in sight.parent_ids
            )
        if deed.deed == "take" and deed.place is None:
            return place_of(sight) == HAND
        after = deed_kind(deed.deed).leaves
        return after in _SHOWS and bool(sight.states) and is_so(after, sight)


def is_several(one: Mention) -> bool:
    """Return whether a mention means more than one thing."""
    return one.anything or one.every or (one.number or 1) > 1


def states_told(thing: Mention, kinds: Collection[str]) -> tuple[str, ...]:
    """Return the states that a thing is told by: "the empty roll", "the mug that is dirty"."""
    seen = request_words().seen
    words = [seen[word] for word in thing.text.lower().split()[:-1] if word in seen]
    ends = any(object_types()[kind].can("canBeUsedUp") for kind in kinds)
    states = (*words[:1], *thing.states)
    return tuple("used up" if one == "empty" and ends else one for one in states)


def is_all(states: Sequence[str], sight: SeenObject) -> bool:
    """Return whether a look shows a thing in all of some states."""
    return all(is_so(state, sight) for state in states)


def is_so(state: str, sight: SeenObject) -> bool:
    """Return whether a look shows a thing in a state."""
    shown = NOT_SO.get(state)
    if state in ("unbroken", "unsliced") and is_piece(sight.object_type):
        return False
    return state in sight.states or (shown is not None and shown not in sight.states)


def _lies_at(sight: SeenObject, places: Sequence[str]) -> bool:
    return any(kind_of(parent) in {*map(kind_of, places)} for parent in sight.parent_ids)


def is_below(sight: SeenObject, whole: SeenObject) -> bool:
    """Return whether the middle of a thing is within, or below, the box of a piece of furniture."""
    off = [abs(a - b) for a, b in zip(sight.box_center_m, whole.box_center_m, strict=True)]
    reach_x, reach_y, reach_z = (size / 2 for size in whole.box_size_m)
    top = whole.box_center_m[1] + reach_y
    return off[0] <= reach_x and off[2] <= reach_z and sight.box_center_m[1] <= top
