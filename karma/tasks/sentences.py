"""The requests of a sentence, each as an instruction by itself, in the order to be done in.

"Take the mug and the plate to the sink" is two requests, "pick up the mug and put it in the sink"
one, and "before you turn off the lamp, close the door" begins with the door. A deed on what was
spoken of last may stay with it ("wash the apple and slice it"). What asks for nothing goes with the
request beside it.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

from karma.language.words import word_lists
from karma.tasks.chunks import Chunk, chunks_of, is_known, joined, sentences_of
from karma.tasks.loose_names import tiers_of, words_of
from karma.tasks.sentence_words import table
from karma.tasks.wordings import (
    Wording,
    has_clause,
    is_determined,
    is_fixed,
    is_plural_word,
    last_preposition,
    of_one,
    share_head,
    shared,
)

_EARLIER = re.compile(
    r"\b(?:but\s+)?(?:beforehand|before that|first,? though|but first)\b,?", re.IGNORECASE
)
_SAME = re.compile(r"\bdo (?:the same|so|likewise) (?:with|for|to)\s+", re.IGNORECASE)
_WISH = re.compile(r"\b(?:i|we)(?:['’]d| would)?\b", re.IGNORECASE)


def split_instruction(text: str) -> tuple[str, ...]:
    """Return the requests of a text, each as an instruction, first things first.

    >>> split_instruction("Take the mug and the plate to the sink and then turn on the lamp.")
    ('Take the mug to the sink', 'Take the plate to the sink', 'turn on the lamp')
    >>> split_instruction("Before you turn off the lamp, put the salt on the table.")
    ('put the salt on the table', 'turn off the lamp')
    """
    found: list[Wording] = []
    waiting = ""
    for sentence, earlier in _sentences(text):
        reader = _Reader(waiting=waiting, said=found)
        requests = reader.read(chunks_of(sentence))
        waiting = reader.waiting
        if earlier and found and requests:
            found[-1:-1] = [one.named(found[-1]) for one in requests]
        else:
            found += requests
    if waiting and found:
        found[-1].more += f", {waiting.rstrip(', :')}"
    return tuple(one.text for one in found) or (text.strip(),)


def _sentences(text: str) -> Iterator[tuple[str, bool]]:
    """Yield the sentences, and of each whether it comes before the request ahead of it."""
    for sentence in sentences_of(text):
        match = _EARLIER.search(sentence)
        if match is None:
            yield sentence, False
        elif match.end() == len(sentence) or not match.start():
            yield _EARLIER.sub("", sentence).strip(" ,"), True
        else:
            yield sentence[: match.start()].strip(" ,"), False
            yield sentence[match.end() :].strip(" ,"), True


@dataclass(slots=True)
class _Reader:
    """Reads one sentence."""

    waiting: str  # what was said before the first request
    said: list[Wording]  # requests of sentences before
    group: list[Wording] = field(default_factory=list)  # things with one verb
    done: list[Wording] = field(default_factory=list)

    def read(self, chunks: Sequence[Chunk]) -> list[Wording]:
        """Return the requests of a sentence; what leads nowhere stays in `waiting`."""
        scopes: dict[str, list[Chunk]] = {"after": [], "": [], "before": []}
        scope: str = ""
        base = next((one for one in chunks if one.kind == "deed" and not one.order), None)
        for chunk in chunks:
            if chunk.order or chunk.joint != "and":
                scope = chunk.order
            bare = bool(chunk.order) and chunk.kind == "thing" and base is not None
            scopes[scope].append(
                replace(chunk, kind="deed", verb=base.verb, base=base.base)
                if bare and base is not None
                else chunk
            )
        first, main, last = (self._main(scopes[name]) for name in ("after", "", "before"))
        led = bool(chunks) and bool(chunks[0].order)
        if main and last and led:
            main[0] = main[0].named(last[0])
        if main and first and not led:
            first[-1] = first[-1].named(main[0])
        return [*first, *main, *last]

    def _main(self, chunks: Sequence[Chunk]) -> list[Wording]:
        for chunk in chunks:
            if chunk.kind == "deed":
                self._deed(chunk)
            elif chunk.kind == "thing":
                self._thing(chunk)
            else:
                self._other(chunk)
        self._close()
        done, self.done = self.done, []
        return done

    def _close(self) -> None:
        """End a group: what its last thing has, a place or a state, the others have as well."""
        group, self.group = self.group, []
        if not group:
            return
        idle = len(group) == 1 and group[0].is_idle
        if idle or (not group[0].verb and not any(one.is_asked for one in group)):
            self.waiting += "".join(f"{one.text}, " for one in group)
            return
        for one, following in reversed(list(pairwise(group))):
            one.tail = joined(one.tail, shared(following.tail, one.tail))
        if len(group) > 1:
            for one in group:
                word, _, rest = one.tail.partition(" ")
                one.tail = joined(table().verbs.third.get(word, word), rest)
        self.done += group

    # ------------------------------------------------------------- deeds

    def _deed(self, chunk: Chunk) -> None:
        if _SAME.search(chunk.text):
            self._same(chunk)
            return
        deed = Wording.of(chunk)
        last = self.group[-1] if self.group else None
        if last is not None and last.is_idle and chunk.joint != "then":
            self.group.pop()
            deed.frame = f"{last.text}{_between(chunk)}{deed.frame}".strip()
            if not self.group and self.done and self._is_about(self.done[-1], last, deed, chunk):
                self.group = [self.done.pop()]
        if self._is_aside(chunk):
            self._other(chunk)
        elif self.group and deed.goes_on(self.group[-1], chunk.joint):
            several = len(self.group) > 1
            for one in self.group:
                one.more += _between(chunk) + (of_one(deed.text) if several else deed.text)
                one.chained = True
        else:
            self._begin(deed)

    def _is_about(self, before: Wording, idle: Wording, deed: Wording, chunk: Chunk) -> bool:
        """Return whether a deed is about what was spoken of before an idle one, not in it."""
        named = any(map(is_known, words_of(joined(idle.object, idle.tail))))
        return deed.goes_on(before, chunk.joint) and (before.is_carried or not named)

    def _is_aside(self, chunk: Chunk) -> bool:
        """Return whether a bare verb goes on with a clause: "so that I can read and write"."""
        if not self.group or chunk.object or chunk.tail or chunk.joint != "and":
            return False
        return has_clause(words_of(self.group[-1].tail + self.group[-1].more))

    def _begin(self, deed: Wording) -> None:
        """Begin a group; what is done to "them" is done to each."""
        told = [] if any(one.verb for one in self.group) else self.group
        self._close()
        before = self.done[-2:] if "both" in deed.near_words else told or _alike(self.done)
        spoken_of = [one for one in before if one.object]
        if table().words.plural & deed.near_words and len(spoken_of) > 1:
            self.group = [replace(deed.for_each(one.object), frame="") for one in spoken_of]
            self.group[0].frame, self.waiting = deed.frame, ""
            self._close()
            return
        deed.frame = f"{self.waiting}{deed.frame}".strip()
        self.waiting = ""
        self.group = [deed]

    def _same(self, chunk: Chunk) -> None:
        """Do with another thing what was done with the last one."""
        self._close()
        model = (self.done or self.said)[-1:]
        if not model:
            self.waiting += f"{chunk.text}, "
            return
        thing = _SAME.split(chunk.text, maxsplit=1)[-1]
        self.group = [replace(model[0], object=thing, frame="")]

    # ------------------------------------------------------------- things

    def _thing(self, chunk: Chunk) -> None:
        if not self.group:
            self._fragment(chunk)
            return
        last = self.group[-1]
        known = any(map(is_known, words_of(last.object))) and not last.is_idle
        if chunk.joint == ":" and not (last.verb and known):
            self.group.pop()
            self.waiting += f"{last.text}: "
            self._fragment(chunk)
        elif last.verb and not last.object and not last.is_idle:  # "wash, in this order, the mug"
            last.object, last.tail = chunk.object, joined(chunk.tail, last.tail)
        elif _belongs(last, chunk):
            last.more += _between(chunk) + chunk.text
        elif last.is_idle and not last.object:
            self._other(chunk)
        elif _adjectives(last, chunk):
            last.object += f"{last.more}{_between(chunk)}{chunk.object}"
            last.tail, last.more = chunk.tail, ""
        else:
            self._one_more(chunk)

    def _fragment(self, chunk: Chunk) -> None:
        """Begin with a thing without a verb: "the mug in the sink"."""
        self.group = [Wording(frame=self.waiting.strip(), object=chunk.object, tail=chunk.tail)]
        self.waiting = ""

    def _one_more(self, chunk: Chunk) -> None:
        """Add a thing to the group: it has the group's verb, and its place if it has none."""
        first, last = self.group[0], self.group[-1]
        verb = first.verb
        words = words_of(first.frame)
        if words and words[0] in word_lists().destinations:  # "on the desk put the cup and ..."
            verb = joined(first.frame, verb)
        elif first.base in table().verbs.wants and (wish := _WISH.search(first.frame)):
            verb = joined(wish[0], verb)
        one = Wording(verb=verb, base=first.base, object=chunk.object, tail=chunk.tail)
        share_head(last, one)
        word = words_of(first.tail)[:1]
        if not first.verb and one.tail and set(word) & table().verbs.belonging:
            one.tail = joined(*word, one.tail)  # "the mug goes in the sink and the fork in ..."
        if first.place and not one.place:
            one.tail = joined(first.tail, chunk.tail)
        self.group.append(one)

    def _other(self, chunk: Chunk) -> None:
        """Take in what is neither deed nor thing: a place, a particle, a word in passing."""
        words = words_of(chunk.text)
        last = next(iter((self.group or self.done)[-1:]), None)
        if last is not None and last.verb and words[:1] in (["on"], ["off"]) and len(words) < 3:
            self._close()
            self.group = [replace(last, frame="", tail=chunk.text, more="")]  # "and off again"
        elif last is None or not self.group:
            self.waiting += f"{chunk.text}, "
        elif chunk.kind == "place" and not last.place and not last.more:
            last.tail = joined(chunk.text, last.tail)
        else:
            last.more += _between(chunk) + chunk.text


def _between(chunk: Chunk) -> str:
    return " and " if chunk.joint == "and" else ", "


def _alike(done: Sequence[Wording]) -> list[Wording]:
    """Return the last requests that have one verb."""
    found: list[Wording] = []
    for one in reversed(done):
        if found and one.verb.lower() != found[0].verb.lower():
            break
        found.insert(0, one)
    return found


def _belongs(last: Wording, chunk: Chunk) -> bool:
    """Return whether a thing is part of what was said of the last one."""
    said, words = words_of(last.tail + last.more), words_of(chunk.object)
    preposition, sets = last_preposition(said), table().words
    if chunk.joint == "," and (words[:2] == ["the", "one"] or words[-1] in ("one", "ones")):
        return True
    if chunk.joint == "and" and not chunk.tail and preposition in sets.beside:
        return True
    if preposition in sets.conjoined and not (chunk.tail and is_determined(chunk.object)):
        return True
    goes = preposition in word_lists().destinations - {"to"}
    if not is_determined(chunk.object) and has_clause(said[:-1]) and not goes:
        return True
    return bool(last.place) and not chunk.tail and is_fixed(chunk.object)


def _adjectives(last: Wording, chunk: Chunk) -> bool:
    """Return whether "the red" waits for its noun in "and blue cup"."""
    words, more = words_of(last.object), words_of(chunk.object)
    if last.tail or len(words) != 2 or not is_determined(last.object) or tiers_of(words[1]):
        return False
    return len(more) > 1 and not is_plural_word(more[-1]) and not is_determined(chunk.object)
