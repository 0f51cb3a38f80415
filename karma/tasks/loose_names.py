"""What loose English means: names of things, words for states, verbs (`loose_names.toml`)."""

import re
import unicodedata
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import msgspec

from karma.files import read_toml
from karma.household.pieces import base_type
from karma.household.states import canonical_state
from karma.household.types import object_type, object_types
from karma.household.uses import without_basin

NAMES = Path(__file__).parent / "loose_names.toml"
ANYTHING = "*"  # what "them" may stand for
IT = "it"  # stands for what was spoken of last
UNKNOWN = "unknown"  # group of an imperative that the table does not have


class Verbs(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Verbs that ask for the same deed."""

    words: tuple[str, ...]  # "turn on" also stands for "turn the lamp on"
    states: tuple[str, ...] = ()  # that they bring about
    places: tuple[str, ...] = ()  # types of where it is done, and of what does it
    predicates: tuple[str, ...] = ()  # of goals, likewise
    moves: bool = False  # they bring a thing to where the words say


class Names(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The whole table."""

    lead_ins: tuple[str, ...]
    destinations: tuple[str, ...]
    sources: tuple[str, ...]
    indefinites: tuple[str, ...]
    determiners: tuple[str, ...]
    joints: tuple[str, ...]
    numbers: dict[str, int]
    states: dict[str, str]
    predicates: dict[str, str]
    types: dict[str, tuple[tuple[str, ...], ...]]
    vague: dict[str, tuple[str, ...]]
    uses: dict[str, tuple[str, ...]]
    stands_for: dict[str, str]
    verbs: dict[str, Verbs]


@cache
def names() -> Names:
    """Return the table; keys of names without spaces, singular."""
    table = read_toml(NAMES, Names)
    types: dict[str, tuple[tuple[str, ...], ...]] = {
        key_of(name): ((name,),) for name in object_types()
    }
    types |= {key_of(name): tiers for name, tiers in table.types.items()}
    for kind in {kind for tiers in types.values() for tier in tiers for kind in tier}:
        object_type(kind)
    vague = {key_of(name): kinds for name, kinds in table.vague.items()}
    return msgspec.structs.replace(table, types=types, vague=vague)


# ----------------------------------------------------------------- words


def words_of(text: str) -> list[str]:
    """Return the words of a text, lower-case, without accents and possessive endings.

    >>> words_of("Sauté the Apple's  slices")
    ['saute', 'the', 'apple', 'slices']
    """
    plain = unicodedata.normalize("NFKD", text.lower()).replace("\u2019", "'")
    return re.findall(r"[a-z0-9]+", re.sub(r"'s\b|[\u0300-\u036f]", "", plain))


def key_of(name: str) -> str:
    """Return the singular of a name without spaces or case, under which tables keep it."""
    return "".join(singular(word) for word in words_of(name))


def singular(word: str) -> str:
    """Return a word in the singular, as far as its ending tells.

    >>> [singular(word) for word in ("tomatoes", "knives", "shelves", "glass", "dishes", "mugs")]
    ['tomato', 'knife', 'shelf', 'glass', 'dish', 'mug']
    """
    for ending, instead in (
        ("ives", "ife"), ("ves", "f"), ("oes", "o"), ("ches", "ch"), ("shes", "sh"), ("xes", "x"),
        ("sses", "ss"), ("ies", "y"), ("ss", "ss"), ("us", "us"), ("s", ""),
    ):  # fmt: skip
        if word.endswith(ending) and len(word) > len(ending) + 1:
            return word.removesuffix(ending) + instead
    return word


# ----------------------------------------------------------------- names and states


def tiers_of(name: str) -> tuple[tuple[str, ...], ...]:
    """Return the types that a loose name may stand for, in tiers of preference; () if unknown.

    What says which, or what it is of, is no part of a name that the table does not have as a whole.

    >>> tiers_of("two red apples"), tiers_of("cup of tea"), tiers_of("drawer_1")[0]
    ((('Apple',),), (('Cup',),), ('Drawer',))
    """
    words = re.sub(r"\d+\b", " ", " ".join(words_of(name))).split()
    heads = words[: words.index("of")] if "of" in words else words
    for part in (words, heads):
        for start in range(len(part)):
            if found := names().types.get(key_of(" ".join(part[start:]))):
                return found
    return ()


def meaning(name: str) -> frozenset[str]:
    """Return every type that a loose name may stand for: wholes for slices, sinks for basins."""
    kinds = {kind for tier in tiers_of(name) for kind in tier}
    return frozenset(kinds | {without_basin(base_type(kind)) for kind in kinds})


def is_plural(name: str) -> bool:
    """Return whether a name speaks of several: by its ending, or a number before it.

    >>> is_plural("tomatoes"), is_plural("two apple"), is_plural("glass"), is_plural("apple")
    (True, True, False, False)
    """
    words, numbers = words_of(name), names().numbers
    if any(numbers.get(word, 1) > 1 for word in words):
        return True
    return key_of(name) != "".join(words) and "".join(words) not in _single_keys()


@cache
def _single_keys() -> frozenset[str]:
    """Return names of one thing that end as several do."""
    kinds = (*object_types(), *read_toml(NAMES, Names).types)
    return frozenset("".join(words_of(name)) for name in kinds)


def state_of(word: str) -> str | None:
    """Return the state that a loose word means ("fried", "switched on"); None if it means none.

    "hot" and "cold" are meant as deeds, as nobody is asked to be quicker than things cool down.
    """
    plain = " ".join(word.lower().split())
    return canonical_state(names().states.get(plain, plain))


def number_before(name: str, text: str) -> int:
    """Return how many of a thing a text speaks of: the number before its name, else 1.

    >>> number_before("apples", "Wash two red apples and a cup"), number_before("cup", "two cups")
    (2, 2)
    >>> number_before("cup", "wash two apples and a cup")
    1
    """
    table, words = names(), words_of(text)
    wanted = set(tiers_of(name))
    for at, word in enumerate(words):
        if word not in table.numbers:
            continue
        for start in range(at + 1, min(at + 4, len(words))):
            if words[start] in table.destinations or words[start] in table.joints:
                break
            for length in (3, 2, 1):
                spoken = key_of(" ".join(words[start : start + length]))
                if wanted & set(table.types.get(spoken, ())):
                    return table.numbers[word]
    return 1


def mentioned(words: Sequence[str]) -> tuple[frozenset[str], frozenset[str], frozenset[str]]:
    """Return the types that words name, those only hinted at, and the names' keys.

    Longer names win over shorter ones.
    """
    table = names()
    named: set[str] = set()
    hinted: set[str] = set()
    keys: set[str] = set()
    start = 0
    while start < len(words):
        for length in (3, 2, 1):
            key = key_of(" ".join(words[start : start + length]))
            if key in table.types:
                named |= meaning(key)
                keys.add(key)
                break
            if key in table.vague:
                hinted |= set(table.vague[key])
                break
        start += length
    return frozenset(named), frozenset(hinted), frozenset(keys)


# ----------------------------------------------------------------- verbs


def verb_at(words: Sequence[str], start: int, *, first: bool = False) -> tuple[int, frozenset[str]]:
    """Return where the verb stands that begins at `start`, lead-ins aside, and its groups.

    A word that is also a thing's name ("light", "watch", "toast") is a verb only before a thing.
    An unknown word before an article is a verb of no known deed.

    Args:
        words: of one verb's phrase and what follows it.
        start: where lead-ins may begin.
        first: nothing stands before it, so that a name without an article can be a verb.
    """
    table = names()
    if start >= len(words):
        return start, frozenset()
    if words[start] in table.lead_ins or _is_adverb(words, start):
        at, found = verb_at(words, start + 1, first=first)
        if found:
            return at, found
    for base in _bases(words[start]):
        tail, found = _groups(base, words[start + 1 :])
        if found and (first or tail or _acts(base, words, start)):
            return start, found
    follows = words[start + 1] if start + 1 < len(words) else ""
    if follows in table.determiners and not _is_known(words[start]):
        return start, frozenset((UNKNOWN,))
    return start, frozenset()


def use_in(words: Sequence[str]) -> tuple[range, frozenset[str]]:
    """Return where "to read" stands behind "something", and the types that it may mean.

    There it tells what is wanted, and asks for nothing: what follows belongs to the verb before.

    >>> use_in("bring something nice to write with to the desk".split())[0]
    range(3, 6)
    >>> sorted(use_in("find anything to read".split())[1])
    ['Book', 'Newspaper']
    >>> use_in("take the plate to the sink".split())
    (range(0, 0), frozenset())
    """
    table = names()
    at = next((i for i, word in enumerate(words) if word in table.indefinites), len(words))
    near = [i for i in range(at + 1, min(at + 3, len(words) - 1)) if words[i] == "to"]
    if not near or words[near[0] + 1] in table.determiners or _is_name(words[near[0] + 1]):
        return range(0), frozenset()
    end = near[0] + 2
    ends = (*table.destinations, *table.sources, *table.joints)
    while end < len(words) and words[end] in ends and words[end] != "to":
        if end + 1 < len(words) and words[end + 1] not in ends:  # "on the table", "and put it ..."
            break
        end += 1
    kinds = (kind for base in _bases(words[near[0] + 1]) for kind in table.uses.get(base, ()))
    return range(near[0], end), frozenset(kinds)


def _is_name(word: str) -> bool:
    return key_of(word) in names().types


def _groups(base: str, rest: Sequence[str]) -> tuple[int, frozenset[str]]:
    """Return the groups of a verb and the words behind it that belong to it, most of them first.

    "turn on" wins over "turn" where its second word stands right behind it ("turn on the lamp"), or
    where nothing but another place or "again" follows ("turn the lamp on in the hall").
    """
    table = names()
    ends = (*table.destinations, *table.sources, *table.joints)
    near = {
        word
        for at, word in enumerate(rest)
        if at == 0 or set(rest[at + 1 :]) <= set(table.lead_ins) or rest[at + 1] in ends
    }
    found: dict[int, set[str]] = {}
    for group, tail in _verbs_by_head().get(base, ()):
        if near.issuperset(tail):
            found.setdefault(len(tail), set()).add(group)
    return (max(found), frozenset(found[max(found)])) if found else (0, frozenset())


@cache
def _verbs_by_head() -> dict[str, list[tuple[str, list[str]]]]:
    """Return the groups and further words of each verb, by its first word."""
    found: dict[str, list[tuple[str, list[str]]]] = {}
    for group, verbs in names().verbs.items():
        for head, *tail in map(str.split, verbs.words):
            found.setdefault(head, []).append((group, tail))
    return found


def _acts(base: str, words: Sequence[str], at: int) -> bool:
    """Return whether a word stands as a verb that may be a name, or as "frying" part of one."""
    table = names()
    is_name = key_of(base) in table.types or key_of(base) in table.vague
    if not is_name and base == words[at]:
        return True
    rest = words[at + 1 : at + 4]
    if not rest:
        return False
    if rest[0] in table.determiners or rest[0] in table.numbers:
        return True
    compound = key_of(" ".join((words[at], rest[0]))) in table.types
    return not compound and key_of(rest[0]) in table.types


def _bases(word: str) -> tuple[str, ...]:
    """Return a verb's possible plain forms.

    >>> _bases("putting"), _bases("slicing")
    (('putting', 'putt', 'putte', 'put'), ('slicing', 'slic', 'slice'))
    """
    stem = word.removesuffix("ing")
    if stem == word or len(stem) < 3:
        return (word,)
    doubled = (stem[:-1],) if stem[-1] == stem[-2] else ()
    return (word, stem, stem + "e", *doubled)


def _is_adverb(words: Sequence[str], at: int) -> bool:
    return words[at].endswith("ly") and len(words[at]) > 4 and at + 1 < len(words)


def _is_known(word: str) -> bool:
    """Return whether a word is a name, or one of those that join others."""
    table = names()
    joins = (
        *table.destinations, *table.sources, *table.determiners, *table.joints, *table.lead_ins,
    )  # fmt: skip
    key = key_of(word)
    known = key in table.types or key in table.vague or word in joins or word in table.numbers
    return known or word.endswith("ing")
