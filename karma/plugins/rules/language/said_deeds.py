"""The deeds of a sentence: orders, wishes, what needs doing; or that it only tells something."""

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

from karma.household.types import object_types, types_with
from karma.household.uses import BIN, FAUCET, LAMPS, TAPS
from karma.plugins.rules.language.antecedents import sharing, with_antecedents
from karma.plugins.rules.language.asides import Asides
from karma.plugins.rules.language.nouns import HOLDERS, Nouns
from karma.plugins.rules.language.pairs import Pair, Pairs
from karma.plugins.rules.language.request_words import (
    deed_states,
    is_usual,
    request_words,
)
from karma.plugins.rules.language.sentence import SaidSentence
from karma.plugins.rules.types import Form, Mention, SaidDeed

_LEFT_ALONE = re.compile(
    r"\b(?:alone|as (?:it|they) (?:is|are)|where (?:it|they) (?:is|are)|be|in peace|untouched"
    r"|running)\b"
)
_MODALS = frozenset(("should", "must", "can", "could", "ought", "may", "might"))
_ASKED_OF_YOU = ("could", "can", "would", "will")
_IS_SOMEWHERE = ("be", "go", "belong", "stand", "sit", "lie", "live", "rest", "end")
_PERSONS = ("i", "we", "you", "he", "she", "they")
_FINDS = ("find", "locate", "look for", "search for", "show", "hunt")
_ON_OFF = ("on", "off")
_SWITCHES = frozenset(("turn", "switch", "flip", "flick", "get", "have", "power"))


@dataclass(slots=True)
class SentenceDeeds:
    """Reads them; what is no part of a deed was taken before."""

    s: SaidSentence
    nouns: Nouns
    pairs: Pairs
    asides: Asides

    def read(self) -> tuple[Form, list[SaidDeed]]:
        """Return what form a sentence has, and what is to be done."""
        passed = self.s.told_so_words
        verbs = [n for n in range(len(self.s.words)) if n not in passed and self._may_ask(n)]
        if not verbs:
            return self._verbless()
        deeds = self._ahead(verbs[0])
        for number, end in zip(verbs, [*verbs[1:], len(self.s.words)], strict=True):
            if number in self.s.taken:
                continue
            kept = set(self.s.taken)
            found = self._deeds(number, end)
            if not found:  # nothing was made of it, so what it speaks of is not read yet
                self.s.taken.intersection_update(kept | self.s.gone)
            deeds += found
        if not deeds and not (self.asides.forbidden or self.asides.exclusions or self.s.unread):
            return self._form_of_no_errand(), []
        placed = all(one.deed == "put" and one.place is not None for one in deeds)
        if deeds and placed and is_usual(self.s.lows()):
            self._form_of_no_errand()
            return "teaching", []  # "always put the knives in the drawer": a rule, not a deed
        conditions = (one.thing for one in self.asides.conditions if one.thing is not None)
        ruled_out = (one for deed in self.asides.forbidden for one in deed.things)
        before = [*self.s.before, *ruled_out, *conditions]
        return "errand", with_antecedents(sharing(deeds), before, self.s.last, self.s.older)

    def _ahead(self, verb: int) -> list[SaidDeed]:
        """Read "book to the desk, lamp to the shelf" ahead of the first verb."""
        kept, unread = set(self.s.taken), list(self.s.unread)
        left = [n for n in self.s.left() if n < verb]
        alone = left and self.s.subject(verb) is None
        pairs = self.pairs.read(range(left[0], verb), "put") if alone else []
        if pairs and all(one.place and any(t.types for t in one.things) for one in pairs):
            return [
                _deed_of_pair("put", "put", self.s.words[left[0]].start, pair) for pair in pairs
            ]
        self.s.taken, self.s.unread = kept, unread
        return []

    def _form_of_no_errand(self) -> Form:
        """Return what a sentence is that asks for nothing; keep what it speaks of."""
        kept = set(self.s.taken)
        self.s.alone += self.nouns.all_of(range(len(self.s.words)))
        self.s.taken = kept
        words = set(self.s.lows())
        taught = words & (request_words().habits | request_words().taught)
        return "teaching" if taught or is_usual(self.s.lows()) else "statement"

    # ------------------------------------------------------------- which words are verbs

    def _may_ask(self, number: int) -> bool:
        """Return whether a word is a verb that may be an order, or tell of something."""
        s, word = self.s, self.s.words[number]
        low, lists = word.text.lower(), request_words()
        if number in s.taken or not (low[0].isalpha() or low in lists.be) or low == "lights":
            return False
        if number == 0 and self._is_put_there(low):
            return False
        if (word.tag, word.dep) == ("JJ", "amod") and s.low(number - 1) == "and":
            return False  # "a fork and washed plate"
        led = s.tag(number - 1).startswith("NN") or s.low(number - 1) in ("it", "them")
        if number and led and low in lists.results:
            return False  # "pull the blinds shut"
        starts, subject = s.starts_clause(number), s.subject(number)
        verb = word.tag.startswith("VB") and word.dep not in ("amod", "aux", "auxpass", "compound")
        if low in lists.be and self._is_part(number):
            return False
        if low in lists.auxiliaries | lists.be:
            whole = word.dep in ("ROOT", "ccomp", "conj", "advcl") and low in lists.be | {"have"}
            return whole and verb and subject is not None
        asks = (starts or s.low(number - 1) == "to") and s.known_verb(number)  # "a mug to put in"
        if self._is_part(number) or (word.dep == "relcl" and not asks):
            return False
        noun = s.low(number - 1) in request_words().before_nouns and word.tag != "VBP"
        if noun and not (verb and subject is not None):
            return False
        if starts and s.known_verb(number):
            return True
        loose = word.tag in ("VBN", "VBG") and subject is None and not starts
        return verb and not (loose and word.dep in ("acl", "amod", "prep", "pcomp", "pobj"))

    def _is_put_there(self, low: str) -> bool:
        """Return whether a sentence begins with a thing that has a place: "sponge on the sink"."""
        with_place = self.s.low(1) in request_words().destinations
        return with_place and self.pairs.deed_at(0)[2] == 1 and bool(self.s.lexicon.named(low))

    def _is_part(self, number: int) -> bool:
        """Return whether a verb goes with another: "needs slicing", "the cup you just washed"."""
        s, word = self.s, self.s.words[number]
        needs = request_words().needs
        if s.low(number - 1) in ("you", "ya", "u") and s.low(number - 2) in _ASKED_OF_YOU:
            return False  # "could you put the apple away, I'd like it cold"
        if word.tag == "VBG" and s.words[word.head].lemma in needs | {"leave", "keep"}:
            return True
        wished = s.words[word.head].lemma in needs and s.subject(word.head) is not None
        if word.dep in ("ccomp", "xcomp") and word.head != number and wished:
            return True
        if s.low(number - 1) in ("whatever", "what", "that", "which"):
            return True  # "whatever is on the table"
        if word.tag in ("VBN", "VBD") and s.tag(number - 1).startswith("NN"):
            ahead = s.phrase_begin(number - 1) - 1  # "get the wine chilled"
            if ahead >= 0 and s.words[ahead].lemma in ("get", "make", "have"):
                return True
        if s.low(number - 1) == "to" and s.low(number - 2) in request_words().vague:
            return True  # "the thing to read"
        joined = word.tag in ("VBN", "VBD") and word.dep == "conj" and s.low(number - 1) == "and"
        if joined and s.low(word.head - 1) in ("you", "we", "i") and word.head == number - 2:
            return True  # "the cup that you washed and dried"
        just = s.low(number - 2) in ("you", "we") and s.low(number - 1) in ("just", "have", "first")
        return (just or s.low(number - 1) in ("you", "we")) and not s.starts_clause(number)

    # ------------------------------------------------------------- orders

    def _deeds(self, number: int, end: int) -> list[SaidDeed]:
        """Read one verb with what goes with it."""
        subject = self.s.subject(number)
        behind = subject is not None and self.s.starts_clause(number) and subject > number
        if subject is not None and not (behind or self.s.is_bare(number)):
            return self._of_subject(number, end, subject)
        if self.s.words[number].lemma in ("make", "get", "keep", "leave", "set", "turn", "let"):
            kept = self._made_so(number, end)
            if kept is not None:
                return kept
        return self._order(number, end)

    def _switches(self, number: int, end: int) -> list[SaidDeed]:
        """Read "turn the tv on and the lamp off": () where not both are said."""
        s, kept = self.s, set(self.s.taken)
        found = dict(self.nouns.mentions(range(number + 1, end)))
        leads, follows = self._marks(number, end, found.keys())
        both = {s.low(n) for n in leads | follows} == {"on", "off"} or len(leads) > 1
        deeds: list[SaidDeed] = []
        waiting: list[Mention] = []
        ahead = ""
        for n in range(number + 1, end) if both and s.words[number].lemma in _SWITCHES else ():
            if n in follows and not waiting and deeds:  # "on and off"
                waiting = list(deeds[-1].things)
                deeds = deeds[:-1] if ahead else deeds
            if n in leads | follows:
                ahead = s.low(n)
            elif n in found and s.low(n - 1) in ("on", "off") and n - 1 not in leads:
                waiting[-1:] = [replace(one, at=found[n].types) for one in waiting[-1:]]
            elif n in found:
                waiting.append(found[n])
            if waiting and ahead:
                start = s.words[number].start + len(deeds)
                deeds.append(
                    _deed_of_pair(f"turn {ahead}", ahead, start, Pair(things=tuple(waiting)))
                )
                waiting = []
            ahead = "" if n in follows else ahead
        if waiting or not deeds:
            s.taken = kept
            return []
        s.taken.update(range(number, end))
        return deeds

    def _marks(self, number: int, end: int, nouns: Collection[int]) -> tuple[set[int], set[int]]:
        """Return where "on" and "off" stand ahead of their things, and where behind them."""
        marks = [
            n for n in range(number + 1, end)
            if self.s.low(n) in ("on", "off") and n not in self.s.taken
        ]  # fmt: skip
        joints = ("and", "then", ",", "but")
        leads = {
            n for n in marks
            if n + 1 in nouns and (n == number + 1 or self.s.low(n - 1) in joints)
        }  # fmt: skip
        return leads, {n for n in marks if n + 1 not in nouns}  # not of "the lamp on the desk"

    def _order(self, number: int, end: int) -> list[SaidDeed]:
        if switched := self._switches(number, end):
            return switched
        deed, text, size = self.pairs.deed_at(number)
        if size == 1 and (later := self.pairs.particle_later(number, end)):
            deed, text = later
        lists, word = request_words(), self.s.words[number]
        if not deed and {word.lemma, word.text.lower()} & lists.small_verbs:
            return []
        self.s.taken.update(range(number, number + size))
        pairs = self.pairs.read(range(number + size, end), deed)
        said = "coffee" in self.s.lows(number, end)
        for n in range(number + size, end):  # a particle that nothing was made of
            last = n + 1 >= end or self.s.low(n + 1) in (",", "and", "then", ".", "!", ";")
            if self.s.low(n) in ("on", "off") and last and n not in self.s.taken:
                self.s.unread.append(self.s.low(n))
        me = bool(lists.me & set(self.s.lows(number + 1, min(number + 3, end))))  # "bring me ..."
        if text == "read" and lists.me & {*self.s.lows(number + 1, end)}:
            deed = ""  # aloud
        deed = "" if deed == "put" and _puts_nothing(text, pairs[0]) else _of_taps(deed, pairs)
        deed, pairs = self._meant(deed, text, pairs, coffee=said, me=me)
        if not deed:
            self.s.unread.append(text)
        hangs = word.lemma == "hang"
        found = [_deed_of_pair(text, deed, word.start, _hung(pair, hangs=hangs)) for pair in pairs]
        return self._made_ready(found)

    def _meant(
        self, deed: str, text: str, pairs: list[Pair], *, coffee: bool, me: bool
    ) -> tuple[str, list[Pair]]:
        """Return the deed that a verb means with what goes with it."""
        first = pairs[0]
        if deed in ("put", "take") and first.place is not None:
            return _carried(text, deed, pairs, first.place, me=me)
        match deed:
            case "put" if text == "dump" and first.place is None:
                return "throw", pairs
            case "make" | "fill" if coffee:
                return "coffee", pairs
            case "make":
                return "", pairs
            case "throw" if first.place and first.place.types and BIN not in first.place.types:
                return "put", pairs
            case "clear" | "empty" if first.things and _holds_things(first.things[0]):
                at = first.things[0]
                every = replace(at, text=f"everything on the {at.text}", types=(), anything=True,
                                every=True, at=at.types)  # fmt: skip
                return ("put" if deed == "clear" else "take"), [replace(first, things=(every,))]
            case "go":
                return "go", [Pair(things=(first.place,))] if first.place else pairs
            case "take" if text in _FINDS:
                return "find", pairs
            case "water":
                plant = any("HousePlant" in one.types for one in first.things)
                return ("fill" if plant else ""), pairs
        return deed, pairs

    def _made_so(self, number: int, end: int) -> list[SaidDeed] | None:
        """Read "make it hot", "leave the lamp on", "leave it alone"; None where it is neither."""
        lemma, kept = self.s.words[number].lemma, set(self.s.taken)
        found = self.nouns.all_of(range(number + 1, end))
        left = (n for n in range(number + 1, end) if n not in self.s.gone)
        tail = [self.s.low(n) for n in left if self.s.low(n).isalpha()]
        state = deed_states().get(tail[-1], "") if tail else ""
        parts = (n for n in range(number + 2, end) if self.s.tag(n) in ("VBN", "VBD"))
        if lemma in ("get", "make") and not state and any(map(self._done, parts)):
            state = "done"  # "get that mug scrubbed"
        if lemma in ("leave", "keep", "let") and found:
            placed = self.pairs.has_place(range(number + 1, end))
            alone = _LEFT_ALONE.search(" ".join(tail)) or (lemma != "let" and not placed)
            others = any(self.s.is_order(n) for n in range(number))
            stays_open = state == "open"  # behind another order, too: "... and leave it open"
            if state and lemma != "let" and (stays_open or not others):
                self.s.taken.update(range(number, end))
                pair = Pair(things=tuple(found[:1]))
                return [
                    _deed_of_pair(f"{lemma} {tail[-1]}", state, self.s.words[number].start, pair)
                ]
            if alone or state:
                self.asides.exclusions += [one for one in found if one.types]
                joined = self.s.low(number - 1) in ("and", "but", ",")
                self.s.drop(number - joined, end)
                return []
        elif state and found and (lemma == "make" or tail[-1] not in ("on", "off")):
            self.s.taken = kept
            made = self._states(number, end)
            self.s.taken.update(range(number, end))
            return made
        self.s.taken = kept
        return None

    def _states(self, number: int, end: int) -> list[SaidDeed]:
        """Read "get the soup warm and the beer cold": each thing with the state behind it."""
        deeds: list[SaidDeed] = []
        waiting: list[Mention] = []
        found, lemma = dict(self.nouns.mentions(range(number + 1, end))), self.s.words[number].lemma
        for n in range(number + 1, end):
            if n in found:
                waiting.append(found[n])
            elif self.s.low(n) in ("on", "off") and self.s.begins_noun(n + 1):
                continue  # "make the soup on the stove warm"
            elif n not in self.s.taken and waiting and (state := self._becomes(n)):
                text, pair = f"{lemma} {self.s.low(n)}", Pair(things=tuple(waiting))
                deeds.append(_deed_of_pair(text, state, self.s.words[n].start, pair))
                waiting = []
        self.s.unread += [one.text for one in waiting]
        return deeds

    def _becomes(self, number: int) -> str:
        """Return the deed that makes a thing what a word says: "warm", "scrubbed"."""
        done = self.s.tag(number) in ("VBN", "VBD", "JJ")
        return deed_states().get(self.s.low(number), "") or (self._done(number) if done else "")

    def _done(self, number: int) -> str:
        """Return the deed of a participle, "" where a place belongs to it, or none is known."""
        deed = self.pairs.deed_at(number)[0]
        return "" if deed in ("put", "take", "go", "make") else deed

    # ------------------------------------------------------------- wishes and needs

    def _of_subject(self, number: int, end: int, subject: int) -> list[SaidDeed]:
        """Read a verb that has a subject: a wish, a need, or nothing that is asked for."""
        who, helpers = self.s.low(subject), self.s.helpers(number)
        lemma, needs = self.s.words[number].lemma, request_words().needs
        if who in ("you", "u", "ya"):
            return self._order(number, end) if helpers & _MODALS else []
        wants = lemma in ("want", "need") or (lemma in needs and helpers & {"would", "'d"})
        if who in ("i", "we") or (wants and self._is_a_person(subject, number)):
            wishes = lemma in needs and not helpers & {"n't", "not", "did"}
            return self._wishes(number) if wishes else []
        return self._need(number, end, subject)

    def _wishes(self, number: int) -> list[SaidDeed]:
        """Read "I want the plate washed, the lamp off and the vase on the desk"."""
        begin = self.s.phrase_begin(self.s.subject(number) or number)
        deeds: list[SaidDeed] = []
        for part in self._wished(number + 1):
            deeds += self._wish(number, part)
        if deeds:
            self.s.taken.update(range(begin, number + 1))
        return deeds

    def _is_a_person(self, subject: int, verb: int) -> bool:
        """Return whether somebody else wants a thing so: "Mary wants the mug washed"."""
        s = self.s
        person = s.low(subject) in _PERSONS or s.tag(subject) in ("NN", "NNS", "NNP")
        named = s.lexicon.named(s.low(subject)) or s.low(subject) in request_words().vague
        thing = s.begins_noun(verb + 1) and s.tag(verb + 1) != "VBG"
        return person and not named and thing

    def _wished(self, begin: int) -> Iterator[range]:
        """Yield the parts of a wish: each has things, and what is to become of them."""
        s, start, whole = self.s, begin, False
        stop = s.clause_end(begin, orders=False)
        wishes = (n for n in range(begin, stop) if s.words[n].lemma in request_words().needs)
        again = next((s.subject(n) for n in wishes), None)  # "and I'd love the light off"
        stop = min(stop, again) if again else stop
        while s.low(stop) == "," and self._goes_on(stop + 1):
            stop = s.clause_end(stop + 1, orders=False)
        for n in range(begin, stop):
            joint = s.low(n) in (",", "and", "but")
            if joint and whole and s.begins_noun(n + 1 + (s.low(n + 1) == "and")):
                yield range(start, n)
                start, whole = n + 1 + (s.low(n + 1) == "and"), False
            done = s.tag(n) in ("VBN", "VBD") and self.pairs.deed_at(n)[0]
            placed = s.low(n) in request_words().destinations
            whole = whole or bool(done or placed or s.low(n) in deed_states())
        if start < stop:
            yield range(start, stop)

    def _goes_on(self, begin: int) -> bool:
        """Return whether a wish goes on behind a comma: "the lamp off and ..."."""
        begin += self.s.low(begin) == "and"
        end = self.s.clause_end(begin, orders=False)
        tags = {self.s.tag(n) for n in range(begin, end)}
        led = self.s.begins_noun(begin) and not self.s.is_order(begin)
        return led and not tags & {"VBZ", "VBP", "MD", "VB"}

    def _wish(self, number: int, part: range) -> list[SaidDeed]:
        """Read one part of a wish: "the plate washed", "the vase on the desk"."""
        end = part.stop
        pairs = self.pairs.read(part, "put")
        if not pairs[0].things:
            return []
        self.s.taken.update(n for n in part if self.s.low(n) in request_words().moved)
        deed = "put" if pairs[0].place else "take"
        for n in range(part.start + 1, end):
            state = deed_states().get(self.s.low(n), "")
            alone = self.s.words[n].dep != "amod" and not self.s.begins_noun(n + 1)
            done, _, size = self.pairs.deed_at(n)
            if self.s.tag(n) in ("VBN", "VBD") and done not in ("", "put"):
                self.s.taken.update(range(n, n + size))
                deed = done
                break
            if state and alone and not pairs[0].place:
                self.s.taken.add(n)
                deed = state
                break
        more = (n for n in range(part.start + 1, end) if self.s.low(n) in deed_states())
        places = request_words().destinations
        self.s.unread += [
            self.s.low(n) for n in more
            if n not in self.s.taken and not (self.s.low(n) in places and self.s.begins_noun(n + 1))
        ]  # fmt: skip
        low, start = self.s.low(number), self.s.words[part.start].start
        return self._made_ready([_deed_of_pair(low, deed, start, pair) for pair in pairs])

    def _made_ready(self, deeds: list[SaidDeed]) -> list[SaidDeed]:
        """Return deeds ahead of which "a hot potato" is heated; "the hot potato" is one that is."""
        ready: list[SaidDeed] = []
        for deed in deeds:
            first: list[SaidDeed] = []
            for thing in deed.things if deed.deed == "take" else ():
                said = self.s.text[thing.start : thing.end].lower().split()
                states = [deed_states()[word] for word in said[1:-1] if word in deed_states()]
                if said[-1] == "coffee" and said[0] in ("a", "an", "some", "one", "coffee"):
                    deed = replace(deed, deed="coffee")  # "a cup of coffee"
                elif said[-2:] == ["of", "water"] and thing.types:
                    first.append(
                        _deed_of_pair(deed.verb, "fill", deed.start, Pair(things=(thing,)))
                    )
                elif states and said[0] in ("a", "an", "some"):
                    pair = Pair(things=(thing,))
                    first.append(_deed_of_pair(deed.verb, states[0], deed.start, pair))
            ready += [*first, deed]
        return ready

    def _need(self, number: int, end: int, subject: int) -> list[SaidDeed]:
        """Read "the pan needs washing", "the vase should go on the desk"."""
        s, word, who = self.s, self.s.words[number], self.s.low(subject)
        begin, helpers = s.phrase_begin(subject), s.helpers(number)
        about = self._subjects(begin, number)
        habit = "never" in s.lows() or is_usual(s.lows())
        needed = word.lemma in ("need", "want", "require")
        if needed:
            end = s.clause_end(number + 1, orders=False)
        asked = needed or helpers & _MODALS or self._is_wished(begin, number)
        if not (asked or self._moves(number, end, who)) or habit or who in _PERSONS or not about:
            return []
        s.taken.update(range(begin, number + 1))
        after = range(number + 1, end)
        if helpers & request_words().negations:  # "it shouldn't be left open": only told
            s.before += [one for one in about if one.types]
            s.alone += [one for one in about if one.types]
            s.drop(begin, end)
            return []
        place = self.pairs.read(after, "put")[0]
        deed, text, _ = self.pairs.deed_at(number)
        if needed or word.lemma in _IS_SOMEWHERE:
            deed = self._needed(after, place, about)
        if not deed:
            return []
        s.taken.update(after)
        pair = _hung(replace(place, things=tuple(about[:3])), hangs=text == "hang")
        return [_deed_of_pair(text, deed, word.start, pair)]

    def _subjects(self, begin: int, end: int) -> list[Mention]:
        """Return what a sentence is about; a place only says which: "the mug on the desk"."""
        found: list[Mention] = []
        for number, one in self.nouns.mentions(range(begin, end)):
            words = request_words()
            before = self.pairs.preposition(number, begin)
            told = before in words.destinations | words.sources
            if found and before == "with":  # "the box with the pens belongs ..."
                found[-1] = replace(found[-1], holding=(*one.types, *one.besides))
                continue
            if found and one.vague and one.text in ("both", "all", "each"):
                continue  # "the cup and the mug both need washing"
            if told and found:
                found[-1] = replace(found[-1], at=one.types)
            else:
                found.append(one)
        return found

    def _needed(self, after: range, place: Pair, about: Sequence[Mention]) -> str:
        """Return what has to be done, by the words behind "needs" and "should be"."""
        words = self.s.lows(after.start, after.stop)
        if "water" in words and any("HousePlant" in one.types for one in about):
            return "fill"
        if {"wash", "rinse", "scrub", "clean", "washing"} & set(words):  # "needs a wash"
            return "wash"
        verbs = (self.pairs.deed_at(n)[0] for n in after if self.s.tag(n) in ("VBG", "VBN", "VB"))
        done = next(filter(None, verbs), "")
        if place.place is not None:
            return "put"
        states = deed_states()
        return done or next((states[one] for one in words if one in states), "")

    def _is_wished(self, begin: int, number: int) -> bool:
        """Return whether it would be nice if it were so."""
        at = next((n for n in range(begin) if self.s.low(n) == "if"), None)
        were = self.s.low(number) in ("were", "was", "went", "be", "stood")
        were = were or bool(self.s.helpers(number) & {"were", "was"})
        return were and at is not None and self.asides.would_be_nice(at)

    def _moves(self, number: int, end: int, who: str) -> bool:
        """Return whether a thing is told to go somewhere: "both pillows go on the chair"."""
        word = self.s.words[number]
        later = any(self.s.is_order(n) for n in range(end, len(self.s.words)))
        definite = {self.s.low(n) for n in range(number)} & {"the", "this", "that", "my"}
        moves = word.lemma == "go" or (word.lemma == "belong" and (later or bool(definite)))
        past = self.s.helpers(number) & {"did", "will"} or word.tag not in ("VBZ", "VBP", "VB")
        named = who != "it" or bool(self.s.before)  # "take the fork; it goes in the drawer"
        return moves and named and who not in _PERSONS and not past

    # ------------------------------------------------------------- without a verb

    def _verbless(self) -> tuple[Form, list[SaidDeed]]:
        """Read "all lights off" and "remotes on the armchair"; a thing alone is incomplete."""
        left = self.s.left()
        body = range(left[0], left[-1] + 1) if left else range(0)
        if "do" in self.s.lows(body.start, body.stop)[:1]:
            self.s.unread.append("do")
        kept = set(self.s.taken)
        if body and self._is_unknown_verb(body.start):
            low = self.s.low(body.start)
            self.s.unread.append(low)
            return "errand", [_deed_of_pair(low, "", self.s.words[body.start].start, Pair())]
        found = self.nouns.all_of(body)
        if not found:
            ruled_out = self.asides.exclusions or self.asides.forbidden or self.asides.times
            return ("errand" if ruled_out else "incomplete"), []
        ends = [self.s.low(n) for n in (left[0], left[-1])]
        switch = next((one for one in ends[::-1] if one in _ON_OFF), "")
        start = self.s.words[left[0]].start
        if switch:
            self.s.taken.update(body)
            return "errand", [_deed_of_pair(switch, switch, start, Pair(things=tuple(found)))]
        if {"have", "get"} & set(self.s.lows(0, left[0])):  # "can I have a coffee?"
            have = _deed_of_pair("have", "take", start, Pair(things=tuple(found)))
            return "errand", self._made_ready([have])
        self.s.taken = kept
        pairs = self.pairs.read(body, "put")
        if pairs[0].things and pairs[0].place is not None:
            return "errand", [_deed_of_pair("put", "put", start, pair) for pair in pairs]
        self.s.alone = found
        return "incomplete", []

    def _is_unknown_verb(self, number: int) -> bool:
        """Return whether a word is ahead of its thing as a verb is: "flush the toilet"."""
        s, low = self.s, self.s.low(number)
        lists = request_words()
        small = lists.links | lists.every | lists.anything | lists.auxiliaries | lists.be
        small |= lists.talk | lists.small_verbs | lists.sequence | lists.never_mind | lists.vague
        word = number == 0 and low.isalpha() and low not in small and s.tag(number)[:2] != "DT"
        return word and s.tag(number + 1) in ("DT", "PRP$") and not s.lexicon.named(low)


def _deed_of_pair(verb: str, deed: str, start: int, pair: Pair) -> SaidDeed:
    return SaidDeed(
        verb=verb, deed=deed, start=start, things=pair.things, place=pair.place, near=pair.near
    )


def _puts_nothing(verb: str, pair: Pair) -> bool:
    """Return whether a verb of putting means something else here: "sit on the sofa", "lock it"."""
    lists = request_words()
    return (verb in lists.of_itself and not pair.things) or (
        verb in lists.only_at and pair.place is None
    )


def _of_taps(deed: str, pairs: Sequence[Pair]) -> str:
    """Return a deed as it is meant of what water comes from: "close the tap" switches it off."""
    kinds = {kind for pair in pairs for one in pair.things for kind in one.types}
    if not kinds or not kinds <= {*TAPS}:
        return deed
    return {"open": "on", "close": "off"}.get(deed, deed)


def _hung(pair: Pair, *, hangs: bool) -> Pair:
    """Return a pair whose place is what the thing hangs on: "hang the towel up"."""
    told = pair.place is not None and pair.place.text.split()[-1] in HOLDERS
    if not (told or (hangs and pair.place is None)) or not pair.things:
        return pair
    places = (on for kind in pair.things[0].types for on in object_types()[kind].goes_in or ())
    kinds = tuple(dict.fromkeys(on for on in places if on.endswith(("Holder", "Hanger"))))
    if not kinds or (pair.place is not None and pair.place.types):
        return pair
    place = pair.place or Mention(text="holder", start=-1, end=-1)
    return replace(pair, place=replace(place, types=kinds, vague=False))


def _carried(
    verb: str, deed: str, pairs: list[Pair], place: Mention, *, me: bool
) -> tuple[str, list[Pair]]:
    """Return what is meant by a thing and a place: under the tap it is washed."""
    things = pairs[0].things
    if verb in _FINDS:  # "look for the keys in the drawers": wherever they are
        return "find", [Pair(things=things)]
    if FAUCET in place.types:
        return "wash", [Pair(things=things)]
    if place.types and {*place.types} <= {*LAMPS} and not pairs[-1].near:  # "take it to the lamp"
        return ("look" if verb == "hold" else "take"), [Pair(things=things)]
    if deed == "take" and me:
        return "take", [Pair(things=tuple(replace(one, at=place.types) for one in things))]
    return "put", pairs


def _holds_things(one: Mention) -> bool:
    """Return whether things lie in or on what is to be cleared, and no liquid: a cabinet, a box."""
    dry = types_with("receptacle") - types_with("canFillWithLiquid")
    return bool(one.types) and dry.issuperset(one.types)
