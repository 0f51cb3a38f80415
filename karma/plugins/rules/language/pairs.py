"""Things with the places that go with them: "the mug on the desk and the pen in the drawer"."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from karma.household.places import HAND
from karma.household.saying import preposition
from karma.household.types import types_with
from karma.household.uses import (
    BASIN_OF,
    BASINS,
    BELOW_SINKS,
    BURNER,
    FAUCET,
    FRIDGE,
    HAVE_PARTS,
    KNIVES,
    LAMPS,
    MICROWAVE,
    PARTS_OF_FURNITURE,
    WASHED_WITH,
)
from karma.plugins.rules.language.nouns import Nouns
from karma.plugins.rules.language.request_words import deed_states, deed_verbs, request_words
from karma.plugins.rules.language.sentence import SaidSentence
from karma.plugins.rules.types import Mention
from karma.plugins.rules.wording.hints import singular
from karma.plugins.rules.wording.words import word_lists

_TOOLS = {
    "slice": frozenset(KNIVES),
    "wash": frozenset((*WASHED_WITH, FAUCET)),
    "look": frozenset(LAMPS),
    "heat": frozenset((MICROWAVE, BURNER)),
    "cook": frozenset((MICROWAVE, BURNER)),
    "cool": frozenset((FRIDGE,)),
}  # deed -> what it may be done with
_WITH = ("water", "soap", "coffee", "care", "hands", HAND)  # that need no reading
_PICKS = frozenset(("fetch", "grab", "pick", "find", "locate", "retrieve", "give", "pass"))
_CLAUSES = ("that", "which", "who", "whose", "you", "i", "we")  # "the light you switched off"
DONE_AT_PLACES = ("heat", "cool", "cook", "toast", "fill", "look")  # to a thing, at a place
_BELOW = ("under", "underneath", "beneath", "below")
_LIES = ("is", "are", "'s", "lies", "lie", "lying", "stands", "sits", "was", "were", "sitting")


@dataclass(frozen=True, slots=True, kw_only=True)
class Pair:
    """Things, and where they go."""

    things: tuple[Mention, ...] = ()
    place: Mention | None = None
    near: bool = False


@dataclass(slots=True)
class _PairGroup:
    """Things, and the places that are named with them."""

    things: list[Mention] = field(default_factory=list)
    places: list[Mention] = field(default_factory=list)
    near: bool = False
    at: tuple[str, ...] = ()  # of things that are named afterwards
    held: bool = False  # "in it" says what was just said: "with a pen in it"

    def tell(self, *, states: Sequence[str] = (), marks: Sequence[str] = (), **more: Any) -> None:
        """Say more of the last thing."""
        last = self.things[-1]
        states, marks = (*last.states, *states), (*last.marks, *marks)
        self.things[-1] = replace(last, states=states, marks=marks, **more)

    def told_by(self, place: Mention, deed: str) -> None:
        """Take a place that says which thing is meant."""
        if self.things:
            whole = (f"from the {place.text}",) if place.at else ()  # "the desk drawer"
            self.tell(states=place.states, marks=(*place.marks, *whole), at=place.types)
        elif deed in ("wash", "look"):
            self.things.append(place)
        else:
            self.at = place.types

    def _goal(self) -> Mention | None:
        """Return the place that is meant: of a drawer and its desk it is the drawer."""
        if not self.places:
            return None
        first, last = self.places[0], self.places[-1]
        inner = first.types and PARTS_OF_FURNITURE.issuperset(first.types)
        return replace(first, at=last.types) if inner and {*last.types} & HAVE_PARTS else last

    def pair(self, deed: str) -> Pair:
        """Return the things, and where they go; other places say which things are meant."""
        things, place = self.things, self._goal()
        if place is not None and place.at and place.every:  # any of the desk's drawers
            place = replace(place, every=False)
        if things and place is not None and place.start != self.places[0].start:
            first, marks = self.places[0], things[-1].marks + self.places[0].marks
            things = [*things[:-1], replace(things[-1], at=first.types, marks=marks)]
        if self.at:
            things = [replace(one, at=one.at or self.at) for one in things]
        if deed not in ("put", "take", "") and place is not None:
            if not things:
                return Pair() if deed in DONE_AT_PLACES else Pair(things=(place,))
            if deed not in ("throw", "go"):
                things = [replace(one, at=one.at or place.types) for one in things]
                return Pair(things=tuple(things))
        return Pair(things=tuple(things), place=place, near=self.near)


class Pairs:
    """Reads what goes with a verb."""

    def __init__(self, sentence: SaidSentence, nouns: Nouns) -> None:
        self._s, self._nouns = sentence, nouns

    # ------------------------------------------------------------- verbs with particles

    def deed_at(self, number: int) -> tuple[str, str, int]:
        """Return the deed of the verb here, its text, and how many words it has."""
        table, after = deed_verbs(), self._s.low(number + 1)
        for lemma in self._s.lemmas(number):
            text = f"{lemma} {after}"
            if text in table and self._is_particle(number, after, table[text]):
                return table[text], text, 2
        for lemma in self._s.lemmas(number):
            if lemma in table:
                return table[lemma], lemma, 1
        return "", self._s.words[number].lemma, 1

    def _is_particle(self, number: int, after: str, deed: str) -> bool:
        """Return whether a word behind a verb belongs to it, and leads to no place."""
        if not self._s.begins_noun(number + 2):
            return True
        return deed != "put" or after in ("down", "back", "away", "over")

    def particle_later(self, number: int, end: int) -> tuple[str, str] | None:
        """Return deed and verb of "turn the lamp on": the particle stands behind its object."""
        table = deed_verbs()
        passed = number + 2
        for at in range(number + 2, end):
            low = self._s.low(at)
            if low in _CLAUSES and at >= passed:  # "the lamp that you switched on"
                passed = max(self._nouns.done_before(at, end), at + 1)
            if at < passed:
                continue
            result = low in request_words().results
            if at in self._s.taken or not (result or low in word_lists().particles):
                continue
            ends = at + 1 >= end or not self._s.begins_noun(at + 1)
            follows = ends or self._s.low(at + 1) in ("and", "then") or low in ("away", "out")
            if self._s.low(number) in ("put", "get", "set") and low in ("on", "off"):
                follows = follows and not self.has_place(range(number + 1, at))
            for lemma in self._s.lemmas(number):
                text = f"{lemma} {low}"
                if text in table and follows and self._s.low(at + 1) != "of":
                    self._s.taken.add(at)
                    return table[text], text
            if result and follows:
                self._s.taken.add(at)
                return deed_states()[low], f"{self._s.low(number)} {low}"
        return None

    # ------------------------------------------------------------- things and places

    def read(self, body: range, deed: str) -> list[Pair]:
        """Return what goes with a deed, at least one pair; only the last may lack its place."""
        found = [_PairGroup()]
        passed = False  # a phrase by the way, which a bare noun may go on: "about cars and planes"
        for number, one in self._nouns.mentions(body):
            before = self.preposition(number, body.start)
            bare = self._s.low(number - 1) == "and" and self._s.tag(number)[:2] in ("NN", "JJ")
            if passed and bare:
                continue
            passed = before in request_words().tools | request_words().passed_over - {"of"}
            if not self._is_by_the_way(number, one, before, deed, found[-1]):
                self._take_in(number, one, before, deed, found, body.start)
        self._somewhere(body, deed, found[-1])
        pairs = [group.pair(deed) for group in found]
        if len(pairs) > 1 and pairs[-1].place is None:
            pairs[-1] = replace(pairs[-1], place=pairs[-2].place, near=pairs[-2].near)
        return pairs

    def _is_by_the_way(
        self, number: int, one: Mention, before: str, deed: str, group: _PairGroup
    ) -> bool:
        """Return whether a phrase is neither thing nor place: "me", "for lunch", "with a knife"."""
        low, words = self._s.low(number), request_words()
        if low in words.me and before in ("", "to", "for"):
            return True
        if self._is_region(number, one, group) or (group.held and one.text in ("it", "them")):
            return True
        if low in ("you", "i", "we"):
            return True
        if before in words.tools:
            self._read_with(number, one, deed, group)
            return True
        if before in words.passed_over and before != "of" and group.things:
            if before in ("as", "like", "than"):
                self._s.unread.append(one.text)
            return True
        pieces = one.text.split()[-1] in words.pieces
        if deed == "slice" and group.things and before in ("into", "in") and pieces:
            return True  # "into slices"
        helps = deed in ("wash", "fill") and bool(group.things)
        return helps and one.text in ("water", "soap") and not one.at

    def _read_with(self, number: int, one: Mention, deed: str, group: _PairGroup) -> None:
        """Read "with the salt": a name, what lies in a thing, or what something is done with."""
        if self._names_together(group, one):
            return
        if group.places and deed in ("put", "take"):  # "on the chair with the keys on it"
            group.held = True
            if self._holds(group, deed):  # or "the pan on the counter with an egg in it"
                group.tell(holding=(*group.things[-1].holding, *one.types, *one.besides))
            return
        if self._holds(group, deed):
            group.tell(holding=(*one.types, *one.besides), end=one.end)
            group.held = True
        else:
            self._read_tool(one, deed)

    def _is_region(self, number: int, one: Mention, group: _PairGroup) -> bool:
        """Return whether a phrase only says where at a place: "the back of", "in the corner"."""
        said = one.text.split()
        if one.types or said[-1] not in request_words().regions:
            return False
        if len(said) > 1 and self._is_listed(number):
            return False  # "the mug and the box top"
        near = range(number, number + 5)
        last = next((n for n in near if self._s.low(n) == said[-1]), number)
        if self._s.low(last + 1) == "of":
            return True
        for told in (group.places, group.things):
            if told and said[-1] in request_words().marks:  # "the drawer on the left"
                told[-1] = replace(told[-1], marks=(*told[-1].marks, said[-1]))
                return True
        return bool(group.things or group.places)

    def _names_together(self, group: _PairGroup, one: Mention) -> bool:
        """Read "the shaker with the salt" as what is called a salt shaker."""
        last = group.things[-1] if group.things else None
        types = self._s.lexicon.named(f"{singular(one.text)} {last.text}") if last else ()
        if last is None or not types:
            return False
        group.tell(types=types)
        return True

    def _holds(self, group: _PairGroup, deed: str) -> bool:
        """Return whether "with" tells what is in a thing: "carry the plate with the potato"."""
        kinds = {kind for one in group.things[-1:] for kind in one.types}
        carries = deed in ("put", "take", "throw", "find", "heat", "cool")
        return carries and bool(kinds & types_with("receptacle"))

    def _take_in(
        self, number: int, one: Mention, before: str, deed: str, found: list[_PairGroup], least: int
    ) -> None:
        group, words = found[-1], request_words()
        if self._is_alternative(number, one, before, group):
            return
        if self._tells_of_place(number, one, before, group):
            return
        nothing = not (one.types or one.vague or one.anything or one.told)
        if nothing and before in words.links and (deed != "put" or before in words.sources):
            self._s.unread.append(one.text)
        elif before in words.sources or self._is_relative(number, least):
            group.told_by(one, deed)
        elif before in words.destinations and not (deed == "look" and before == "at"):
            lies = deed == "take" and self._picks(least) and before not in ("to", "into", "onto")
            if (deed not in ("put", "take") or lies) and group.things:
                group.told_by(one, deed)
            else:
                self._goes_to(number, one, before, deed, group)
        elif not (group.places and deed in ("put", "take")):
            group.things.append(one)
        elif self._is_listed(number) and group.things:
            found.append(_PairGroup([one]))
        else:
            self._s.unread.append(one.text)

    def _tells_of_place(self, number: int, one: Mention, before: str, group: _PairGroup) -> bool:
        """Read what only says which place is meant: "the drawer of the desk", "by the sink"."""
        words = request_words()
        if before == "of" and group.places and group.places[-1].types and not self._is_part(group):
            return True  # "the front burner of the stove"
        if before in ("of", "in", "inside", "within") and self._is_part(group) and one.types:
            if types_with("openable").issuperset(one.types) and not _is_carried(one):
                group.places[-1] = one  # "the top shelf of the fridge"
                return True
            if before == "of" or {*one.types} & HAVE_PARTS:
                group.places[-1] = replace(group.places[-1], at=one.types)
                return True
        of = self._s.low(number - 1) == "of" and self._s.low(number - 2) in words.regions
        told = bool(group.places) and (of or before in words.near | words.beside)
        if told and not of and _is_carried(one):
            last = group.places[-1]
            if _is_carried(last):  # "on a plate near the bread"
                group.places[-1] = replace(last, marks=(*last.marks, f"{before} {one.text}"))
            else:  # "on the bed under the pillow"
                self._s.unread.append(f"{before} {one.text}")
        return told

    def _is_part(self, group: _PairGroup) -> bool:
        """Return whether the last place is a part of furniture."""
        last = group.places[-1].types if group.places else ()
        return bool(last) and PARTS_OF_FURNITURE.issuperset(last)

    def _is_alternative(self, number: int, one: Mention, before: str, group: _PairGroup) -> bool:
        """Return whether a phrase is an alternative to the one before it: "or a pencil"."""
        joint = self._s.low(number - 1)
        if before and joint == before and self._s.low(number - 2) == "or" and group.places:
            joint, before = "or", ""  # "in the sink or in the tub"
        either = group.places or group.things  # any of them will do
        if joint != "or" or before or not (one.types and either):
            return False
        types = dict.fromkeys((*either[-1].types, *one.types))
        either[-1] = replace(either[-1], types=tuple(types))
        return True

    def _beyond(self, number: int, one: Mention, before: str) -> list[str]:
        """Return what is said of a place and cannot be served: "on top of the fridge"."""
        into = bool(one.types) and all(preposition(kind) == "in" for kind in one.types)
        found = ["on top"] if before == "atop" and into else []
        each = self._s.low(number) in ("each", "every", "both")
        return [*found, f"{self._s.low(number)} {one.text}"] if each and one.types else found

    def _picks(self, after: int) -> bool:
        """Return whether the verb ahead only takes up: "fetch the cup on the table"."""
        return any(self._s.words[n].lemma in _PICKS for n in (after - 2, after - 1) if n >= 0)

    def _read_tool(self, one: Mention, deed: str) -> None:
        """Read what a thing is done with; what is no tool for it is not understood."""
        if one.text in ("it", "that") and deed in _TOOLS:
            return  # the tool that was just taken up
        if not (set(one.types) & _TOOLS.get(deed, frozenset()) or one.text in _WITH):
            self._s.unread.append(f"with {one.text}")

    def _somewhere(self, body: range, deed: str, group: _PairGroup) -> None:
        """Read "there" and "where the newspaper is" as the place of a thing."""
        if group.places and deed == "put":  # "move the books on the desk elsewhere"
            self._s.unread += {"elsewhere", "somewhere"}.intersection(map(self._s.low, body))
        if group.places or deed not in ("put", "take"):
            return
        ends = (".", "!", "?", ",", ";", "and", "then")
        last = next((n for n in reversed(body) if self._s.low(n) not in ends), -1)
        for number in body:
            low = self._s.low(number)
            there = low in request_words().elsewhere and number not in self._s.taken
            if deed == "put" and (there or (low in ("in", "inside") and number == last)):
                self._s.taken.add(number)
                word = self._s.words[number]
                text = low if there else "there"
                group.places.append(Mention(text=text, start=word.start, end=word.end, vague=True))
                return
            if low == "where" and number not in self._s.gone:
                self._s.taken.update(body[number - body.start :])
                text = self._s.phrase(number, body.stop).rstrip(" .,!?")
                start = self._s.words[number].start
                group.things = [one for one in group.things if one.start < start]
                if self._s.low(number - 1) in request_words().sources:
                    return  # "from where it is"
                place = Mention(text=text, start=start, end=start + len(text), told=True)
                group.places.append(place)
                return

    def _is_listed(self, number: int) -> bool:
        before = number - 1
        while before >= 0 and self._s.tag(before) in ("DT", "PRP$", "CD", "PDT", "JJ", "NN"):
            before -= 1
        while before >= 0 and self._s.low(before) in request_words().sequence:
            before -= 1
        return self._s.low(before) in ("and", ",", "or", ";")

    def _goes_to(
        self, number: int, one: Mention, before: str, deed: str, group: _PairGroup
    ) -> None:
        """Take a place where something is to go."""
        self._s.unread += self._beyond(number, one, before)
        if group.near:  # "next to the toaster, on the counter"
            group.places.clear()
        group.near = before in request_words().near | (request_words().beside - {"under", "over"})
        if deed == "put" and before in _BELOW and {*one.types} & {*BASINS, *BASIN_OF}:
            one, group.near = replace(one, types=BELOW_SINKS), False
        elif deed == "put" and before in _BELOW and _has_no_room_below(one):
            self._s.unread.append(f"{before} {one.text}")  # nothing is put there
        self._s.unread += ["between"] if before == "between" else []
        group.places.append(one)

    def preposition(self, number: int, least: int) -> str:
        """Return the preposition that a phrase beginning here stands behind; "" for none."""
        before = number - 1
        while before >= least and self._s.low(before) in ("both", "all", "up", "down"):
            before -= 1
        if before < least:
            return ""
        word, earlier = self._s.low(before), self._s.low(before - 1)
        if word == "of":
            return self._of(before, earlier, least)
        if word == "to" and earlier in ("next", "close"):
            return "near"
        return word if word in request_words().links else ""

    def _of(self, of: int, earlier: str, least: int) -> str:
        """Return what "of" makes of the words before it: "on the back of" is "on"."""
        lists = request_words()
        if earlier == "top":
            ahead = of - 2 - (self._s.low(of - 2) in ("the", "very"))
            source = ahead >= least and self._s.low(ahead) in lists.sources
            return self._s.low(ahead) if source else "atop"
        beside = ("the", "upper", "lower", "front", "back", "rear", "top", "bottom")
        if earlier in ("left", "right") and self._s.low(of - 2) not in beside:
            return "near"  # "left of the sink"
        if earlier not in lists.of_a_part and earlier in lists.regions:
            ahead = of - 2
            if self._s.low(ahead) == "opposite":  # no look shows it, as "the end" is anywhere
                self._s.unread.append(f"{self._s.low(ahead)} {earlier}")
            while ahead >= least and self._s.low(ahead) not in lists.links:
                ahead -= 1
            found = self._s.low(ahead) if ahead >= least else "of"
            return "near" if found == "to" and earlier in ("left", "right", "side") else found
        return lists.of_a_part.get(earlier, "of")

    def _is_relative(self, number: int, least: int) -> bool:
        """Return whether a place only says which thing: "the egg that is on the counter"."""
        at, words = number - 1, request_words()
        while at >= least and self._s.low(at) in words.destinations | {"the", "of", "top"}:
            at -= 1
        if at < least:
            return False
        before = self._s.low(at - 1)
        led = before in ("that", "which", "what") or before in words.anything
        return (self._s.low(at) in _LIES and led) or self._s.low(at) in ("lying", "standing")

    def has_place(self, body: Sequence[int]) -> bool:
        """Return whether a place is named among some words."""
        to = request_words().destinations
        return any(self._s.low(n) in to and self._s.begins_noun(n + 1) for n in body)


def _is_carried(one: Mention) -> bool:
    return bool(one.types) and types_with("pickupable").issuperset(one.types)


def _has_no_room_below(one: Mention) -> bool:
    """Return whether nothing can be put under what a mention means: no lamp, tap or machine."""
    return bool(one.types) and types_with("toggleable").isdisjoint(one.types)
