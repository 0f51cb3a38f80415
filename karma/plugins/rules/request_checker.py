"""A program is held against what was said before its first step, whoever wrote it.

Nothing is carried out that leaves out what was named, does what was ruled out, or changes what no
word speaks of. What the words ask for is in a `Request`, what the program brings about in
`ProgramEffects`; both are by types, so any mug will do for a mug.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace

from karma.agent.planning.turns import with_turns
from karma.household.pieces import EGG
from karma.household.places import HAND, OVERLOOKED, SURFACES, landmark_types
from karma.household.saying import preposition, spoken, told_place
from karma.household.skill_effects import Item
from karma.household.types import object_types
from karma.household.uses import (
    BIN,
    BURNER,
    COFFEE_CUP,
    COFFEE_MACHINE,
    COOKWARE,
    MICROWAVE,
    TOASTED,
    TOASTER,
    kind_of,
    switch_of,
)
from karma.plugins.rules.deeds import FOR_GOOD, able_to, deed_kind
from karma.plugins.rules.language.request_words import deed_states, request_words
from karma.plugins.rules.program_effects import ProgramEffects, effects_of
from karma.plugins.rules.types import Mention, Request, SaidDeed
from karma.plugins.rules.wording.hints import singular
from karma.types.planning import RefusalKind, RefusedRequest, SkillCall

# ----------------------------------------------------------------- before any planner


def cannot_serve(request: Request, here: Collection[str]) -> RefusedRequest | None:
    """Return why a request cannot be carried out, whatever the planner; None if it may be.

    `here`: types that the agent knows of in this room.
    """
    if not request.english:
        return _refused("language")
    if request.form != "errand":
        kinds: dict[str, RefusalKind] = {"question": "question", "incomplete": "incomplete"}
        return _refused(kinds.get(request.form, "statement"), *filter(None, [request.lacking]))
    if request.times:
        return _refused("time", *request.times)
    if request.unread:
        verbs = {deed.verb for deed in request.deeds if not deed.deed}
        kind: RefusalKind = "unclear" if verbs.isdisjoint(request.unread) else "deed"
        return _refused(kind, *request.unread)
    if not request.deeds:
        return _refused("negated")
    if unclear := [one.text for one in request.conditions if not one.state]:
        return _refused("unclear", *unclear)
    return next(filter(None, (_unknown(deed, here) for deed in request.deeds)), None)


def _refused(kind: RefusalKind, *words: str) -> RefusedRequest:
    return RefusedRequest(kind=kind, by="guard", words=words)


def _unknown(deed: SaidDeed, here: Collection[str]) -> RefusedRequest | None:
    """Return what of a deed is not known, not here, or cannot be."""
    for one in deed.things:
        if one.anything or one.told or (deed.deed == "coffee" and not one.types):
            continue
        kinds = meant_by(one, here)
        if not kinds:
            return _refused("place" if one.types else "thing", one.text)
        needs = (deed_kind(deed.deed).takes, "pickupable" if deed.deed == "fill" else "")
        able = any(all(able_to(kind, need) for need in needs if need) for kind in kinds)
        if deed.deed == "coffee" and not {*kinds} & {COFFEE_CUP, "Cup"}:
            return _refused("impossible", f"fill the {one.text} with coffee")
        if not able:  # a plant cannot be brought to the tap
            return _refused("impossible", f"{deed.verb} the {one.text}")
    return _unknown_place(deed, deed.place, here) if deed.place is not None else None


def _unknown_place(deed: SaidDeed, place: Mention, here: Collection[str]) -> RefusedRequest | None:
    if place.told:
        return _refused("unclear", place.text)
    kinds = meant_by(place, here)
    if not kinds:
        return _refused("place", place.text)
    holds = any(able_to(kind, "receptacle") for kind in kinds)
    if deed.deed == "put" and not deed.near and not holds:
        return _refused("impossible", f"{deed.verb} something in or on the {place.text}")
    return None


def here_of(types: Sequence[str], here: Collection[str]) -> tuple[str, ...]:
    """Return those of some types that may be in this room: seen there, or small enough to hide.

    Of several that a word may mean, those that were seen come alone.
    """
    kinds = {kind_of(one) for one in here}
    seen = tuple(kind for kind in types if kind in here or kind_of(kind) in kinds)
    if seen or not here:
        return seen or tuple(types)
    fixed = landmark_types() - OVERLOOKED  # a tour shows what stands or hangs free
    free = {one for one in types if not object_types()[one].can("pickupable")} - OVERLOOKED
    return tuple(kind for kind in types if kind not in fixed | free)


def meant_by(one: Mention, here: Collection[str]) -> tuple[str, ...]:
    """Return those of the types that a mention may mean that may be in this room.

    Where none that is called so was seen, one that people call so as well will do.
    """
    named = here_of(one.types, here)
    return named if _was_seen(named, here) else (*named, *_besides(one, here))


def _admitted(one: Mention, here: Collection[str]) -> tuple[str, ...]:
    """Return the same with what is one by its name: a side table is a table, whatever is here.

    But an arm chair is no chair where one stands that is called so and nothing else.
    """
    meant = meant_by(one, here)
    own = [kind for kind in meant if spoken(kind).lower() == singular(one.text.lower().split()[-1])]
    if _was_seen(own, here):
        return meant
    by_name = (kind for kind in _besides(one, here) if _is_a(kind, one))
    return tuple(dict.fromkeys((*meant, *by_name)))


def _besides(one: Mention, here: Collection[str]) -> tuple[str, ...]:
    """Return the types that people call so as well and that are here for certain."""
    return tuple(
        kind for kind in here_of(one.besides, here)
        if _was_seen((kind,), here) or not object_types()[kind].can("pickupable")
    )  # fmt: skip


def _was_seen(kinds: Sequence[str], here: Collection[str]) -> bool:
    wholes = {kind_of(kind) for kind in here}
    return any(kind_of(kind) in wholes for kind in kinds)


def _is_a(kind: str, one: Mention) -> bool:
    """Return whether the word for a type ends with that of a mention: a soap *bottle*."""
    return spoken(kind).lower().split()[-1] == singular(one.text.lower().split()[-1])


# ----------------------------------------------------------------- a program


@dataclass(frozen=True, slots=True)
class Guard:
    """What a request asks, in a room of which some types are known."""

    request: Request
    here: Collection[str]

    def stopped(
        self, calls: Sequence[SkillCall], held: str | None = None,
        *, exact: bool = False, begun: bool = False,
    ) -> str:  # fmt: skip
        """Return why a program is not what was asked; "" where it is.

        `held` is in the hand before. With `exact` what people call so as well will not do: no mug
        for a cup. What was `begun` need not be done again.
        """
        found = effects_of(with_turns(calls), held)
        narrow = Guard(_told_apart(self._exactly() if exact else self.request), self.here)
        left_out = () if begun else (narrow._left_out,)
        checks = (narrow._ruled_out, *left_out, narrow._not_asked, narrow._too_many)
        return next((reason for check in checks for reason in check(found)), "")

    def put_near(self, calls: Sequence[SkillCall]) -> tuple[SkillCall, ...]:
        """Return a program that puts near a place what was to be there: planners put it on it."""
        found = list(calls)
        for deed in self.request.deeds:
            places = here_of(deed.place.types, self.here) if deed.place and deed.near else ()
            kinds = self._of_things(deed)
            puts = (
                n for n, call in enumerate(found) if call.skill == "PutObject"
                and call.objects[1:] and kind_of(call.objects[0]) in kinds
            )  # fmt: skip
            last = max(puts, default=None) if deed.deed == "put" and places else None
            if last is not None:
                thing, onto = found[last].objects
                place = kind_of(places[0])
                found[last] = replace(found[last], skill="PutNear", objects=(thing, place))
                if place not in self.here:  # what is not known yet is looked for
                    before = found[last - 1]
                    goes = before.skill == "GoToObject" and before.objects == (onto,)
                    found[last - goes : last] = [SkillCall.of("Explore", place)]
        return tuple(found)

    def kept_open(self, calls: Sequence[SkillCall]) -> tuple[SkillCall, ...]:
        """Return a program that does not close what the same sentence asks to open."""
        rest = self.request.rest
        deeds = [*rest, *(one for one in self.request.deeds if one not in rest)]
        last = {kind: one.deed for one in deeds if one.deed in ("open", "close")
                for kind in self._of_things(one)}  # fmt: skip
        stay = {kind for kind, deed in last.items() if deed == "open"}
        return tuple(
            one
            for one in calls
            if not (one.skill == "CloseObject" and kind_of(one.objects[0]) in stay)
        )

    def in_pieces(self) -> set[str]:
        """Return the kinds of which a piece is meant: "a slice of bread", "the cut apple"."""
        words = request_words().pieces | {"sliced", "cut"}
        return {
            kind for one in self.request.mentions
            if words & set(self.request.whole[one.start : one.end].lower().split())
            for kind in (*self._kinds(one), *map(kind_of, one.holding))
        }  # fmt: skip

    def _kinds(self, one: Mention | None) -> frozenset[str]:
        """Return the kinds of wholes that a mention may mean; none for none."""
        if one is None:
            return frozenset()
        return frozenset(kind_of(kind) for kind in _admitted(one, self.here) or one.types)

    def _of_things(self, deed: SaidDeed) -> frozenset[str]:
        return frozenset(kind for one in deed.things for kind in self._kinds(one))

    def _ruled_out(self, found: ProgramEffects) -> Iterator[str]:
        """Yield what the request says not to do."""
        asked = {kind for one in self.request.mentions for kind in self._kinds(one)}
        for one in self.request.exclusions:
            for kind in sorted(self._kinds(one) - asked):
                touched = {kind_of(item.name) for item in found.beliefs.places}
                touched |= {kind_of(item.name) for _, item in found.deeds}
                passed = {place for thing, places in found.passed.items()
                          for place in (*places, found.at.get(thing))}  # fmt: skip
                if kind in {*found.switched, *found.doors, *touched, *passed}:
                    yield f"it says not to use the {one.text}"
        for deed in self.request.forbidden:
            if _does(found, deed, self._of_things(deed)):
                yield f"it says not to {deed.verb}"

    def _left_out(self, found: ProgramEffects) -> Iterator[str]:
        """Yield what was named and is not done."""
        for deed in self.request.deeds:
            places = self._kinds(deed.place)
            for one in deed.things:
                kinds = self._kinds(one)
                if one.told or one.anything or not kinds:
                    moved = {kind_of(thing.name) for thing in found.at}
                    kinds = frozenset((*moved, *found.doors, *found.switched))
                if deed.deed == "coffee":
                    kinds = frozenset((COFFEE_CUP, "Cup"))
                if not _done(found, deed, kinds, places, _after(self.request, deed, one)):
                    yield f"it does not {deed.verb} the {one.text}{_told_place(deed)}"
                if place := _not_done_at(found, deed, one, kinds):
                    yield f"it does not {deed.verb} the {one.text} {told_place(place)}"
            coffee = deed.deed == "coffee" and not deed.things
            if coffee and not found.did("coffee", (COFFEE_CUP, "Cup")):
                yield "it makes no coffee"

    def _not_asked(self, found: ProgramEffects) -> Iterator[str]:
        """Yield what a program changes and no word speaks of."""
        all_deeds = tuple(dict.fromkeys((*self.request.deeds, *self.request.rest)))
        request = replace(self.request, deeds=all_deeds)
        whole = Guard(request, self.here)
        deeds = {deed.deed for deed in request.deeds} | stated(request)
        pieces = whole.in_pieces()
        deeds |= {"slice"} if pieces else set()
        named = {kind for one in request.mentions for kind in self._kinds(one)}
        loose = any(one.anything or one.told for one in request.mentions)
        things = {kind for deed in request.deeds for kind in self._of_things(deed)}
        places = {kind for deed in request.deeds for kind in self._kinds(deed.place)}
        along = {kind for deed in deeds for kind in deed_kind(deed).tools}
        help_ = {kind for deed in deeds for kind in deed_kind(deed).put_in} | places
        help_ |= {
            kind for one in request.deeds if one.deed == "on" for kind in self._of_things(one)
        }
        help_ |= {kind_of(kind) for one in request.mentions for kind in one.at}
        for thing, place in found.at.items():
            kind = kind_of(thing.name)
            if kind in along or loose:
                continue
            if kind in things:
                yield from self._misplaced(found, thing, whole, help_)
            elif not (
                (kind in named and place == HAND)
                or whole._goes_along(found, thing)
                or whole._bears(found, thing)
                or (thing == found.began and place in (HAND, *SURFACES))
            ):
                yield f"nobody asked for the {spoken(kind)} to be moved"
        for deed, thing in sorted(found.deeds):
            kind = kind_of(thing.name)
            own = {
                one.deed for one in request.deeds
                if loose or not one.things or kind in self._of_things(one)
            }  # fmt: skip
            cut = deed == "slice" and (kind in pieces or (kind == TOASTED and "toast" in own))
            cracked = deed == "break" and kind == EGG and "cook" in own
            binned = deed == "throw" and BIN in places and kind in things
            if deed in FOR_GOOD and not (deed in own or cut or cracked or binned):
                yield f"nobody asked to {deed} the {spoken(kind)}"
        runs = {kind for deed in deeds for kind in deed_kind(deed).runs}
        switched = {
            switch_of(kind) for deed in request.deeds if deed.deed in ("on", "off")
            for kind in self._of_things(deed)
        }  # fmt: skip
        for kind in sorted(found.switched):
            if kind not in runs | switched and not (loose and deeds & {"on", "off"}):
                word = found.switched[kind]
                harmless = _momentary(kind) or bool(deeds & {"close", "open"})
                if not (word == "off" and kind not in found.ran and harmless):
                    yield f"nobody asked to switch {word} the {spoken(kind)}"

    def _too_many(self, found: ProgramEffects) -> Iterator[str]:
        """Yield that something is done to more things of a kind than were named."""
        deeds = tuple(dict.fromkeys((*self.request.deeds, *self.request.rest)))
        said = {(one.start, one) for deed in deeds for one in deed.things}
        if any(one.anything or one.told or one.every for _, one in said):
            return
        for kind in sorted({kind_of(thing.name) for thing in found.at}):
            named = [one.number or 1 for _, one in said if kind in self._kinds(one)]
            turns = {turn for name, turn in found.at if kind_of(name) == kind}
            if named and len(turns) > sum(named):
                yield f"it does it to {len(turns)} of a kind: {spoken(kind)}"

    def _exactly(self) -> Request:
        """Return a request whose things are only what they are called, where that may be here.

        What is one by its name will do where no other was seen: a spray bottle, where there is
        no plain one.
        """

        def only(one: Mention) -> Mention:
            if _was_seen(one.types, self.here):
                return replace(one, besides=())
            besides = tuple(k for k in one.besides if _is_a(k, one) and _was_seen((k,), self.here))
            return replace(one, besides=besides) if here_of(one.types, self.here) else one

        return _with_mentions(self.request, only)

    def _goes_along(self, found: ProgramEffects, thing: Item) -> bool:
        """Return whether a thing comes to lie where it was said to: "the plate with the potato"."""
        return any(
            kind_of(thing.name) in map(kind_of, one.holding)
            and not found.places(thing).isdisjoint(self._kinds(one))
            for one in self.request.mentions
        )

    def _bears(self, found: ProgramEffects, thing: Item) -> bool:
        """Return whether a thing goes where what lies in it shall.

        The mug of "the pen in the mug on the desk" may be the one on the desk, or be brought there;
        so with "in the mug, put it on ...".
        """
        puts = [deed for deed in self.request.deeds if deed.deed == "put"]
        for deed in puts:
            borne = self._of_things(deed)
            into = {kind_of(kind) for one in deed.things for kind in one.at}
            for other in puts:
                into |= self._kinds(other.place) if borne & self._of_things(other) else set()
            ends = found.places(thing) & self._kinds(deed.place)
            if kind_of(thing.name) in into and ends and not deed.near:
                return True
        return False

    def _misplaced(
        self, found: ProgramEffects, thing: Item, whole: "Guard", help_: Collection[str]
    ) -> Iterator[str]:
        """Yield that a named thing comes to a place that nobody spoke of.

        `whole` has what the sentence asks besides, which may be done as well; `help_` are kinds of
        places where things may be put on the way.
        """
        kind, place = kind_of(thing.name), found.at[thing]
        wanted, besides = self._goes_to(kind), whole._goes_to(kind)
        rests = (BURNER,) if kind in COOKWARE else ()  # where it may be put that was to go nowhere
        if found.places(thing) & (besides or set()):
            return
        if wanted:
            yield f"the {spoken(kind)} is to be elsewhere"
        elif wanted is None and place not in (HAND, *help_, *SURFACES, *rests):
            yield f"nobody asked for the {spoken(kind)} to be put {spoken(place)}"

    def _goes_to(self, kind: str) -> set[str] | None:
        """Return where a thing is to be put: kinds, none where any will do; None: nowhere."""
        puts = [
            one for one in self.request.deeds if one.deed == "put" and kind in self._of_things(one)
        ]
        return {place for deed in puts for place in self._kinds(deed.place)} if puts else None


def _does(found: ProgramEffects, deed: SaidDeed, kinds: Collection[str]) -> bool:
    """Return whether a program does a deed to one of some kinds, to any if there are none."""
    every = not kinds
    match deed.deed:
        case "on" | "open" | "off" | "close":
            done = {
                "on": found.ran,
                "open": found.opened,
                "off": {kind for kind, word in found.switched.items() if word == "off"},
                "close": {kind for kind, word in found.doors.items() if word == "close"},
            }[deed.deed]
            return any(every or kind in kinds for kind in done)
        case "put" | "take":
            things = [thing for thing in found.at if every or kind_of(thing.name) in kinds]
            places = {*deed.place.types} if deed.place else None
            return any(places is None or found.places(thing) & places for thing in things)
        case _:
            return any(
                one == deed.deed and (every or kind_of(thing.name) in kinds)
                for one, thing in found.deeds
            )


def _told_place(deed: SaidDeed) -> str:
    """Return where a deed was to put something, in words: " in the fridge"; "" for nowhere."""
    if deed.place is None:
        return ""
    word = preposition(deed.place.types[0]) if deed.place.types and not deed.near else "near"
    return f" {word} the {deed.place.text}"


def _not_done_at(
    found: ProgramEffects, deed: SaidDeed, one: Mention, kinds: Collection[str]
) -> str:
    """Return the place that a deed was to be done in and is not: "boil the egg in the pot"."""
    at = {*map(kind_of, one.at)} & (deed_kind(deed.deed).put_in - {"Plate", "Bowl"})
    things = found.of(kinds)
    passed = {place for thing in things for place in found.passed.get(thing, ())}
    passed |= {place for thing in things for place in found.places(thing)}
    moved = {kind_of(thing.name) for thing in found.at}  # it may lie in it already
    return min(at) if at and things and not at & (passed | moved) else ""


def _after(request: Request, deed: SaidDeed, one: Mention) -> list[SaidDeed]:
    """Return the later deeds of the request that are about the same thing."""
    later, types = request.deeds[request.deeds.index(deed) + 1 :], {*one.types}
    return [other for other in later if any(types & {*two.types} for two in other.things)]


def _done(
    found: ProgramEffects, deed: SaidDeed, kinds: Collection[str], places: Collection[str],
    later: Sequence[SaidDeed],
) -> bool:  # fmt: skip
    """Return whether a program does what was said to a thing of some kinds."""
    things = found.of(kinds)
    match deed.deed:
        case "put":
            if any(other.deed == "put" for other in later):
                return bool(things)
            if not places:
                return any(found.at[thing] != HAND for thing in things)
            return any(
                bool(found.places(thing) & set(places)) and (thing in found.near) == deed.near
                for thing in things
            )
        case "take":
            moved = any(other.deed in ("put", "throw") for other in later)
            return bool(things) if moved or later else any(found.at[one] == HAND for one in things)
        case "find" | "go" | "look":
            return bool(found.visited & set(kinds))
        case "on" | "off":
            ran = {kind for kind in kinds if deed.deed == "on" and _momentary(kind)} & found.ran
            left = (found.switched.get(switch_of(kind)) == deed.deed for kind in kinds)
            return bool(later or ran) or any(left)
        case "open" | "close":
            if later:
                return bool(found.visited & set(kinds))
            return any(found.doors.get(kind) == deed.deed for kind in kinds)
        case _ if later:  # "heat it and put it in the fridge"
            return any(
                done == deed.deed and kind_of(item.name) in kinds for done, item in found.ever
            )
        case _:
            return found.did(deed.deed, kinds)


def _momentary(kind: str) -> bool:
    return kind in (MICROWAVE, TOASTER, COFFEE_MACHINE, BURNER)


def _told_apart(request: Request) -> Request:
    """Return a request in which a mug is no cup where both are named: "the mug and the cup"."""
    others = (one for deed in request.rest for one in deed.things)
    named = [{*one.types} for one in (*request.mentions, *others)]

    def of(one: Mention) -> Mention:
        others = {kind for kinds in named if kinds.isdisjoint(one.types) for kind in kinds}
        return replace(one, besides=tuple(kind for kind in one.besides if kind not in others))

    return _with_mentions(request, of)


def _with_mentions(request: Request, changed: Callable[[Mention], Mention]) -> Request:
    """Return a request of which each thing and place is changed."""

    def of(deed: SaidDeed) -> SaidDeed:
        place = changed(deed.place) if deed.place else None
        return replace(deed, things=tuple(map(changed, deed.things)), place=place)

    return replace(
        request, deeds=tuple(map(of, request.deeds)), rest=tuple(map(of, request.rest))
    )  # fmt: skip


def stated(request: Request) -> set[str]:
    """Return the deeds that make things as they are named: "the washed cloth", "a cold apple"."""
    said = (request.whole[one.start : one.end].lower().split()[:-1] for one in request.mentions)
    words = {word for one in said for word in one}
    water = {"fill"} if "water" in request.whole.lower().split() else set()
    return water | {deed_states()[word] for word in words & deed_states().keys()} - {*FOR_GOOD}
