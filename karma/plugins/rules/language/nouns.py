"""Noun phrases of a sentence, and what they may mean."""

from collections.abc import Sequence
from dataclasses import replace

from karma.household.saying import spoken
from karma.household.types import types_with
from karma.household.uses import BURNER, PARTS_OF_FURNITURE
from karma.plugins.rules.language.request_words import deed_states, request_words
from karma.plugins.rules.language.sentence import SaidSentence
from karma.plugins.rules.types import Mention
from karma.plugins.rules.wording.hints import singular
from karma.plugins.rules.wording.phrases import phrases_of
from karma.plugins.rules.wording.words import word_lists

_NEAREST = ("nearest", "closest", "more", "most", "least", "other", "lower", "upper")
_DESCRIBED = frozenset(("something", "anything", "thing", "things", "what", "item", "object"))
_LEAST_DESCRIBED = 3  # words
_PERSONS = frozenset(("i", "you", "we", "u", "he", "she"))
_PARTS = frozenset(("mug", "cup", "bars", "rolls", "couple", "lot", "one", "two", "three"))  # "of"
_ADJECTIVES = ("JJ", "JJR", "JJS", "VBN", "VBG", "VBD")
_DETERMINERS = ("DT", "PRP$", "PDT", "POS", "WP", "CD")
_IN_ROWS = ("NN", "JJ", "CD", "PRP", "PO", "DT", "PDT", "VBN", "VBG")  # tags begin so
_OWNERS = ("'s", "’s")
HOLDERS = ("holder", "hanger", "hook", "rail", "rack", "ring", "bar")  # for towels and paper
_OF_A_WHOLE = ("door", "lid", "tank", "seat", "spout")  # named for the whole that they belong to
_VESSELS = ("mug", "cup", "glass", "bowl", "pot", "kettle", "jug", "vase", "bottle", "plate")
_POURED = ("coffee", "water")  # what they can be filled with


class Nouns:
    """Reads the noun phrases of a sentence."""

    def __init__(self, sentence: SaidSentence) -> None:
        self._s = sentence

    def mentions(self, body: range) -> list[tuple[int, Mention]]:
        """Return the noun phrases of some words, each with the number of its first word."""
        found: list[tuple[int, Mention]] = []
        number = body.start
        while number < body.stop:
            told = self._described(number, body.stop)
            if told is not None:
                self._s.taken.update(range(number, told[1]))
                found.append((number, told[0]))
                number = told[1]
                continue
            end = number if number in self._s.gone else self.end(number, body.stop)
            if end == number:
                number += 1
                continue
            one = self.read(number, end)
            if one is not None or self._s.low(end - 1) in request_words().rooms:
                self._s.taken.update(range(number, end))
            if one is not None:
                state, end = self._s.told_so.get(end, ("", end))
                one = _told_so(one, state) if state else one
                clause = self.done_before(end, body.stop)
                if clause > end:
                    one = replace(one, told=True, vague=False)
                    self._s.taken.update(range(number, clause))
                found.append((number, one))
                end = clause
            number = end
        return found

    def all_of(self, body: range) -> list[Mention]:
        """Return the noun phrases of some words."""
        return [one for _, one in self.mentions(body)]

    def _described(self, number: int, stop: int) -> tuple[Mention, int] | None:
        """Return a thing that is told by what it is for, and where that ends; None if none is."""
        head = number + (self._s.tag(number) in ("DT", "PRP$"))
        low = self._s.low(head)
        general = low in request_words().general and self._s.low(head + 1) in ("for", "used", "to")
        if number in self._s.gone or not (low in _DESCRIBED or general):
            return None
        starts = (self._s.words[number].start, self._s.words[head].start)
        said = next((one for one in phrases_of(self._s.text).nouns if one.start in starts), None)
        if said is None or len(said.text.split()) < _LEAST_DESCRIBED:
            return None
        inside = [n for n in range(head, stop) if self._s.words[n].start < said.end]
        end = max(inside, default=head) + 1
        if any(self._s.low(n) in ("you", "we") for n in inside[:3]):  # "the thing you closed"
            return None
        types = self._s.lexicon.described(said.text)
        begin, last = self._s.words[number].start, self._s.words[end - 1].end
        found = Mention(text=said.text, start=begin, end=last, types=types, told=not types)
        return found, end

    def done_before(self, number: int, stop: int) -> int:
        """Return where a clause like "(that) you just washed" ends; the same number if none is."""
        at = number + (self._s.low(number) in ("that", "which"))
        if self._s.low(number) == "to" and self._s.tag(number + 1) == "VB":  # "a thing to read"
            vague = self._s.low(number - 1) in request_words().vague
            return number + 2 if vague and self._s.low(number + 2) not in ("the", "a") else number
        stranded = self._s.low(at + 2) in ("in", "on", "from", "at")
        led = self._s.low(at) in ("it", "they", "he", "she") and (at > number or stranded)
        if led:  # "the bowl (that) it was in"
            ends = (n for n in range(at, stop) if self._s.low(n) in (",", ".", ";", "and", "then"))
            return next(ends, stop)
        if self._s.low(at) not in ("you", "i", "we"):
            return number
        for end in range(at + 1, min(at + 5, stop)):
            verb = self._s.tag(end) in ("VBD", "VBN", "VBP", "VB")
            if verb and self._s.low(end) not in request_words().auxiliaries:
                return self._joined(end + 1 + (self._s.low(end + 1) in word_lists().particles))
        return number

    def _joined(self, end: int) -> int:
        """Return where a clause ends to which one more verb is joined: "you washed and filled"."""
        more = self._s.low(end) == "and" and self._s.tag(end + 1) in ("VBD", "VBN")
        alone = not self._s.begins_noun(end + 2)
        return end + 2 if more and alone else end

    # ------------------------------------------------------------- where one ends

    def end(self, number: int, stop: int) -> int:
        """Return the end of the noun phrase that begins here; the same number if none does."""
        at, head = number, number
        while at < stop and at not in self._s.gone:
            kind = self._kind(number, at, head, stop)
            if kind == "no" or (head == at and self._is_state(number, at, stop)):
                break
            at += 1
            if kind in ("head", "last"):
                head = at
            if kind == "last":
                break
        return head

    def _kind(self, begin: int, at: int, head: int, stop: int) -> str:
        """Return what a word is in a phrase: "head", "last" head, "inner", or "no" part of it."""
        low, tag, of = self._s.low(at), self._s.tag(at), self._s.low(at - 1) == "of"
        if low in ("other", "former", "latter") and self._s.low(at - 1) == "the":
            named = self._s.low(at + 1) in ("one", "ones") or self._noun_follows(at, stop)
            return "inner" if named else "last"  # "the other" alone
        if low in request_words().elsewhere or (low in ("then", "that", "which") and at > begin):
            return "no"
        if low in request_words().starts or tag in ("DT", "PRP$", "PDT", "CD", "WP"):
            if head > begin and not of:
                return "no"
            alone = low in request_words().alone and self._stands_alone(low, at, stop)
            return "head" if alone else "inner"
        if tag == "PRP":
            person = low in request_words().me or low in _PERSONS
            return "no" if person or (head > begin and not of) else "last"
        if tag in ("NN", "NNS", "NNP", "NNPS", "FW"):
            return "no" if low in request_words().me or low in _PERSONS else "head"
        if tag == "POS" or low in _OWNERS or (low == "-" and head == at):
            return "inner"
        leads = at > begin or tag == "JJ" or low in deed_states()  # "put chilled bread away"
        if tag in _ADJECTIVES and leads and self._noun_follows(at, stop):
            return "inner"
        counted = self._s.tag(at - 1) == "CD"  # "two of the eggs"
        if low == "of" and (head == at or counted) and self._is_measure(at):
            return "inner"
        named = tag.startswith(("VB", "JJ", "RP")) and head == at
        named = named and (at > begin or tag not in ("VBN", "VBD", "VBG"))
        known = named and self._s.lexicon.named(self._s.phrase(begin, at + 1).lower())
        return "head" if known else "no"

    def _is_state(self, begin: int, at: int, stop: int) -> bool:
        """Return whether a word says how the thing before it is to be: "the apple cold"."""
        ends = ("", ",", ".", ";", "!", "?", "and", "please")
        if self._s.low(at + 1) not in ends and at + 1 < stop:
            return False
        if self._s.low(at) not in deed_states().keys() | request_words().seen.keys():
            return False
        if at == begin:
            return self._s.tag(at - 1).startswith("NN")
        first = begin + (self._s.tag(begin) in _DETERMINERS)
        return first < at and bool(self._s.lexicon.named(self._s.phrase(first, at).lower()))

    def _stands_alone(self, low: str, at: int, stop: int) -> bool:
        """Return whether "all", "that" or "one" is a phrase by itself."""
        following = self._s.low(at + 1) if at + 1 < stop else ""
        if not following or following in ("that", "which"):
            return True
        tag = self._s.tag(at + 1)
        if low not in ("all", "both"):
            return not tag.startswith(("NN", "JJ", "CD", "DT", "PRP$", "VBN"))
        if low == "both":  # not of "them both"
            behind = following in ("of", "on", "in", "into", "onto", "to", "off", "back", "away")
            return behind and self._s.tag(at - 1) != "PRP"
        return following in ("of", "lies", "on", "in")

    def _noun_follows(self, at: int, stop: int) -> bool:
        for number in range(at + 1, min(at + 4, stop)):
            if self._s.tag(number).startswith("NN") or self._s.low(number) in ("one", "ones"):
                return True
            if self._s.tag(number) not in ("JJ", "VBN", "VBG", "CD", "HYPH", "CC"):
                return False
        return False

    def _is_measure(self, at: int) -> bool:
        """Return whether "of" leads to what is meant: "a slice of bread", "all of the cups"."""
        head = self._s.low(at - 1)
        return self._is_part(head) or head in word_lists().measures or head in (
            *_PARTS, *_OF_A_WHOLE, *_VESSELS, "all", "both", "each",
            *request_words().pieces, *request_words().measures,
        )  # fmt: skip

    def _is_part(self, head: str) -> bool:
        """Return whether a word names what is a part of furniture: a drawer, a shelf."""
        found = self._s.lexicon.named(singular(head))
        return bool(found) and (PARTS_OF_FURNITURE | {BURNER}).issuperset(found)

    def run_end(self, begin: int) -> int:
        """Return where a row of noun phrases ends that begins here: "the pen and the pencil"."""
        last = begin
        for number in range(begin, len(self._s.words)):
            tag, low = self._s.tag(number), self._s.low(number)
            if tag.startswith(_IN_ROWS):
                last = number + 1
            elif low == "that" and self._s.low(number + 1) in ("is", "'s", "are", "lies"):
                continue
            else:
                noun = self._s.tag(number + 1) in ("DT", "NN", "NNS", "PRP$")
                listed = low in ("and", "or") and number > begin and noun
                if not listed or self._s.is_order(number + 1):
                    break
        return last

    # ------------------------------------------------------------- what one means

    def read(self, begin: int, end: int) -> Mention | None:
        """Read one noun phrase; None where it names nothing."""
        lows = self._s.lows(begin, end)
        number, every, start = self._counted(begin, end)
        start_at, end_at = self._s.words[begin].start, self._s.words[end - 1].end
        other = bool({"other", "another", "remaining"} & set(lows))
        tags, known = ("JJR", "JJS"), request_words().compared
        ahead = [n for n in range(begin, end - 1) if self._s.low(n) not in _NEAREST]
        compared = [n for n in ahead if self._s.low(n) in known or self._s.tag(n) in tags]
        self._s.unread += map(self._s.low, compared)
        bare = Mention(text=" ".join(lows), start=start_at, end=end_at, other=other)
        if start < 0:
            return replace(bare, vague=True)
        if start >= end:
            return self._without_noun(lows, replace(bare, number=number))
        inner = self._inner(begin, start, end, lows)
        if inner is not None:
            number, every = number or inner.number, every or inner.every
            return replace(
                inner, number=number, every=every, start=start_at, end=end_at, other=other
            )
        words = lows[start - begin :]
        if "of" in words and self._is_part(words[words.index("of") - 1]):
            of = start + words.index("of")
            return self._part(start, of, end, replace(bare, number=number, every=every))
        if "of" in words and (words[0] in _PARTS or words[0] in _VESSELS):
            of = words.index("of")
            if words[0] in _VESSELS:
                return self._vessel(
                    start, start + of, end, replace(bare, number=number, every=every)
                )
            words = words[:of]
        if "of" in words and words[words.index("of") - 1] in request_words().pieces:
            words = words[: words.index("of")]  # "a slice of it"
        owner = max((n for n, one in enumerate(words) if one in _OWNERS), default=-1)
        if owner > 0 and words[-1] in _OF_A_WHOLE:  # "the toilet's tank"
            words, owner = words[:owner], -1
        bare = replace(bare, number=number, every=every)
        return self._noun(words[owner + 1 :], start + owner + 1, end, bare)

    def _counted(self, begin: int, end: int) -> tuple[int | None, bool, int]:
        """Return number, whether all are meant, and where the noun begins; -1: "the rest of"."""
        number, every, start = None, False, begin
        rest = self._s.lows(begin, end)
        measures = word_lists().measures | request_words().measures
        while start < end:
            low = self._s.low(start)
            if low == "both" and self._s.tag(end - 1) == "NN" and "of" not in rest:
                pass  # "both the mug and the spoon"
            elif low in request_words().every:
                every, number = True, 2 if low == "both" else number
            elif low.isdigit() or low in request_words().numbers:
                number = int(low) if low.isdigit() else request_words().numbers[low]
            elif low in request_words().pieces and self._s.tag(end - 1) == "PRP":
                break  # "a slice of it"
            elif low == "of" or (low in measures and "of" in rest[start - begin :]):
                if low == "rest":
                    return None, False, -1
            elif self._s.tag(start) not in _DETERMINERS and low not in _OWNERS:
                break
            start += 1
        return number, every, start

    def _without_noun(self, lows: Sequence[str], bare: Mention) -> Mention | None:
        words = request_words()
        if lows[-1] in words.vague or lows[-1] == "both":
            every = lows[-1] == "both"
            return replace(bare, text=lows[-1], vague=True, every=every)
        if lows[-1] in words.anything:
            return replace(bare, anything=True, every=True)
        return None

    def _inner(self, begin: int, start: int, end: int, lows: Sequence[str]) -> Mention | None:
        """Return what "both bars of soap" is about; None where "of" does not lead to it."""
        if "of" not in lows[start - begin :]:
            return None
        of = begin + list(lows).index("of", start - begin)
        part = self._s.low(of - 1)
        piece = part in _OF_A_WHOLE or part in request_words().pieces  # "the cooked piece of food"
        first = self._s.low(start)
        if first not in _PARTS and not piece:
            return None
        found = self.read(of + 1, end)
        if found is None or not (found.types or not (piece or first in ("mug", "cup"))):
            return None
        couple = 2 if first == "couple" else None
        return replace(
            found, number=found.number or couple, every=found.every or first in ("bars", "rolls")
        )

    def _part(self, start: int, of: int, end: int, bare: Mention) -> Mention | None:
        """Read "the drawers of the desk"; a shelf of what has a door is that: of the fridge."""
        found, whole = self._noun(self._s.lows(start, of), start, of, bare), self.read(of + 1, end)
        if found is None or whole is None or not whole.types:
            return found
        doors = types_with("openable") - types_with("pickupable")
        if doors.issuperset(whole.types):
            return replace(whole, start=bare.start, end=bare.end)
        return replace(found, at=whole.types) if BURNER not in found.types else found

    def _vessel(self, start: int, of: int, end: int, bare: Mention) -> Mention | None:
        """Read "a glass of water", "the bowl of apples"; of what cannot be had nothing is made."""
        found = self._noun(self._s.lows(start, of), start, of, bare)
        if found is None or self._s.low(end - 1) in _POURED:
            return found
        content = self.read(of + 1, end)
        if content is None or not content.types:
            self._s.unread.append(self._s.phrase(of + 1, end).lower())
            return found
        return replace(found, holding=content.types)

    def _noun(self, words: Sequence[str], start: int, end: int, bare: Mention) -> Mention | None:
        """Return what a phrase names that begins with its noun or an adjective."""
        if not words:
            return None
        lists, text, head = request_words(), " ".join(words), words[-1]
        own = self._s.low(end - 2) == "its" and words[-1] not in HOLDERS
        if own and len(words) == 1:  # its lid, its door
            return replace(bare, text="it", vague=True)
        whole = head in _OF_A_WHOLE or head in lists.pieces
        if whole and len(words) > 1 and self._types(words[:-1], start):
            words = words[:-1]  # "the bread slices", "the microwave door"
        types = self._types(words, start)
        if len(words) > 1 and head in lists.general:
            types = self._s.lexicon.described(text)  # "a soil digging tool"
        if not types:
            return self._without_type(words, bare)
        if bare.every:  # "all lights": of every kind that is called a light
            types = tuple(dict.fromkeys((*types, *self._s.lexicon.named(singular(text)))))
        every, one = bare.every, bare.number is None and not bare.every
        plural = self._s.tag(end - 1) in ("NNS", "NNPS") and one
        if plural and head not in lists.own_plurals and singular(text) != text:
            every = self._types((*words[:-1], singular(head)), start) == types
        besides, marks = self._besides(words, types), self._marks(words)
        return replace(
            bare, text=text, types=types, every=every, besides=besides, marks=marks,
            at=self._whole_of(types, words[:-1], start),
        )  # fmt: skip

    def _whole_of(self, types: Sequence[str], words: Sequence[str], start: int) -> tuple[str, ...]:
        """Return the types of the furniture whose part is named: "the desk drawer"."""
        if not PARTS_OF_FURNITURE.issuperset(types):
            return ()
        owner = words
        if self._s.low(start - 1) in ("'s", "’s"):
            owner = self._s.lows(start - 4, start - 1)
        named = self._s.lexicon.named
        wholes = (named(" ".join(owner[n:])) for n in range(len(owner)))
        found = next(filter(None, wholes), ())
        return tuple(kind for kind in found if kind not in types_with("pickupable"))

    def _marks(self, words: Sequence[str]) -> tuple[str, ...]:
        """Return the words ahead of a name that say which one is meant: "the second drawer"."""
        marks, whole = request_words().marks, self._s.lexicon.named_whole
        plain = (n for n, one in enumerate(words) if one not in marks)
        name = next((n for n in plain if whole(" ".join(words[n:]))), len(words) - 1)
        return tuple(one for one in words[:name] if one in marks)

    def _without_type(self, words: Sequence[str], bare: Mention) -> Mention | None:
        """Return what a phrase means that no type is called by; None: where it is, a room."""
        lists, text, head = request_words(), " ".join(words), words[-1]
        if head in lists.pieces:
            return replace(bare, text=text, types=tuple(sorted(types_with("sliceable"))))
        if head == "drink" or text == "coffee":
            return replace(bare, text=text, told=True)
        if head in lists.anything and len(words) <= 2:
            all_ = bare.every or head in ("everything", "all", "whatever", "lot")
            seen = tuple(lists.seen[word] for word in words[:-1] if all_ and word in lists.seen)
            return replace(bare, text=text, anything=all_, vague=not all_, every=all_, states=seen)
        if head in lists.vague or text in lists.vague:
            return replace(bare, text=text, vague=True)
        return None if head in lists.rooms else replace(bare, text=text)

    def _besides(self, words: Sequence[str], types: Sequence[str]) -> tuple[str, ...]:
        """Return what else is called so, unless the words name one type in full: "coffee table"."""
        if any(" " in spoken(kind) and spoken(kind).lower() in " ".join(words) for kind in types):
            return ()
        return tuple(one for one in self._s.lexicon.besides(words[-1]) if one not in types)

    def _types(self, words: Sequence[str], start: int) -> tuple[str, ...]:
        """Return the types that a phrase names, adjectives left out one by one."""
        named = self._s.lexicon.named
        if len(words) > 1 and words[-1] in request_words().seen and not named(" ".join(words)):
            words = words[:-1]
        compound = False  # "desk drawer": of several drawers the one that is nearest to it
        lists, states = request_words(), deed_states()
        small = (lists.dropped, lists.marks, lists.pieces, word_lists().qualifiers, states)
        for first, word in enumerate(words):
            found = named(" ".join(words[first:]))
            if found and compound:
                fixed = tuple(one for one in found if one not in types_with("pickupable"))
                return self._s.lexicon.nearest(" ".join(words), fixed, 1) or fixed
            if found:
                return found
            known = any(word in words for words in small)
            compound = compound or (self._s.tag(start + first) == "NN" and not known)
            tag = self._s.tag(min(start + first, len(self._s.words) - 1))
            other = tag in (*_ADJECTIVES, "CD", "NNP", "POS", "RB", "DT", "FW", "NN")
            if not (known or other):
                return ()
        return ()


def _told_so(one: Mention, state: str) -> Mention:
    """Return a mention that is told by a state: "anything that is on" is all of that."""
    if one.vague and one.text == "anything":
        one = replace(one, vague=False, anything=True, every=True)
    return replace(one, states=(*one.states, state))
