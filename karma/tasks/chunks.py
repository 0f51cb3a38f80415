"""A sentence cut at commas, "and" and "then", and what each piece is: a deed, a thing, or neither.

A deed has a verb that asks for something; a thing is a noun with or without its place. A piece that
says when ("before you close it") knows whether it comes first or last. What is said in passing
("once that's done") is taken for "then".
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from karma.language.words import base_of, closed_words, verb_tense, word_lists
from karma.tasks.loose_names import UNKNOWN, key_of, names, singular, state_of, tiers_of, verb_at
from karma.tasks.sentence_words import table

Kind = Literal["deed", "thing", "place", "other"]
Order = Literal["", "before", "after"]  # of the main clause; what "before" leads to is done later

_JOINT = re.compile(
    r"(?:,\s*)?\b(?P<then>(?:and\s+|but\s+)?(?:then|next(?! to)|later))\b[\s,]*"
    r"|(?:,\s*)?\b(?P<and>and)\b[\s,]*(?P<also>then\b[\s,]*)?"
    r"|\s*(?P<mark>[,:])\s*",
    re.IGNORECASE,
)
_ORDER = re.compile(
    r"(?<!from )\b(before|after|once|as soon as|when|^having)\s+(?=\w)", re.IGNORECASE
)
_WORD = re.compile(r"[^\W_]+(?:-[^\W_]+)*(?:['’]s\b)?")
_SUBJECT = re.compile(
    r"(?:(?:you|i|we|they)(?:['’](?:ve|re|d))?\s+)?(?:(?:have|having|are|had|just)\s+)*",
    re.IGNORECASE,
)
_STATE = re.compile(r"(?P<thing>.+?)\s+(?P<be>is|are)\s+(?P<state>\w+)$", re.IGNORECASE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Chunk:
    """A piece of a sentence, cut into what leads to its verb, the verb, its object and the rest."""

    joint: str = ""  # before it: ",", ":", "and" or "then"
    kind: Kind
    order: Order = ""
    frame: str = ""  # "could you please"
    verb: str = ""  # with its particle and who it is for: "turn on", "bring me"
    base: str = ""  # of the verb
    object: str = ""
    tail: str = ""  # places, particles, states and the like

    @property
    def text(self) -> str:
        """The whole piece."""
        return joined(self.frame, self.verb, self.object, self.tail)


@dataclass(frozen=True, slots=True)
class _Word:
    word: str
    start: int
    end: int


def joined(*parts: str) -> str:
    """Return the parts that are not empty, with spaces between."""
    return " ".join(part for part in parts if part)


def is_known(name: str) -> bool:
    """Return whether a name means something of the household, if only vaguely."""
    return bool(tiers_of(name)) or key_of(name) in names().vague


def sentences_of(text: str) -> list[str]:
    """Return the sentences of a text, cut at full stops and semicolons."""
    for one in table().passing:
        text = re.sub(one.said, one.means, text, flags=re.IGNORECASE)
    parts = re.split(r"[.;!?]+(?:\s+|$)|\n|→|->", text)
    return [part.strip(" ,:") for part in parts if part.strip(" ,:")]


def chunks_of(sentence: str) -> list[Chunk]:
    """Return the pieces of one sentence, in its order."""
    found: list[Chunk] = []
    for joint, order, text in _pieces(sentence):
        piece = _read(text, found)
        if order:
            piece = _subordinate(text, order, piece)
        found.append(replace(piece, joint=joint))
    return found


# ----------------------------------------------------------------- pieces


def _pieces(sentence: str) -> Iterator[tuple[str, Order, str]]:
    """Yield the pieces with their joints, cut also before "before you ..."."""
    at, joint = 0, ""
    for match in (*_JOINT.finditer(sentence), None):
        text = sentence[at : match.start() if match else len(sentence)].strip(" ,")
        for order, part in _ordered(text):
            if part:
                yield joint, order, part
                joint = ""
        if match is not None:
            following = _joint(match)
            joint = following if text or not joint or following == "then" else joint
            at = match.end()


def _joint(match: re.Match[str]) -> str:
    if match["then"] or match["also"]:
        return "then"
    return "and" if match["and"] else match["mark"]


def _ordered(text: str) -> Iterator[tuple[Order, str]]:
    """Yield what stands before "before" or "after", and what they lead to."""
    match = _ORDER.search(text)
    ahead = text[: match.start()] if match else ""
    if match is None or {"that", "which", "who"} & {one.word for one in _words(ahead)}:
        yield "", text
        return
    yield "", ahead.strip(" ,")
    yield "before" if match[1].lower() == "before" else "after", text[match.start() :]


def _words(text: str) -> list[_Word]:
    return [
        _Word(re.sub(r"['’]s$", "", match[0].lower()), match.start(), match.end())
        for match in _WORD.finditer(text)
    ]


def _slice(text: str, words: Sequence[_Word], start: int, end: int) -> str:
    """Return the text of some words, with what stands between them."""
    if start >= end:
        return ""
    until = words[end].start if end < len(words) else len(text)
    return text[words[start].start if start else 0 : until].strip(" ,")


# ----------------------------------------------------------------- one piece


def _read(text: str, found: Sequence[Chunk]) -> Chunk:
    """Return what a piece is, its joint and order left open.

    Args:
        text: of the piece.
        found: the pieces before it.
    """
    words = _words(text)
    plain = [one.word for one in words]
    start = _start(plain)
    at = _verb(plain, start, found)
    if at is not None:
        end = _verb_end(plain, at)
        cut = _object_end(plain, end)
        return Chunk(
            kind="deed",
            base=base_of(plain[at]) or plain[at],
            frame=_slice(text, words, 0, at),
            verb=_slice(text, words, at, end),
            object=_slice(text, words, end, cut),
            tail=_slice(text, words, cut, len(words)),
        )
    if _is_thing(plain, start, alone=not found):
        cut = _object_end(plain, start)
        return Chunk(
            kind="thing",
            object=_slice(text, words, start, cut),
            tail=_slice(text, words, cut, len(words)),
        )
    places = word_lists().destinations | word_lists().sources
    return Chunk(kind="place" if plain and plain[0] in places else "other", tail=text)


def _start(plain: Sequence[str]) -> int:
    """Return the number of the first word that is no adverb or the like."""
    leads = (word_lists().adverbs - word_lists().negations) | table().words.leads
    return next((n for n, word in enumerate(plain) if word not in leads), len(plain))


# ----------------------------------------------------------------- verbs


def _verb(plain: Sequence[str], start: int, found: Sequence[Chunk]) -> int | None:
    """Return the number of the word that is the verb of a request; None without one."""
    first = not any(one.kind == "deed" for one in found)
    if start == len(plain) or (plain[start] == "to" and first):  # "to warm the room, ..."
        return None
    wanted = _wanting(plain)
    if wanted is not None:
        return wanted
    if plain[start] == "have" and plain[start + 1 : start + 2] != []:
        return start if plain[start + 1] in word_lists().determiners else None
    at, groups = verb_at(plain, start, first=first)
    if groups and _asks(plain, at, groups, found):
        return None if _is_told(plain[:at]) else at
    if plain[start] in word_lists().determiners:
        return None
    if verb_tense(plain[start]) == "base" and not is_known(plain[start]):
        return start
    return next((n for n in range(start + 1, len(plain)) if _led_to(plain, n)), None)


def _is_told(before: Sequence[str]) -> bool:
    """Return whether what stands before a verb makes it a statement: "I said", "we have to"."""
    words = table().words
    if "have" in before and {"i", "we"} & set(before) and "you" not in before:
        return True
    return bool(words.tellers & set(before)) and not words.frames & set(before)


def _wanting(plain: Sequence[str]) -> int | None:
    """Return where "I need the", "I'd like a", "it would be nice to have the" stands."""
    follow = word_lists().determiners | word_lists().pronoun_heads | {"it", "them"}
    for at, word in enumerate(plain[:-1]):
        before = set(plain[:at])
        if plain[at + 1] not in follow and not is_known(" ".join(plain[at + 1 : at + 3])):
            continue
        hoped = {"it", "would"} <= before and word in ("if", "have")
        wants = word in table().verbs.wants or (word == "use" and "could" in before)
        asked = wants and bool({"i", "we"} & before)
        if hoped or (
            asked and (word != "have" or {"rather", "to", "may", "can", "could"} & before)
        ):
            return None if {"don", "not", "t"} & before else at
    return None


def _asks(plain: Sequence[str], at: int, groups: frozenset[str], found: Sequence[Chunk]) -> bool:
    """Return whether a verb asks for something; a past form does behind "if you washed ..."."""
    if verb_tense(plain[at]) == "past" and plain[at] not in table().verbs.both_tenses:
        return any("if" in one.frame.lower().split() or verb_tense(one.base) for one in found)
    return UNKNOWN not in groups or plain[at] not in closed_words()


def _led_to(plain: Sequence[str], at: int) -> bool:
    """Return whether a word is the verb that "would you mind", "if you", "on the desk" lead to."""
    adverbs = word_lists().adverbs | {"also"}
    before = next((word for word in reversed(plain[:at]) if word not in adverbs), "")
    word = plain[at]
    if before == "you" and verb_tense(word) == "past":
        return "if" in plain[:at]
    stands, groups = verb_at(plain, at)
    if stands != at or not groups or UNKNOWN in groups:
        return False
    if before in table().words.asking:
        asks = plain[0] != "if" or {"could", "would"} & set(plain[:at])
        return word != "do" and bool(asks) and not {"that", "which"} & set(plain[:at])
    fronted = plain[0] in word_lists().prepositions
    return fronted and plain[at + 1 : at + 2] != [] and plain[at + 1] in word_lists().determiners


def _verb_end(plain: Sequence[str], at: int) -> int:
    """Return the end of a verb with its particle and who it is for."""
    lists, end = word_lists(), at + 1
    word = plain[end] if end < len(plain) else ""
    switches = (base_of(plain[at]) or plain[at]) in lists.switching
    free = word not in ("in", "on", "off", "over") or (switches and word != "in")
    if word in lists.particles and free and plain[end : end + 2] != ["out", "of"]:
        end += 1
    if plain[end : end + 1] == ["of"]:  # "get rid of"
        end += 1
    for ensuring in (["make", "sure"], ["see", "to", "it"]):
        if plain[at : at + len(ensuring)] == ensuring:
            end = at + len(ensuring)
            return end + (plain[end : end + 1] == ["that"])
    return end + (plain[end : end + 1] in (["me"], ["us"]))


# ----------------------------------------------------------------- things


def _object_end(plain: Sequence[str], start: int) -> int:
    """Return where the object of a verb ends: at a place, particle, state, or a clause about it."""
    lists, words = word_lists(), table().words
    ends = lists.prepositions | lists.particles | words.relatives | words.behind | lists.adverbs
    for at in range(start, len(plain)):
        word, behind = plain[at], at > start
        if word == "of" and plain[at - 1] == "out":
            return at - 1
        if word in ends - {"of", "that", "only"} or (word in ("that", "it") and behind):
            return at
        if behind and plain[at - 1] not in lists.determiners and _is_state(plain, at):
            return at
    return len(plain)


def _is_state(plain: Sequence[str], at: int) -> bool:
    """Return whether a word says what becomes of the thing before it: "the lamp turned off"."""
    word, rest = plain[at], plain[at + 1 : at + 2]
    verbs = table().verbs
    if word in verbs.stated | verbs.belonging or verb_tense(word) in ("past", "ing"):
        return True
    return state_of(word) is not None and (not rest or rest[0] in closed_words())


def _is_thing(plain: Sequence[str], start: int, *, alone: bool) -> bool:
    """Return whether words are a noun with what belongs to it."""
    lists, themselves = word_lists(), table().words.themselves
    if start >= len(plain) or (plain[start] in themselves and plain[start:] != ["both"]):
        return False
    if plain[start] in lists.determiners:
        follows = (lists.prepositions | lists.auxiliaries) - {"of"}  # "both on", "that would"
        return len(plain) > start + 1 and plain[start + 1] not in follows
    if verb_tense(plain[start]) == "past" or _is_third(plain[start]):
        return False
    end = _object_end(plain, start)
    if start == end or plain[start] in closed_words():
        return False
    if is_known(" ".join(plain[start:end])):
        return True
    if alone:
        return end < len(plain) and verb_tense(plain[end]) != "ing"
    plural = singular(plain[end - 1]) != plain[end - 1]
    return end - start <= 3 and (plural or end < len(plain)) and not plain[start].endswith("ly")


def _is_third(word: str) -> bool:
    """Return whether a word can only be a verb of somebody else: "stays", "looks"."""
    plain = singular(word)
    return plain != word and not tiers_of(word) and bool(verb_at([plain], 0, first=True)[1])


# ----------------------------------------------------------------- before and after


def _subordinate(text: str, order: Order, piece: Chunk) -> Chunk:
    """Return a piece behind "before", "after", "once" as the deed that it speaks of."""
    idle = Chunk(kind="other", tail=piece.text)
    text = _ORDER.sub("", text, count=1)
    subject = _SUBJECT.match(text)
    text = text[subject.end() :] if subject else text
    words = _words(text)
    if not words or words[0].word in ("that", "this", "doing"):
        return idle
    state = _STATE.fullmatch(text)
    if state and state_of(state["state"]) in ("on", "off", "opened", "closed"):
        return Chunk(
            kind="deed",
            order=order,
            verb="make sure",
            base="make",
            object=state["thing"],
            tail=f"{state['be']} {state['state']}",
        )
    base = base_of(words[0].word) or words[0].word
    again = _read(f"{base}{text[words[0].end :]}", ())
    if again.kind == "deed" and (again.object or again.tail):
        return replace(again, order=order)
    told = _words(again.tail)[:1] and _words(again.tail)[0].word in table().verbs.stated
    if again.kind == "thing" and not told and not (subject and subject[0]):
        return replace(again, order=order)
    return idle
