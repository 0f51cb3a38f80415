"""What is no deed of a request: courtesy, what is only told, conditions, times, what is ruled out.

All of it is taken out of the words that a planner is told.
"""

import re
from collections.abc import Collection
from dataclasses import dataclass, field, replace

from karma.plugins.rules.language.clock import time_words
from karma.plugins.rules.language.nouns import Nouns
from karma.plugins.rules.language.pairs import Pairs
from karma.plugins.rules.language.request_words import is_deed, request_words
from karma.plugins.rules.language.sentence import SaidSentence
from karma.plugins.rules.language.slips import FORMS
from karma.plugins.rules.types import Condition, Mention, Quantity, SaidDeed
from karma.plugins.rules.wording.words import word_lists

_LEAD = re.compile(rf"(?:and |so |now |well |oh |then |, )*(?:{'|'.join(FORMS.orders)})\b(?: ,)? ?")
_WISH = re.compile(r"\b(?:would|'d) (?:be|appreciate|like|love)\b|\bwondering$")
_WHEN = frozenset(("when", "whenever", "once", "after", "until", "till", "before", "while"))
_LIMITS = frozenset(("not", "n't", "never", "to", "limits", "bounds", "forbidden", "stay", "taken"))
_DEADLINES = ("before", "by")
_IN = frozenset(("in", "on", "inside", "at"))
_BESIDE = frozenset(("near", "beside", "behind", "under", "next"))  # no look shows it of a place
_BEING = frozenset(("there", "find", "see", "spot"))  # "if you find one"
_OPEN = frozenset(("anything", "something", "everything", "nothing", "anybody", "somebody"))
_NOT = frozenset(("not", "n't", "no", "neither", "none"))
_MUTUAL = (("each", "other"), ("one", "another"), ("side", "by", "side"))
_TO_ONE_ANOTHER = ("next", "close", "near", "beside", "on", "top", "of", "to", "from", "with", "by")
_IF = frozenset(("if", "unless", "whether", "provided"))
_USES = ("use", "using", "touch", "touching", "disturb", "take")
_HELPERS = ("do", "does", "should", "must", "may", "could", "would", "did", "ca", "can", "please")
_NOUN_TAGS = ("DT", "PRP$", "NN", "NNS", "NNP")


def _quantity(words: Collection[str], thing: Mention | None) -> Quantity:
    """Return of how many of several things a condition is said."""
    if {*words} & {"any", "either", "neither", "none", "no", "some"}:
        return "any"
    if {*words} & {"both", "all", "every", "each"}:
        return "all"
    return "each" if thing is not None and thing.every else "one"


def _is_counted(thing: Mention | None) -> bool:
    return thing is not None and (thing.number or 1) > 1


def _is_known(one: Mention) -> bool:
    """Return whether it is known what is left out: not of "except one mug", "but the second"."""
    told = bool(one.at or one.states or one.other)
    return (told or bool(one.types and one.number is None)) and not one.marks


@dataclass(slots=True)
class Asides:
    """Reads them, in the order of its methods."""

    s: SaidSentence
    nouns: Nouns
    pairs: Pairs
    times: list[str] = field(default_factory=list)
    conditions: list[Condition] = field(default_factory=list)
    exclusions: list[Mention] = field(default_factory=list)
    forbidden: list[SaidDeed] = field(default_factory=list)

    def read(self) -> None:
        """Read all of them."""
        lead = _LEAD.match(" ".join(self.s.lows()))
        if lead and len(lead[0].split()) < len(self.s.words):
            self.s.drop(0, len(lead[0].split()))
        self._purpose()
        for number in range(2, len(self.s.words)):
            self._aim(number)
        self._topic()
        for verb in range(len(self.s.words)):
            self._background(verb)
        self._conditions()
        self._times()
        self._to_each_other()
        number = 0
        while number < len(self.s.words):
            number = self._excluded(number) or number + 1

    # ------------------------------------------------------------- what is only told

    def _purpose(self) -> None:
        """Take what an order is for, where it stands ahead: "to warm the room up, close ..."."""
        begin = next((n for n in range(len(self.s.words)) if n not in self.s.gone), 0)
        begin += 2 if self.s.lows(begin, begin + 3) == ["in", "order", "to"] else 0
        comma = next((n for n, w in enumerate(self.s.words) if n > begin and w.text == ","), 0)
        led = self.s.low(begin) == "to" and self.s.tag(begin + 1) == "VB"
        if led and comma and self.s.is_order(comma + 1):
            self.s.drop(0, comma + 1)

    def _aim(self, number: int) -> None:
        """Take what an order is for, where it stands behind: "so I can sign", "to charge"."""
        s = self.s
        if number in s.taken or s.low(number) not in ("so", "to"):
            return
        if s.low(number) == "so":
            at = number + 1 + (s.low(number + 1) == "that")
            modal = {s.tag(n) for n in range(at, at + 3)} & {"MD"}
            if not (modal and s.low(at) not in ("you", "can", "could")):
                return
        elif not self._is_aim(number):
            return
        end = number + 1
        while end < len(s.words) and s.words[end].text not in (",", ".", "!", "?", ";"):
            if s.low(end) in ("and", "then") and (s.is_order(end + 1) or s.begins_noun(end + 1)):
                break
            end += 1
        s.drop(number, end)

    def _is_aim(self, number: int) -> bool:
        """Return whether "to" leads to a verb that asks for nothing of its own."""
        s, verb, before = self.s, number + 1, number - 1
        asked = request_words().needs | {"have", "ask", "go", "try", "remember", "like", "use"}
        if s.tag(verb) != "VB" or s.words[before].lemma in asked:
            return False
        if s.low(before) in {"you", "up"} | request_words().vague:  # "the thing to read"
            return False
        if not any(s.is_order(n) and s.starts_clause(n) for n in range(number)):
            return False
        looks = s.low(verb + 1) == "at"
        after = verb + 1 + (looks or s.low(verb + 1) in word_lists().particles)  # "to turn on the"
        held = s.tag(after) in ("DT", "PRP$", "NN", "NNS", "PRP", "CD")
        to = looks or s.low(verb) in request_words().needs_place
        led = s.low(after) in request_words().destinations and s.begins_noun(after + 1)
        ours = s.known_verb(verb) or is_deed(s.low(verb))
        return not (ours and (held or (to and led)))  # "to put in the sink"

    def _topic(self) -> None:
        """Take what stands ahead of an order: "the lettuce: wash it"."""
        begin = next((n for n in range(len(self.s.words)) if n not in self.s.gone), 0)
        end = self.nouns.end(begin, len(self.s.words))
        if end == begin or self.s.low(end) not in (":", ",", "-"):
            return
        one = self.nouns.read(begin, end) if {"it", "them"} & set(self.s.lows(end)) else None
        if one is not None and one.types:
            self.s.before.append(one)
            self.s.drop(begin, end + 1)

    def _background(self, verb: int) -> None:
        """Leave out a clause that only tells something, where others ask for something."""
        if verb in self.s.taken or not self._tells(verb):
            return
        begin, end = self._told_clause(verb)
        inside = range(begin, verb)
        orders = any(self.s.is_order(n) and self.s.starts_clause(n) for n in inside)
        if self._asks_outside(begin, end) and not orders:  # "turn on the lamp to let me see"
            found = self.nouns.all_of(range(begin, end))
            named = [one for one in found if one.types]
            if named and _LIMITS & {*self.s.lows(verb, end)}:  # "the knife is off limits, ..."
                self.s.taken.difference_update(range(begin, end))
                return
            self.s.before += named
            self.s.drop(begin, end)

    def _tells(self, verb: int) -> bool:
        """Return whether a verb has a subject of its own, and neither wishes nor needs anything."""
        word, subject = self.s.words[verb], self.s.subject(verb)
        parts = ("aux", "auxpass", "relcl", "acl", "amod", "xcomp")
        if not word.tag.startswith("VB") or word.dep in parts or subject is None:
            return False
        who, helpers = self.s.low(subject), self.s.helpers(verb)
        if subject > verb or subject in self.s.taken or who in ("you", "u", "ya"):
            return False
        if who in ("i", "we") and helpers & request_words().negations:
            return True  # "I can't stand that light"
        if self.s.is_bare(verb) or self._is_wished(verb):
            return False
        if (_IF | _WHEN) & {*self.s.lows(subject - 3, subject), self.s.low(verb - 1)}:
            return False
        if helpers & request_words().negations or "no" in self.s.lows(verb, verb + 3):
            return True
        person = who in ("i", "we", "he", "she", "they", "it") or {"have", "has"} & helpers
        if word.lemma in ("go", "belong") and not person:
            return False
        asks = helpers & {"should", "must", "can", "could", "ought", "may"}
        return not (asks or word.lemma in request_words().needs)

    def _is_wished(self, verb: int) -> bool:
        """Return whether a verb says what is wanted: "I want the blinds opened"."""
        if self.s.tag(verb) not in ("VBD", "VBN"):
            return False
        for n in range(verb - 1, -1, -1):
            if self.s.words[n].text in (".", "!", "?", ";"):
                return False
            subject = self.s.subject(n)
            needs = self.s.words[n].lemma in request_words().needs
            if needs and subject is not None and self.s.low(subject) in ("i", "we"):
                return True
        return False

    def _told_clause(self, verb: int) -> tuple[int, int]:
        """Return where the clause of a verb begins and ends, with the word that joins it."""
        begin, end = verb, verb + 1
        stops = (",", ";", ":", ".", "so", "because", "since", "but")
        while begin and begin - 1 not in self.s.gone and self.s.low(begin - 1) not in stops:
            begin -= 1
        if begin and self.s.low(begin - 1) in ("because", "since", "so"):
            begin -= 1
        while end < len(self.s.words):
            low = self.s.low(end)
            joins = low in ("and", "but", "then") and self.s.is_order(end + 1)
            if low in (",", ";", ":", ".", "!", "?", "so") or joins:
                break
            end += 1
        while self.s.low(end) in (",", "so", "and", "but", ":", "then"):
            end += 1
        return begin, end

    def _asks_outside(self, begin: int, end: int) -> bool:
        """Return whether an order or a wish stands outside of a clause."""
        for n in range(len(self.s.words)):
            if begin <= n < end or n in self.s.gone:
                continue
            has_subject = self.s.subject(n) is not None
            if self.s.words[n].lemma in request_words().needs and has_subject:
                return True
            led = n in (0, end) or self.s.low(n - 1) in ("and", "then", "to", "so")
            starts = led or self.s.starts_clause(n)
            alone = not has_subject or self.s.is_bare(n)
            asks = self.s.known_verb(n) or is_deed(self.s.low(n))
            if asks and starts and alone and self.s.low(n) != "back":
                return True
        return False

    # ------------------------------------------------------------- conditions and times

    def _conditions(self) -> None:
        number = 0
        while number < len(self.s.words):
            word = self.s.low(number)
            in_case = word == "in" and self.s.low(number + 1) == "case"
            if (word in _IF or in_case) and not self.would_be_nice(number):
                begin = number - (self.s.low(number - 1) == "only")
                first, number = number + 1 + in_case, self.s.clause_end(number + 1 + in_case)
                held = self._condition(range(first, number), holds=word != "unless")
                self.conditions.append(replace(held, text=self.s.drop(begin, number)))
            else:
                number += 1

    def would_be_nice(self, number: int) -> bool:
        """Return whether "if" belongs to a wish: "it would be lovely if the tomato were ..."."""
        return bool(_WISH.search(" ".join(self.s.lows(number - 6, number))))

    def _condition(self, body: range, *, holds: bool) -> Condition:
        words, seen = self.s.lows(body.start, body.stop), request_words().seen
        lies = [n for n in body if self.s.low(n) in _IN and self.s.begins_noun(n + 1)]
        begins = {self.s.words[n + 1].start for n in lies}
        found = self.nouns.all_of(body)
        place = next((one for one in found if one.start in begins), None)
        things = [one for one in found if one is not place]
        states = [seen[self.s.low(n)] for n in body if self.s.low(n) in seen and n not in lies]
        thing = things[0] if things and not things[0].vague else None
        at = place.types if place is not None else ()
        if {*words[:3]} & _BEING:
            state = "there"
        else:
            state = states[-1] if states else "there" if at else ""
        if thing and at and state != "there":  # "if the lamp on the desk is off"
            thing, at = replace(thing, at=at), ()
        unclear = {"and", "or"} & {*words} and (len(things) > 1 or len([*lies, *states]) > 1)
        unclear = unclear or {*_IF, *_BESIDE} & {*words} or (place is not None and place.vague)
        of = _quantity(words, thing)
        unclear = unclear or {*words} & _OPEN or (thing is not None and not thing.types)
        unclear = unclear or (state == "there" and (of == "all" or _is_counted(thing)))
        orders = (n for n in body if self.s.tag(n) == "VB" and self.s.low(n) not in seen)
        if unclear or any(is_deed(self.s.low(n)) for n in orders if self.s.low(n) not in _BEING):
            state = ""  # more than a condition: "if it is on and on if it is off"
        holds = holds != bool(_NOT & {*words})
        return Condition(text="", thing=thing, state=state, at=at, holds=holds, of=of)

    def _times(self) -> None:
        offset = self.s.words[0].start
        text = self.s.text[offset : self.s.words[-1].end]
        for begin, end in time_words(text):
            inside = [
                n for n, w in enumerate(self.s.words)
                if w.start < offset + end and w.end > offset + begin and n not in self.s.taken
            ]  # fmt: skip
            if inside and text[begin:end].lower() != "today":
                self._time(inside[0], inside[-1] + 1)
        for number in range(len(self.s.words)):
            if number not in self.s.taken and self._waits(number):
                self._time(number, self.s.clause_end(number + 1))

    def _to_each_other(self) -> None:
        """Leave unread how things are to lie to one another, which nothing looks at."""
        for number in range(len(self.s.words)):
            begin = number
            size = next(
                (len(one) for one in _MUTUAL if self.s.lows(number)[: len(one)] == [*one]), 0
            )
            while size and begin and self.s.low(begin - 1) in _TO_ONE_ANOTHER:
                begin -= 1
            if size:
                self.s.unread.append(self.s.drop(begin, number + size))

    def _time(self, begin: int, end: int) -> None:
        """Take words that say when; what is done at once is done "before the guests arrive"."""
        met = self.s.low(begin) in _DEADLINES
        said = self.s.drop(begin, end)
        self.times += [] if met else [said]

    def _waits(self, number: int) -> bool:
        """Return whether a clause begins here that something has to happen in first."""
        soon = self.s.low(number) == "as" and self.s.low(number + 1) == "soon"
        if not (soon or self.s.low(number) in _WHEN):
            return False
        near = range(number + 1, min(number + 5, len(self.s.words)))
        subject = next((n for n in near if self.s.words[n].dep.startswith("nsubj")), None)
        if subject is None or self.s.low(subject) in ("you", "u"):
            return False
        words = set(self.s.lows(subject, subject + 4))
        return not words & (request_words().so_far | request_words().seen.keys())

    # ------------------------------------------------------------- what is ruled out

    def _excluded(self, number: int) -> int | None:
        """Read what is ruled out from here on; return where it ends, None if nothing is."""
        if number in self.s.taken:
            return None
        size = self._marker(number)
        if not size:
            return self._negated(number)
        end = self.nouns.run_end(number + size)
        found = self.nouns.all_of(range(number + size, end))
        if not found and self.s.low(number) == "not":
            return None
        if found:
            found[-1], end = self._left_where(found[-1], number, end)
        contrast = self.s.low(number + size - 1) == "not" and not self._of_all(number)
        # "the desk's": of its things none is named
        owner = bool(found) and self.s.text[found[-1].end :].startswith(("'s", "’s"))
        if not found or owner or not (contrast or all(map(_is_known, found))):
            self.s.unread.append(self.s.phrase(number, end))
        self.exclusions += found
        joined = self.s.low(number - 1) in ("but", "and", "just", ",")
        self.s.drop(number - (joined and number - 1 not in self.s.taken), end)
        return end

    def _left_where(self, one: Mention, number: int, end: int) -> tuple[Mention, int]:
        """Return what is left out with the place that it is told by, and where that ends."""
        states = tuple(request_words().seen.get(word, "") for word in one.text.split()[:-1])
        one = replace(one, states=tuple(filter(None, states))) if one.vague else one
        at = end + (self.s.low(end) in ("that", "which", "already", "still"))
        at += self.s.low(at) in request_words().be
        orders = [n for n in range(number) if self.s.is_order(n)]
        moved = any(self.pairs.deed_at(n)[0] == "put" for n in orders)
        own = (one.vague and not one.states) or not moved or self.pairs.has_place(range(number))
        if not (own and self.pairs.has_place((at,))):
            return one, end
        end = self.nouns.run_end(at + 1)
        place = self.nouns.all_of(range(at + 1, end))
        return (replace(one, at=place[0].types, marks=place[0].marks) if place else one), end

    def _marker(self, number: int) -> int:
        """Return how many words rule out what follows: "instead of", "rather than", "except"."""
        first, second, third = (self.s.low(number + n) for n in range(3))
        links = request_words().destinations | request_words().sources
        pair = f"{first} {second}"
        if pair in request_words().rules_out:
            deed = pair in ("and not", "but not") and self.s.tag(number + 2) in ("VB", "VBG")
            return 0 if deed else 2 + (third in links)
        size = 1 + (second in links)
        if first in ("except", "excluding", "besides"):
            return size
        if first == "but" and self._of_all(number) and self.s.tag(number + 1) in _NOUN_TAGS:
            return 1
        joined = first == "not" and self.s.low(number - 1) in (",", "and", "but")
        return size if joined and self.s.tag(number + size) in _NOUN_TAGS else 0

    def _of_all(self, number: int) -> bool:
        words = request_words()
        every = any(one in words.every | words.anything for one in self.s.lows(0, number))
        return every and not self.s.is_order(number + 1)

    def _negated(self, number: int) -> int | None:
        """Read "don't turn it on"; return where it ends, None where nothing is negated."""
        word = self.s.low(number)
        subject = self.s.subject(self.s.words[number].head)
        own = subject is not None and self.s.low(subject) not in ("you", "u")
        if word not in request_words().negations or (own and word != "without"):
            return None
        verb = number + 1
        skipped = ("to", "ever", "please", "you", "just", "even", "be", "go", "and", "let")
        while self.s.low(verb) in skipped:
            verb += 1
        end = self.s.order_end(verb)
        if verb >= len(self.s.words) or end <= verb:
            return None
        self._forbid(verb, end)
        begin = number - (self.s.low(number - 1) in _HELPERS)
        joints = ("but", "and", "just", "please", ",", "so", "you")
        while self.s.low(begin - 1) in joints and begin - 1 not in self.s.taken:
            begin -= 1
        self.s.drop(begin, end)
        return end

    def _forbid(self, verb: int, end: int) -> None:
        deed, text, size = self.pairs.deed_at(verb)
        if size == 1 and (later := self.pairs.particle_later(verb, end)):
            deed, text = later
        if not (deed or self.s.tag(verb).startswith("VB")) or self.s.low(verb) in _USES:
            self.exclusions += self.nouns.all_of(range(verb, end))
            return
        pair = self.pairs.read(range(verb + size, end), deed)[0]
        start = self.s.words[verb].start
        self.forbidden.append(
            SaidDeed(verb=text, deed=deed, start=start, things=pair.things, place=pair.place)
        )
