"""The phrase book: every pattern can be said, and says what its kind of request needs."""

import re

import pytest

from karma.plugins.training.drawing.phrases import our_book
from karma.seeds import stream

BOOK = our_book()
SLOTS = {
    "place": "xr", "trash": "xr", "clean": "x", "clean_place": "xr", "heat": "x", "cook": "x",
    "heat_place": "xr", "cook_place": "xr", "cool": "x", "cool_place": "xr", "slice": "x",
    "slice_place": "xr", "toast": "x", "fill": "x", "coffee": "x", "switch_on": "s",
    "switch_off": "s", "open": "s", "close": "s", "hold": "x", "look": "xs", "break": "x",
    "stack": "xmr", "pair": "xr",
}  # fmt: skip
MAY_LACK = {"trash": "r", "toast": "x", "coffee": "x"}
WORDS = {
    slot: name
    for letter, name in zip("xrms", ("apple", "table", "pan", "lamp"), strict=True)
    for slot in (letter, f"{letter}0", f"{letter}2", f"{letter}s")
}


@pytest.mark.parametrize("kind", SLOTS)
def test_pattern_of_a_kind_stands_for_templates_with_the_slots_of_the_kind(kind):
    for pattern in BOOK.spoken[kind]:
        for text in BOOK.stated(pattern):
            slots = {slot[0] for slot in re.findall(r"\{(\w+)\}", text)}
            assert set(SLOTS[kind]) - set(MAY_LACK.get(kind, "")) <= slots <= set(SLOTS[kind]), text
            assert not re.search(r"[()|<>]|  | [,;.]|[{}]", text.format(**WORDS)), text


@pytest.mark.parametrize("kind", SLOTS)
def test_drawn_template_of_a_kind_is_one_that_the_book_states(kind):
    stated = {text for pattern in BOOK.spoken[kind] for text in BOOK.stated(pattern)}
    drawn = {BOOK.pick(stream(0, kind, str(n)), kind) for n in range(60)}
    assert drawn <= stated | set(BOOK.templates[kind])
    assert drawn & stated
    assert drawn & set(BOOK.templates[kind])


def test_book_without_some_verbs_never_says_them_and_one_of_them_says_no_other():
    words = {"hose", "ditch", "snatch"}
    without, only = (BOOK.with_verbs(words, held_out=side) for side in (False, True))
    for kind, verb in (("clean", "hose"), ("trash", "ditch"), ("hold", "snatch")):
        said = [without.pick(stream(0, kind, str(n)), kind) for n in range(200)]
        assert not [text for text in said if verb in text]
        assert all(verb in only.pick(stream(0, kind, str(n)), kind) for n in range(50))
