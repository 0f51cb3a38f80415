"""What was asked, from the words alone: form, deeds, things, exclusions, times and conditions.

A parser tags the words and says what hangs on what (`Parser`); this is the layer from there to a
`Request`, over what a home holds (`Lexicon`) and what verbs ask for (`request_words.toml`). It is
the same for every planner, and guesses nothing: a word that no field holds is kept in `unread`.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property, partial

from karma.errors import KarmaError
from karma.household.states import NEEDS, lacking
from karma.household.types import Capability, object_types
from karma.plugins.rules.deeds import able_to
from karma.plugins.rules.language.antecedents import left_out_of, of_what
from karma.plugins.rules.language.asides import Asides
from karma.plugins.rules.language.clauses import said
from karma.plugins.rules.language.lexicon import Lexicon
from karma.plugins.rules.language.nouns import Nouns
from karma.plugins.rules.language.pairs import Pairs
from karma.plugins.rules.language.request_words import (
    base_of_deed,
    deed_states,
    deed_verbs,
    is_deed,
    request_words,
)
from karma.plugins.rules.language.said_deeds import SentenceDeeds
from karma.plugins.rules.language.sentence import SaidSentence
from karma.plugins.rules.language.slips import (
    FORMS,
    as_meant,
    in_order,
    sentences_of,
    spelt,
    without_courtesy,
    without_lead,
    without_remarks,
)
from karma.plugins.rules.types import Condition, Form, Mention, Parser, Request, SaidDeed, Word
from karma.plugins.rules.wording.words import closed_words, word_lists

_LONGEST = 4000  # characters; reading takes a second then
_ENDS = (".", "!", "?", ";", "...")
_MODALS = ("can", "could", "would", "will", "may", "might", "won't", "ca", "wo")
_TELL_ME = re.compile("|".join(FORMS.asks_to_tell))
_NOT_SERVED = re.compile(rf"\b(?:{'|'.join(FORMS.not_served)})\b")
_PARTING = re.compile("|".join(FORMS.parting))
_SMALL_TAGS = frozenset((
    "RB", "JJ", "JJR", "UH", "CC", "DT", "IN", "TO", "MD", "PRP", "PRP$", "WDT", "WP", "WRB", "RP",
    "EX", "POS", "PDT", ".", ",", "HYPH",
))  # of words without which a request is what it is  # fmt: skip
_TOO = re.compile(r"^(?:and|now|then)\b|\b(?:too|also|as well|likewise)\b", re.IGNORECASE)
_DENIES = ("not", "n't", "nt", "never", "neither", "nor", "longer")  # "I want the tv not on"
_AS_PAST = ("put", "set", "cut", "shut", "let")  # verbs that are their own past
_AGAIN = ("twice", "thrice")  # nothing is done more than once
_PRONOUNS = ("it", "they", "them", "that", "this", "these", "those")
_OPEN_ENDS = ("the", "a", "an", "my", "to", "with", "into", "onto", "from", "and")


def check_length(text: str) -> None:
    """Raise KarmaError where a text is longer than anything that is said at once."""
    if len(text) > _LONGEST:
        raise KarmaError(
            f"{len(text)} characters are too many for one request: {text[:40]!r}...\n"
            f"  To fix: say it in several, of at most {_LONGEST}"
        )


class RequestReader:
    """Reads requests."""

    def __init__(self, parser: Parser, lexicon: Lexicon) -> None:
        self._parser, self._lexicon = parser, lexicon
        self._kept: dict[tuple[object, ...], tuple[Request, ...]] = {}

    def read(
        self,
        text: str,
        before: Sequence[Mention] = (),
        after: Sequence[SaidDeed] = (),
        older: Sequence[Mention] = (),
    ) -> tuple[Request, ...]:
        """Return what each sentence of a text asks; () where nothing is said.

        Args:
            text: what is said.
            before: things that were spoken of earlier, for which "it" may stand.
            after: deeds that were asked for last, which "and the mug" asks for again.
            older: things that were spoken of before those, one of which "both" may stand for.

        Raises:
            KarmaError: it is too long.
        """
        check_length(text)
        earlier = tuple(map(_elsewhere, before))
        deeds = tuple(map(_earlier, after))
        long_ago = tuple(map(_elsewhere, older))
        key = (text, earlier, deeds, long_ago)
        if key not in self._kept:
            self._kept[key] = tuple(self._sentences(text, earlier, deeds, long_ago))
        return self._kept[key]

    def _sentences(
        self,
        text: str,
        earlier: Sequence[Mention],
        after: Sequence[SaidDeed],
        older: Sequence[Mention],
    ) -> Iterator[Request]:
        told = (without_lead(one) for one in sentences_of(text) or [text])
        meant = as_meant(" ".join(told), self._holds)
        if not re.search(r"\w", meant) and re.search(r"\w", text):  # nothing but courtesy
            yield Request(text=text, form="talk", whole=text)
        if self._is_english(re.findall(r"[^\W\d_]+", meant)):
            meant = spelt(meant, self._is_known, self._vocabulary, self._verbs)
        said = without_remarks(sentences_of(meant))
        meant = " ".join(self._plainly(one) for one in said)
        words = self._parser.parse(meant)
        first, before, last = 0, list(earlier), after
        for number, word in enumerate(words):
            if word.text not in _ENDS and number < len(words) - 1:
                continue
            part = words[first : number + 1]
            if any(one.text[0].isalnum() for one in part):
                found = _going_on(self._read_clause(meant, part, first, before, last, older), last)
                ruled_out = (one for deed in found.forbidden for one in deed.things)
                before += [*found.alone, *ruled_out, *found.mentions]
                last = asked_last(found, last)
                yield found
            first = number + 1

    def _read_clause(
        self,
        text: str,
        words: Sequence[Word],
        first: int,
        before: Sequence[Mention],
        last: Sequence[SaidDeed],
        older: Sequence[Mention],
    ) -> Request:
        ends = len(words) - 1
        if not self._is_english([word.text for word in words]):
            said = text[words[0].start : words[-1].end]
            return Request(text=said, form="errand", whole=text, unread=(said,), english=False)
        moved = [
            replace(word, head=min(max(word.head - first, 0), ends), tag=self._tag(words, number))
            for number, word in enumerate(words)
        ]
        _tag_states(moved)
        named = [one for one in before if one.types]
        deed = last[-1] if last else None
        return _read(SaidSentence(text, moved, self._lexicon, named, deed, older))

    def _tag(self, words: Sequence[Word], number: int) -> str:
        """Return a word's tag; a thing's name behind "the" is a noun: "turn the telly off"."""
        word, before = words[number], words[number - 1] if number else None
        if before is None:
            return word.tag
        if word.text.lower() in _AS_PAST and before.text.lower() in ("then", ","):
            return "VB"  # "scrub the pan then put it away"
        follows = words[number + 1].tag if number + 1 < len(words) else ""
        placing = word.text.lower() in request_words().needs_place and follows == "IN"
        if placing and word.tag == "NN" and before.text.lower() in ("and", ","):
            return "VB"  # "rinse the fork and leave on the tray"
        if word.tag == "VBZ" and before.tag == "DT" and self._lexicon.named(word.text.lower()):
            return "NNS"  # "both watches"
        if self._is_thing(words, number):
            return "NN"
        if word.tag == "JJR" and word.text.lower() in request_words().marks:
            return "JJ"  # "the lower shelf"
        return self._tag_of_name(words, number, follows)

    def _tag_of_name(self, words: Sequence[Word], number: int, follows: str) -> str:
        """Return "NN" for a word that stands where a thing is named and is the name of one."""
        word, before, name = words[number], words[number - 1], words[number].text.lower()
        if word.tag not in ("RB", "JJ", "VB", "VBP", "VBD"):
            return word.tag
        if before.text.lower() == "to" and word.tag == "VB":
            # "to chair", "from the shelf to microwave"; not "nothing to heat in the kitchen"
            deed = bool(base_of_deed(name))
            ends = follows in (("", ".", ",") if deed else ("", ".", ",", "IN", "CC"))
            return "NN" if ends and self._lexicon.named(name) else word.tag  # "to chair"
        joined = before.text.lower() in ("and", "or") and number + 1 < len(words)
        if joined and follows in ("IN", "TO", ".", ","):  # "the phone and remote to ..."
            return "NN" if number > 2 and self._lexicon.named(name) else word.tag
        if before.tag == "NN" and word.tag != "RB":  # "the hand towel"
            led = number > 1 and words[number - 2].tag in ("DT", "PRP$", "IN")
            name = f"{before.text.lower()} {name}"
        else:
            led = before.tag in ("DT", "PRP$", "JJ") and not follows.startswith(
                ("NN", "JJ", "VBN", "CD")
            )
        return "NN" if led and self._lexicon.named(name) else word.tag

    def _is_thing(self, words: Sequence[Word], number: int) -> bool:
        """Return whether a word is no verb but a thing: "chill lettuce", "the frying pan"."""
        if words[number].tag not in ("VB", "VBP", "VBZ", "VBG", "MD", "RB", "JJ", "JJR", "JJS"):
            return False
        name, after = words[number].text.lower(), words[number + 1 : number + 2]
        if after and self._lexicon.named_whole(f"{name} {after[0].text.lower()}"):
            return True
        before = words[number - 1].text.lower()
        if words[number].tag == "MD":
            return self._lexicon.named_whole(f"{before} {name}")
        ends = not after or after[0].tag in ("IN", "TO", ".", ",")
        if words[number].tag[:2] in ("RB", "JJ") and not ends:
            return False
        led = words[number - 1].tag[:2] in ("VB", "NN", "CD") or before == "and"
        takes = after and after[0].tag in ("DT", "PRP", "PRP$", "RP")
        return led and not takes and not base_of_deed(name) and bool(self._lexicon.named(name))

    def _is_english(self, words: Sequence[str]) -> bool:
        """Return whether more than a quarter of some words are ones that requests are made of."""
        said = [word.lower() for word in words if word[0].isalpha()]
        return not said or 4 * sum(map(self._is_ours, said)) > len(said)

    def _is_ours(self, word: str) -> bool:
        lists = word_lists()
        small = (closed_words(), lists.determiners, lists.pronouns, request_words().asking)
        known = any(word in words for words in (*small, self._vocabulary_set))
        return known or bool(base_of_deed(word))

    def _plainly(self, sentence: str) -> str:
        """Return a sentence without courtesy and in the order of its deeds; its own end stays."""
        found = in_order(without_courtesy(sentence, self._names))
        return f"{found}." if found != sentence and found[-1:].isalnum() else found

    def _holds(self, name: str) -> bool:
        """Return whether something may be put in or on a thing, as far as is known."""
        kinds = self._lexicon.named(name)
        return not kinds or any(able_to(kind, "receptacle") for kind in kinds)

    def _names(self, words: str) -> bool:
        """Return whether words name a thing, or hold a deed: they may not be left out."""
        parts = re.findall(r"[a-z']+", words.lower())
        return any(self._lexicon.named(part) or is_deed(part) for part in parts)

    def _is_known(self, word: str) -> bool:
        return self._is_ours(word) or self._parser.knows(word)

    @cached_property
    def _vocabulary(self) -> list[str]:
        verbs = {word for text in deed_verbs() for word in text.split()}
        small = (word for word in closed_words() if len(word) > 3)
        things = sorted({*self._lexicon.words, *verbs, "the"})
        return [*things, *sorted({*small} - {*things})]  # "aple" is an apple, not able

    @cached_property
    def _verbs(self) -> list[str]:
        return sorted({text.split()[0] for text in deed_verbs()})

    @cached_property
    def _vocabulary_set(self) -> frozenset[str]:
        return frozenset(self._vocabulary)


def _tag_states(words: list[Word]) -> None:
    """Tag states before a noun as adjectives, and the verb before them as the verb.

    "Stow rinsed ladle in drawer", "put a fork and washed plate away".
    """
    for number, word in enumerate(words[1:-1], 1):
        joined = words[number - 1].text.lower() == "and" and word.tag in ("VBD", "VBN")
        noun = words[number + 1].tag[:2] in ("NN", "JJ")
        if joined and noun and word.text.lower() in deed_states():
            words[number] = replace(word, tag="JJ", dep="amod", head=number + 1)
    if len(words) < 3 or words[1].tag not in ("VBD", "VBN") or words[2].tag[:2] not in ("NN", "JJ"):
        return
    first, second = words[0].text.lower(), words[1].text.lower()
    if first in request_words().needs_place and second in deed_states():
        words[0] = replace(words[0], tag="VB", dep="ROOT", lemma=first, head=0)
        words[1] = replace(words[1], tag="JJ", dep="amod", head=2)


def _going_on(request: Request, last: Sequence[SaidDeed]) -> Request:
    """Return "the soap bottle too" as the deed before it, done to that."""
    too = _TOO.search(request.text)
    if not (request.form == "incomplete" and request.alone and last and too):
        return request
    again = last if too[0].lower() == "likewise" else last[-1:]  # "do the same with a spoon"
    deeds = tuple(replace(deed, things=request.alone) for deed in again)
    errand = " and ".join(said(deed, request.whole) for deed in deeds)
    return replace(request, form="errand", lacking="", deeds=deeds, alone=(), errand=errand)


# ----------------------------------------------------------------- one sentence


def _read(s: SaidSentence) -> Request:
    said = s.phrase(0, len(s.words))
    form = _question_or_talk(s)
    nouns = Nouns(s)
    if form:
        named = nouns.all_of(range(len(s.words))) if form == "question" else ()
        about = tuple(meant for one in named for meant in _stood_for(one, s))
        return Request(text=said, form=form, whole=s.text, alone=about)
    pairs = Pairs(s, nouns)
    asides = Asides(s, nouns, pairs)
    asides.read()
    form, deeds = SentenceDeeds(s, nouns, pairs, asides).read()
    deeds = _into_what_was_opened(deeds)
    asides.conditions = [_about(one, deeds) for one in asides.conditions]
    deeds, asides.conditions = _of_each(deeds, asides.conditions)
    lacking = _lacking(s, deeds) if form == "errand" else ""
    if form == "errand":
        s.unread += _rest(s)
    if form == "errand" and not (deeds or asides.forbidden or asides.exclusions or s.unread):
        lacking = "what"
    return Request(
        text=said,
        form="incomplete" if lacking else form,
        errand=_errand(s, next((one.thing for one in asides.conditions if one.thing), None)),
        deeds=tuple(deeds),
        forbidden=tuple(of_what(one, deeds) for one in asides.forbidden),
        exclusions=tuple(left_out_of(one, deeds) for one in asides.exclusions),
        times=tuple(asides.times),
        conditions=tuple(asides.conditions),
        unread=tuple(dict.fromkeys(s.unread)),
        lacking=lacking,
        alone=tuple(s.alone) if form != "errand" else (),
        whole=s.text,
    )


def asked_last(request: Request, before: Sequence[SaidDeed]) -> tuple[SaidDeed, ...]:
    """Return the deeds that were asked for last; "and the mug" is one with what it goes on from."""
    if not (request.deeds and before and _TOO.search(request.text)):
        return request.deeds or tuple(before)
    first, last = request.deeds[0], before[-1]
    if (first.deed, first.place) != (last.deed, last.place):
        return request.deeds
    return (replace(first, things=(*last.things, *first.things)), *request.deeds[1:])


def _stood_for(one: Mention, s: SaidSentence) -> Sequence[Mention]:
    """Return what a question's pronoun stands for: what was done last to what can be so."""
    if not one.vague or one.text.lower() not in _PRONOUNS:
        return (one,)
    states = [request_words().seen.get(low, "") for low in s.lows()]
    needs: set[Capability] = {NEEDS[state] for state in states if state in NEEDS}
    if s.text[: one.start].lower().split()[-1:] in (["in"], ["on"], ["inside"], ["under"]):
        needs.add("receptacle")  # "what is in it?"
    last = [m for m in (s.last.things if s.last else ()) if m.types]
    place = [s.last.place] if s.last and s.last.place else []
    able = [
        m for m in (*place, *s.before, *last)
        if not needs or any(object_types()[k].can(n) for k in m.types for n in needs)
    ]  # fmt: skip
    several = one.text.lower() in ("they", "them", "these", "those") and able[-1:] == last[-1:]
    found = last if several else able[-1:]
    return [replace(m, start=one.start, end=one.end, at=()) for m in found] or (one,)


def _earlier(deed: SaidDeed) -> SaidDeed:
    place = _elsewhere(deed.place) if deed.place is not None else None
    return replace(deed, start=-1, things=tuple(map(_elsewhere, deed.things)), place=place)


def _elsewhere(one: Mention) -> Mention:
    """Return a mention of another text: its place in that says nothing here."""
    return replace(one, start=-1, end=-1)


def _about(condition: Condition, deeds: Sequence[SaidDeed]) -> Condition:
    """Return a condition whose "it" stands for what the first deed is about."""
    things = deeds[0].things if deeds else ()
    if condition.thing is not None or not condition.state or not things:
        return condition
    return replace(condition, thing=things[0])


def _of_each(
    deeds: Sequence[SaidDeed], conditions: Sequence[Condition]
) -> tuple[list[SaidDeed], list[Condition]]:
    """Return the deeds with what conditions tell of their things, and the conditions of it all.

    "Wash the mugs unless they are clean" is of each: wash those that are dirty. "If there is a mug
    on the table, wash it": the one that is there. What else is done to those of a plural is not
    told apart so; such a condition is left without a state that can be looked for.
    """
    left: list[Condition] = []
    for one in conditions:
        same = partial(_is_same, one.thing)
        alike = [two for deed in deeds for two in deed.things if same(two)]
        each = bool(alike) and all(two.every or (two.number or 1) > 1 for two in alike)
        state = one.state if one.holds or one.state == "there" else lacking(one.state)
        at = (one.thing.at if one.thing else ()) or (one.at if one.holds else ())
        deeds = [_with_things(deed, same, at, ()) for deed in deeds]
        each = each and one.of not in ("any", "all")
        if each and state not in ("", "there") and len(deeds) == 1:
            deeds = [_with_things(deed, same, (), (state,)) for deed in deeds]
        elif each and not (one.holds and state == "there"):
            left.append(replace(one, state=""))
        else:
            left.append(one)
    return list(deeds), left


def _is_same(thing: Mention | None, one: Mention) -> bool:
    return thing is not None and bool(one.types) and one.types == thing.types and not one.other


def _with_things(
    deed: SaidDeed, same: Callable[[Mention], bool], at: tuple[str, ...], states: tuple[str, ...]
) -> SaidDeed:
    """Return a deed with more told of some of its things: where they are, or how."""

    def told(one: Mention) -> Mention:
        return replace(one, at=one.at or at, states=(*one.states, *states)) if same(one) else one

    place = deed.place and told(deed.place)
    return replace(deed, things=tuple(map(told, deed.things)), place=place)


def _errand(s: SaidSentence, about: Mention | None) -> str:
    """Return the words that are left to plan by."""
    text = ""
    for number, word in enumerate(s.words):
        if number not in s.gone:
            glued = number and number - 1 not in s.gone and s.words[number - 1].end == word.start
            text += word.text if glued else f" {word.text}"
    text = re.sub(r"\b(?:though|however)\b ?", "", text)
    text = re.sub(r"^(?:[\s,.;:]|and\b|but\b|then\b|so\b)+", "", text)
    text = re.sub(r"(?:[\s,.;:!?]|\band\b|\bbut\b|\bthen\b)+$", "", text)
    text = re.sub(r"\s+([,.;!?])", r"\1", re.sub(r"\s+", " ", text)).strip()
    return re.sub(r"\b(?:it|them)\b", f"the {about.text}", text, count=1) if about else text


def _question_or_talk(s: SaidSentence) -> Form | None:
    """Return "question" where it is one; "talk" where it holds nothing to do or know."""
    left = s.left()
    if not left or set(s.lows()) - {".", "!", ",", "?"} <= request_words().talk:
        return "talk"
    if _PARTING.fullmatch(s.text.strip().lower()):
        return "talk"
    at = left[0]
    while s.low(at) in ("and", "so", "but", "then", "now", "well", "say", ","):
        at += 1
    if _TELL_ME.match(" ".join(s.lows(at, at + 6))):
        return "question"
    first, second, third = (s.low(at + n) for n in range(3))
    marked = s.words[-1].text == "?"
    if first in _MODALS and (second in ("you", "i", "we", "u", "ya", "n't") or third == "you"):
        tells = third in ("tell", "say", "explain", "remember", "see", "know")
        return "question" if tells else None
    if _is_negative_order(first, second, third) or (
        first in ("have", "has") and second in ("a", "the")
    ):
        return None
    if first == "do" and s.tag(at + 1) in ("DT", "PRP$") and not marked:
        return None
    if first in request_words().asking and second != "about":
        orders = first in ("when", "what", "whatever", "where") and _order_follows(s, at)
        return None if orders else "question"
    return "question" if marked and not _order_follows(s, at) else None


def _is_negative_order(first: str, second: str, third: str) -> bool:
    """Return whether a sentence begins with "don't" or "why don't you"."""
    if first == "do" and second in ("not", "n't", "nt"):
        return True
    return first == "why" and second in ("do", "not") and third in ("n't", "not", "you")


def _order_follows(s: SaidSentence, at: int) -> bool:
    """Return whether an order stands at the very beginning, or behind one of the first commas."""
    commas = [n for n in range(at, len(s.words)) if s.low(n) == ","]
    return s.is_order(at) or any(s.is_order(n + 1) for n in commas[:2])


def _lacking(s: SaidSentence, deeds: Sequence[SaidDeed]) -> str:
    """Return what an errand lacks; "" where it is whole."""
    last = [n for n, w in enumerate(s.words) if w.text[0].isalnum() and n not in s.gone]
    if last and last[-1] not in s.taken:
        tag, low = s.tag(last[-1]), s.low(last[-1])
        if tag in ("DT", "PRP$", "PDT", "CC", "TO") or low in _OPEN_ENDS:
            to = request_words().destinations
            return "where" if {low, *s.lows(last[-1] - 1, last[-1])} & to else "what"
        particle = low in ("on", "off", "in", "out", "up", "down", "away", "over", "back")
        if tag == "IN" and not particle and low not in request_words().never_mind:
            return "where"
    return next(filter(None, (_lacks(one, deeds[n:]) for n, one in enumerate(deeds, 1))), "")


def _into_what_was_opened(deeds: Sequence[SaidDeed]) -> list[SaidDeed]:
    """Return deeds, what is put nowhere put into what was opened: "open the drawer, put it in"."""
    found: list[SaidDeed] = []
    for number, deed in enumerate(deeds):
        opened = (one for earlier in found if earlier.deed == "open" for one in earlier.things)
        doors = [one for one in opened if any(able_to(kind, "receptacle") for kind in one.types)]
        where = doors and deed.deed == "put" and _lacks(deed, deeds[number + 1 :]) == "where"
        found.append(replace(deed, place=doors[-1]) if where else deed)
    return found


def _lacks(deed: SaidDeed, later: Sequence[SaidDeed]) -> str:
    """Return what one deed lacks, and no later one about its things says: "move it, put it on"."""
    if deed.deed in ("", "wait"):
        return ""
    if not deed.things and deed.deed not in ("coffee", "go"):
        return "what"
    if any(one.vague and not one.at for one in deed.things):
        return "what"
    if deed.place is not None:
        return "where" if deed.place.vague else ""
    kinds = {kind for one in deed.things for kind in one.types}
    placed = (one for other in later if other.place for one in other.things)
    if any(kinds & {*one.types} for one in placed):
        return ""
    bare = deed.verb in request_words().needs_place or deed.verb.startswith("clear")
    return "where" if deed.deed == "put" and bare else ""


def _rest(s: SaidSentence) -> list[str]:
    """Return the content words that nothing was made of, and what denies and was not taken out."""
    words = request_words()
    small = words.never_mind | words.links | words.auxiliaries | words.be | words.small_verbs
    small |= words.me | words.elsewhere
    sides = {n for n in range(len(s.words)) if s.low(n) in words.regions and s.low(n + 1) == "of"}
    passed = s.gone | s.told_so_words
    denied = [s.low(n) for n in range(len(s.words)) if n not in passed and s.low(n) in _DENIES]
    left = " ".join(s.low(n) for n in range(len(s.words)) if n not in passed and s.low(n).isalnum())
    return denied + _NOT_SERVED.findall(left) + [
        s.low(n) for n in s.left()
        if n not in s.taken | sides and s.words[n].dep != "relcl" and s.low(n) not in small
        and (s.tag(n) not in _SMALL_TAGS or s.low(n) in _AGAIN)
    ]  # fmt: skip
