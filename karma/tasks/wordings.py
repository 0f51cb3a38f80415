"""A request in the making: its words, and what they tell of place, pronouns and kind."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from karma.household.types import object_type
from karma.household.uses import KNIVES
from karma.language.words import word_lists
from karma.tasks.chunks import Chunk, is_known, joined
from karma.tasks.loose_names import meaning, names, singular, tiers_of, words_of
from karma.tasks.sentence_words import table

_PLURAL = re.compile(r"\b(?:them|both|these|those)\b", re.IGNORECASE)
_RELATIVE = re.compile(r"\b(?:that|which|who|because|since|so|if|when|where)\s+(?=\w+\s)")


@dataclass(slots=True)
class Wording:
    """One request, in the words that will be said."""

    frame: str = ""  # what leads to the verb
    verb: str = ""
    base: str = ""
    object: str = ""
    tail: str = ""  # places, particles, states
    more: str = ""  # further deeds on the same thing, and what is said in passing
    chained: bool = False  # `more` has a further deed

    @classmethod
    def of(cls, chunk: Chunk) -> "Wording":
        """Return the wording of a piece of a sentence."""
        return cls(
            frame=chunk.frame,
            verb=chunk.verb,
            base=chunk.base,
            object=chunk.object,
            tail=chunk.tail,
        )

    @property
    def text(self) -> str:
        """All of it."""
        return joined(self.frame, self.verb, self.object, self.tail) + self.more

    @property
    def place(self) -> str:
        """Where a thing goes or what becomes of it, from the last preposition on."""
        return place_in(self.tail)

    @property
    def near_words(self) -> frozenset[str]:
        """The words of object and place, up to a clause that says which one is meant."""
        if self.object and words_of(self.tail)[:1] == ["it"]:  # "the bowl it was in"
            return frozenset(words_of(self.object))
        near = _RELATIVE.split(joined(self.object, self.tail), maxsplit=1)[0]
        return frozenset(words_of(near))

    @property
    def is_idle(self) -> bool:
        """Whether it is no deed by itself: "go ahead", "do me a favour"."""
        verbs, words = table().verbs, words_of(joined(self.object, self.tail))
        if self.base in verbs.prepare_alone:
            return not self.object and not {"on", "off"} & {*words, *self.verb.split()}
        if self.base not in verbs.prepare or has_clause(words_of(self.tail)):
            return False
        if self.base in verbs.always_prepare:
            return True
        if self.base in verbs.idle_with:
            return bool(table().words.idle_nouns & set(words)) or words in ([], ["around"])
        return not any(map(is_known, words))

    @property
    def is_asked(self) -> bool:
        """Whether a thing without a verb is asked for: it has a place, or what is to become."""
        words, verbs = words_of(self.tail), table().verbs
        if verbs.belonging & set(words) or words[:2] == ["for", "me"]:
            return True
        if not words or words[0] in verbs.stated or words == ["up"]:
            return False
        return bool(self.place) and not re.search(r"['’]s$", self.object)

    @property
    def is_carried(self) -> bool:
        """Whether its thing is in the hand, for something that is still to be said."""
        return self.base in table().verbs.carry and not self.place and not self.chained

    def goes_on(self, last: "Wording", joint: str) -> bool:
        """Return whether it goes on with the thing of the last one, in one request.

        Args:
            last: the wording before it.
            joint: between the two.
        """
        words = table().words
        if not last.verb:
            return False
        if not last.object and not last.tail and self.object:  # "wash and slice the apple"
            plain = last.base in table().verbs.prepare | set(names().verbs["none"].words)
            return joint in ("and", ",") and not plain
        if last.base in table().verbs.carry and meaning(last.object) & set(KNIVES):
            return self.base in names().verbs["slice"].words  # "get a knife and cut the bread"
        again = bool(self.near_words & (words.single | words.plural))
        again = again or (joint == "and" and bool(self.near_words & words.parts))
        return again and (joint == "and" or last.is_carried)

    def named(self, by: "Wording") -> "Wording":
        """Return it with the name that its pronoun meant, which is said only later."""
        pronouns = table().words.single | table().words.plural
        if not by.object or set(words_of(by.object)) & pronouns:
            return self
        if "there" in words_of(self.tail) and by.place:
            return self._put(re.compile(r"\bthere\b", re.IGNORECASE), by.place)
        return self._put(re.compile(r"\b(?:it|them)\b", re.IGNORECASE), by.object)

    def for_each(self, thing: str) -> "Wording":
        """Return it with one thing in place of "them"."""
        return self._put(_PLURAL, thing)

    def _put(self, pattern: re.Pattern[str], name: str) -> "Wording":
        if pattern.search(self.object):
            return replace(self, object=pattern.sub(name, self.object, count=1))
        if pattern.search(self.tail):
            return replace(self, tail=pattern.sub(name, self.tail, count=1))
        return replace(self, more=pattern.sub(name, self.more, count=1))


def of_one(text: str) -> str:
    """Return a text about several things as it is said of one."""
    return _PLURAL.sub("it", text)


# ----------------------------------------------------------------- places and clauses


def place_in(tail: str) -> str:
    """Return the place or state that a tail ends with; "" without one."""
    words = tail.split()
    for at in range(len(words) - 2, -1, -1):
        word = words[at].lower()
        if word in word_lists().destinations and not (word == "to" and _leads_on(words[at + 1 :])):
            return " ".join(words[at:])
    plain = words_of(tail)
    if not plain or plain[0] in table().words.no_place:
        return ""
    alone = plain[0] in word_lists().particles | {"there"}
    short = plain[0] not in word_lists().prepositions and len(plain) < 3
    return tail if alone or short else ""


def shared(tail: str, own: str) -> str:
    """Return what of the last thing's tail another one lacks."""
    lies = re.match(r"(?:that|which)(?:['’]s| is| are)\b", own)
    if not tail or (place_in(own) and not lies):
        return ""
    return place_in(tail) if own else tail


def has_clause(words: Sequence[str]) -> bool:
    """Return whether words say why, or which one: "that you use", "to cut"."""
    to = [at for at, word in enumerate(words[:-1]) if word == "to"]
    return bool(table().words.clauses & set(words)) or any(_leads_on(words[n + 1 :]) for n in to)


def last_preposition(words: Sequence[str]) -> str:
    """Return the last preposition among words, of one word or two; "" without one."""
    prepositions = word_lists().prepositions
    for at in range(len(words) - 1, -1, -1):
        pair = " ".join(words[max(at - 1, 0) : at + 1])
        if pair in prepositions:
            return pair
        if words[at] in prepositions:
            return words[at]
    return ""


def _leads_on(words: Sequence[str]) -> bool:
    """Return whether behind "to" a deed follows, not a place."""
    word, lists = words[0].lower(), word_lists()
    if word in lists.determiners | lists.persons | lists.pronouns | lists.heads:
        return False
    return not tiers_of(word) and not tiers_of(" ".join(words[:2]))


# ----------------------------------------------------------------- names


def is_determined(name: str) -> bool:
    """Return whether a name begins with an article or the like, or a number."""
    words = words_of(name)
    return bool(words) and (words[0] in word_lists().determiners or words[0] in names().numbers)


def is_fixed(name: str) -> bool:
    """Return whether a name means only what nobody carries."""
    kinds = [kind for tier in tiers_of(name)[:1] for kind in tier]
    return bool(kinds) and not any(object_type(kind).can("pickupable") for kind in kinds)


def share_head(last: Wording, one: Wording) -> None:
    """Give "the salt" the head of "pepper shakers", and make both one thing."""
    words, more = words_of(last.object), one.object.split()
    if len(more) < 2 or is_determined(one.object) or not words or not is_plural_word(more[-1]):
        return
    head = singular(more[-1].lower())
    whole = "".join(singular(word) for word in (words[-1], head))
    if tiers_of(words[-1]) and whole not in names().types:
        return
    article = words[0] if is_determined(last.object) else ""
    last.object = f"{last.object} {head}"
    one.object = joined(article, *more[:-1], head)


def is_plural_word(word: str) -> bool:
    """Return whether a word ends as several things do."""
    return singular(word.lower()) != word.lower()
