"""What an instruction speaks of: its noun phrases, pronouns and verbs, found by rules.

A noun phrase runs from its determiner to the next function word. What follows it is part of it
where it says what the thing is or is for ("something to write with", "a thing you can drink from"),
and stands apart as a modifier where it says which one is meant ("you just washed", "from the
fridge"). Nothing here knows a single kind of thing: a word in no closed list is content.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

from karma.plugins.rules.wording.cursor import FORMS_OF_BE, STOPS, Cursor, read_tail, tokens_of
from karma.plugins.rules.wording.parts import (
    NounPhrase,
    Phrases,
    Pronoun,
    VerbPhrase,
    head_of,
    with_roles,
)
from karma.plugins.rules.wording.words import base_of, verb_forms, verb_tense, word_lists

_SEEMS = frozenset(["looks", "feels", "seems", "smells", "gets", "got"])
_ARTICLES = frozenset(["a", "an", "the", "my", "your", "his", "her", "our", "another", "some"])
_ING_OBJECT = frozenset(("need", "want", "start", "stop", "finish", "avoid"))


@lru_cache(maxsize=4096)
def phrases_of(instruction: str) -> Phrases:
    """Return the phrases of an instruction; of any text, if only none.

    >>> found = phrases_of("Put something to write with on the old desk")
    >>> [(noun.text, noun.head, noun.role) for noun in found.nouns]
    [('something to write with', 'something', 'thing'), ('old desk', 'desk', 'destination')]
    >>> [verb.text for verb in found.verbs]
    ['put']
    """
    reader = _PhraseReader(tokens_of(instruction))
    reader.read()
    return Phrases(
        nouns=tuple(reader.nouns), pronouns=tuple(reader.pronouns), verbs=tuple(reader.verbs)
    )


@dataclass(slots=True)
class _PhraseReader(Cursor):
    """One pass over the words; a segment is what goes with one verb."""

    slot: bool = True  # a verb may stand here
    negated: bool = False
    stated: bool = False  # the clause says how things are
    obliged: bool = False  # or how they should be
    preposition: str = ""  # that waits for its noun
    segment: int = 0  # first noun phrase of this verb
    nouns: list[NounPhrase] = field(default_factory=list)
    pronouns: list[Pronoun] = field(default_factory=list)
    verbs: list[VerbPhrase] = field(default_factory=list)

    # ------------------------------------------------------------- sentence

    def read(self) -> None:
        """Read all words."""
        parts = (self._stop, self._joint, self._verb, self._preposition, self._noun)
        while self.at < len(self.tokens):
            if not any(read() for read in parts):
                self.at += 1
        self._close_segment()

    def _stop(self) -> bool:
        word = self.word()
        if word not in STOPS:
            return False
        if self.stated:
            self._close_segment()
        self.slot, self.preposition, self.negated = True, "", False
        self.stated = self.obliged = False
        self.at += 1
        return True

    def _joint(self) -> bool:
        """Read a word that leads to a verb, or away from one."""
        lists, word = word_lists(), self.word()
        if word in lists.negations:
            self.negated, self.slot = True, True
        elif word in ("forget", "hesitate", "fail") and self.negated:
            self.negated, self.slot = False, True
        elif word in FORMS_OF_BE | _SEEMS and self._predicate():
            return True
        elif word in lists.auxiliaries and not (self.slot and self._is_command()):
            self.slot = True
            self.obliged = self.obliged or word in ("sure", "ensure", "should", "must", "let")
        elif word in lists.conjunctions and not (
            word in ("next", "before") and self.word(1) == "to"
        ):
            self.slot, self.preposition = True, ""
            self.negated = self.negated and word in ("and", "or")
        elif word in lists.persons:
            self.preposition = ""
        elif word == "to" and self.verb_follows(1):
            self.slot = True
        elif word not in lists.adverbs:
            return False
        self.at += 1
        return True

    def _predicate(self) -> bool:
        """Step over "is very dirty": what follows a form of "be" and is neither thing nor deed."""
        there = self.word(-1) == "there" or self.word(1) == "there" or self.word() == "there's"
        self.stated = self.stated or there or (bool(self.nouns) and not self.obliged)
        self.slot = True
        self.at += 1
        if there or (self.begins_noun() and not self.is_content()):
            return True
        while self.word() in word_lists().adverbs - {"not", "never"}:
            self.at += 1
        while self.is_content() and verb_tense(self.word()) not in ("past", "ing"):
            self.at += 1
        return True

    def _is_command(self) -> bool:
        """Return whether an auxiliary is the deed itself: "start the microwave"."""
        known = verb_forms().get(self.word())
        if known is None or known.tense != "base" or self.word() in ("do", "have", "make"):
            return False
        return self.word(1) in word_lists().determiners

    # ------------------------------------------------------------- verbs

    def _is_verb(self) -> bool:
        if not self.slot or not self.is_content():
            return False
        word, known = self.word(), verb_forms().get(self.word())
        if word in word_lists().heads and known is None:
            return False
        if known is None:
            first = not self.nouns or self.word(-1) in STOPS or self.word(-1) in ("then", "to")
            return self.takes_object(1) or (first and not self._behind_noun() and self._bare(1))
        if known.tense == "s":  # "wants", but also "glasses of water"
            return bool(self.nouns) and self.word(1) != "of"
        return not (self.word(-1) == "and" and self._coordinated())

    def _behind_noun(self, between: int = 0) -> bool:
        """Return whether the last noun phrase ends before this word, with so many in between."""
        last = self.at - 1 - between
        return bool(self.nouns) and last >= 0 and self.nouns[-1].end == self.tokens[last].end

    def _bare(self, offset: int) -> bool:
        """Return whether an object without a determiner follows an unknown first word."""
        if self.at != 0 and self.word(-1) not in ("please", "then", "to", ",", ".", ";"):
            return False
        return self.is_content(offset) and not self.is_content(offset + 1)

    def _coordinated(self) -> bool:
        """Return whether a verb's form behind "and" is one more noun: "the salt and the plant"."""
        known = verb_forms().get(self.word())
        if known is None or known.tense != "base":
            return False
        follows = self.word(1)
        return self._behind_noun(1) and follows in ("", *STOPS, "from", "of", "are", "is")

    def _verb(self) -> bool:
        if not self._is_verb():
            return False
        self._close_segment()
        token = self.tokens[self.at]
        base = base_of(token.word) or token.word
        text, end = base, token.end
        self.at += 1
        if self._is_particle(base):
            text, end = f"{base} {self.word()}", self.tokens[self.at].end
            self.at += 1
            if self.word(-1) == "rid":
                text, end = f"{text} of", self.tokens[min(self.at, len(self.tokens) - 1)].end
        self.verbs.append(
            VerbPhrase(text=text, base=base, start=token.start, end=end, negated=self.negated)
        )
        if self.word() == "of":  # "dispose of", "take hold of"
            self.at += 1
        doing = base in _ING_OBJECT and verb_tense(self.word()) == "ing"
        self.slot = doing or self.word() == "and"
        self.preposition = ""
        return True

    def _is_particle(self, base: str) -> bool:
        """Return whether the word behind a verb belongs to it, not to a place."""
        lists, word = word_lists(), self.word()
        if word not in lists.particles:
            return False
        if word in ("on", "off", "in", "out"):
            from_somewhere = word == "out" and self.word(1) == "of"
            takes = base in lists.switching and base not in ("put", "leave", "keep")
            return not from_somewhere and (takes or word == "out" or not self.begins_noun(1))
        return not (word in lists.destinations and self.begins_noun(1) and word != "through")

    # ------------------------------------------------------------- prepositions

    def _preposition(self) -> bool:
        lists = word_lists()
        for length in (3, 2, 1):
            words = [self.word(offset) for offset in range(length)]
            phrase = " ".join(words)
            if phrase in lists.prepositions and "" not in words:
                break
        else:
            return self._stray_particle()
        if length == 1 and self._stray_particle():
            return True
        self.preposition, self.slot = phrase, False
        self.at += length
        if not self.begins_noun():
            self.preposition = ""
        elif (form := verb_forms().get(self.word())) and form.tense == "ing":
            self.slot = phrase in ("by", "after", "for", "before", "without")
        return True

    def _stray_particle(self) -> bool:
        """Read "on" in "turn the lamp on": it goes with the verb."""
        lists, word = word_lists(), self.word()
        if word not in lists.particles:
            return False
        if self.begins_noun(1) and word in lists.prepositions:
            return False
        if word == "out" and self.word(1) == "of":
            return False
        if self.verbs and " " not in self.verbs[-1].text and self._stands_alone(word):
            verb = self.verbs[-1]
            self.verbs[-1] = replace(verb, text=f"{verb.base} {word}")
        self.at += 1
        return True

    def _stands_alone(self, word: str) -> bool:
        return word not in ("in", "on", "off") or self.verbs[-1].base in word_lists().switching

    # ------------------------------------------------------------- nouns

    def _noun(self) -> bool:
        if self._pronoun():
            return True
        first = self.at
        determiner = self._determiners()
        start = self.at
        if (determiner and self.word() == "") or not self._nominal(bool(determiner)):
            return self._lone_determiner(first)
        end = self.at
        modifiers: list[str] = []
        while (more := read_tail(self, needs_place=self._needs_place())) is not None:
            if more.describes and not modifiers:
                end = self.at
            else:
                modifiers.append(self._text(more.start, self.at))
        self._add(first, start, end, determiner, tuple(modifiers))
        return True

    def _lone_determiner(self, first: int) -> bool:
        """Read a determiner without a noun: "these", "both", "the other"."""
        if self.at == first:
            return False
        self._add_pronoun(first)
        return True

    def _pronoun(self) -> bool:
        lists, word = word_lists(), self.word()
        if word not in lists.pronouns or word in lists.pronoun_heads:
            return False
        if word in lists.determiners and (self.is_content(1) or self.word(1) == "of"):
            return False
        if word == "that" and self.word(1) in lists.determiners | lists.persons:
            self.at += 1  # "make sure that the lamp is off"
            return True
        tails = ("that", "which", "you", "with", "from", "in", "on")
        if word in ("one", "ones") and self.word(1) in tails:
            return False
        self.at += 1
        self._add_pronoun(self.at - 1)
        return True

    def _add_pronoun(self, first: int) -> None:
        text, start = self._text(first, self.at), self.tokens[first].start
        end = self.tokens[self.at - 1].end
        self.pronouns.append(Pronoun(text=text, start=start, end=end))
        self.preposition, self.slot = "", self._verb_may_follow()

    def _determiners(self) -> str:
        """Read determiners, "one of the" and "a slice of" among them; return the last one."""
        lists, last = word_lists(), ""
        while True:
            word = self.word()
            if word in lists.determiners and not (
                word in lists.heads and not self.is_content(1) and self.word(1) != "of"
            ):
                last = word
                self.at += 1
            elif word == "of" and last and self.word(1):
                self.at += 1
            else:
                return last

    def _nominal(self, determined: bool) -> bool:
        """Read the words of a noun phrase up to its last content word, "of" parts included."""
        first = self.at
        if self.word(-1) in _ARTICLES and not self.is_content() and self._is_noun_here():
            self.at += 1  # "the can", "the second drawer", "the just washed mug"
        while self.is_content() or (self.at > first and self._of_part()):
            if self.at > first and self._ends_before(determined):
                break
            self.at += 1
        return self.at > first

    def _is_noun_here(self) -> bool:
        lists, word = word_lists(), self.word()
        return word in lists.auxiliaries | lists.conjunctions | lists.adverbs - lists.negations

    def _of_part(self) -> bool:
        """Return whether "of bread", "of the keys" follow, and step to the noun's first word."""
        if self.word() != "of":
            return False
        ahead = 1
        while self.word(ahead) in word_lists().determiners and not self.is_content(ahead):
            ahead += 1
        if not self.is_content(ahead):
            return False
        self.at += ahead
        return True

    def _ends_before(self, determined: bool) -> bool:
        """Return whether a participle or verb behind the noun is no part of it."""
        known = verb_forms().get(self.word())
        if known is None or self.word(-1) == "of" or self.word(-1) in word_lists().determiners:
            return False
        if known.tense == "past" and known.base != self.word():
            return not self.is_content(1)
        statement = known.tense in ("s", "base") and determined and self.takes_object(1)
        return statement or (known.base in ("belong", "go", "need") and known.tense != "ing")

    def _text(self, first: int, last: int) -> str:
        return " ".join(token.word for token in self.tokens[first:last])

    def _add(
        self, first: int, start: int, end: int, determiner: str, said: tuple[str, ...]
    ) -> None:
        words = [token.word for token in self.tokens[start:end]]
        if self._light_verb(words, determiner):
            return
        self.nouns.append(
            NounPhrase(
                text=" ".join(words),
                head=head_of(words),
                start=self.tokens[first].start,
                end=self.tokens[end - 1].end,
                preposition=self.preposition,
                modifiers=said,
                determiner=determiner,
            )
        )
        self.preposition, self.slot = "", self._verb_may_follow()

    def _verb_may_follow(self) -> bool:
        """Return whether a statement goes on: "the mug needs washing", "the mug cleaned"."""
        known = verb_forms().get(self.word())
        if known is None:
            return False
        commanded = known.tense == "base" and self.takes_object(1)
        return commanded or known.tense in ("s", "past") or known.base in ("belong", "go")

    def _light_verb(self, words: Sequence[str], determiner: str) -> bool:
        """Read "give the mug a quick wash" as the deed it means."""
        if determiner not in ("a", "another") or not self.verbs or self.preposition:
            return False
        known = verb_forms().get(words[-1])
        if self.verbs[-1].base not in ("give", "have", "do", "get") or known is None:
            return False
        if known.tense != "base" or len(words) > 3 or not self.nouns[self.segment :]:
            return False
        verb = self.verbs[-1]
        self.verbs[-1] = replace(verb, text=known.base, base=known.base)
        return True

    # ------------------------------------------------------------- roles

    def _needs_place(self) -> bool:
        """Return whether the verb wants a destination, and this noun is not it."""
        lists = word_lists()
        base = self.verbs[-1].base if self.verbs else ""
        return base in lists.deeds["put"] and self.preposition not in lists.destinations

    def _close_segment(self) -> None:
        """Give each noun phrase of this verb its role."""
        base = self.verbs[-1].base if self.verbs else ""
        if self.stated and not self.obliged:
            base = "see"
        self.nouns[self.segment :] = with_roles(self.nouns[self.segment :], base)
        self.segment = len(self.nouns)
