"""What things are called: against the type table, and words that fit several types."""

import re
from dataclasses import replace
from functools import cache

import pytest

from karma.agent.planning.prompt import compact
from karma.household.types import types_with
from karma.plugins.rules.language.lexemes import (
    Lexemes,
    every_word,
    lexicon,
    pick_common,
    plain_words,
    types_called,
)
from karma.plugins.training.drawing.memories import room_of
from karma.plugins.training.drawing.phrases import our_book
from karma.plugins.training.drawing.referring_expressions import Situation, call
from karma.plugins.training.drawing.requests import one_ask
from karma.seeds import stream
from karma.types.planning import PlanRequest
from karma.world.core import scene

WORDS = every_word()
CARRIED = sorted(types_with("pickupable") & WORDS.keys())
BOOK = our_book()


@pytest.mark.parametrize("kind", CARRIED)
def test_what_can_be_carried_has_many_names_kinds_and_uses(kind):
    entry = WORDS[kind]
    assert len(entry.names) >= 13
    assert len(entry.kinds) >= 15
    assert len(entry.uses) >= 3


@pytest.mark.parametrize("kind", WORDS)
def test_words_of_a_type_stand_once_in_one_form(kind):
    entry = WORDS[kind]
    assert len(set(entry.words)) == len(entry.words)
    for word in entry.words:
        assert re.fullmatch(r"[a-zéè0-9][a-zéèâ0-9'.& -]*", word), word
        assert "  " not in word
    assert not [use for use in entry.uses if use.startswith(("to ", "thing ", "something "))]


@pytest.mark.parametrize("kind", WORDS)
def test_training_knows_a_name_of_every_type(kind):
    assert lexicon()[kind].names


def test_types_called_are_those_that_have_the_word():
    for word in ("beaker", "workstation", "drink from", "thing to drink from", "utensil", "loo"):
        assert types_called(word) == tuple(k for k, entry in WORDS.items() if word in entry.words)
    assert types_called("beaker") == ("Mug", "Cup")  # one word, two types
    assert types_called("no such word") == ()


def test_common_words_come_oftener():
    words = tuple(map(str, range(20)))
    drawn = [pick_common(stream(0, str(n)), words) for n in range(2000)]
    assert set(drawn) == set(words)
    assert 0.15 < drawn.count("0") / 2000 < 0.3
    assert drawn.count("0") > drawn.count("1") > drawn.count("10")


# ----------------------------------------------------------------- lexemes in texts


def test_lexemes_are_found_as_words_in_a_row_plurals_and_hyphens_apart():
    finder = Lexemes(["wine glass", "glass", "write with"])
    assert finder.found_in("Two Wine-Glasses, please") == ("wine glass", "glass")
    assert finder.number_in("Two Wine-Glasses and a glass") == 2
    assert finder.found_in("something to write it with") == ()
    assert finder.found_in("fibreglass") == ()
    assert plain_words("Étagère, x_1") == ("étagère", "x", "1")


# ----------------------------------------------------------------- words in requests


@cache
def known(name):
    return room_of(scene.load(name), name)


def situation(name="kitchen_1", **changes):
    room = known(name)
    facts = PlanRequest(instruction="", areas=room.areas, units=())
    return Situation(
        room=room, facts=facts, names=dict(compact(facts).names), book=replace(BOOK, **changes),
        mapped=True,
    )  # fmt: skip


@pytest.mark.parametrize("vague", [0.0, 1.0])
@pytest.mark.parametrize("kind", CARRIED)
def test_what_memory_does_not_hold_is_called_by_words_of_its_type_alone(kind, vague):
    found = situation(vague=vague)
    for number in range(20):
        ref = call(stream(0, kind, str(number)), found, kind)
        said = said_word(ref.bare, WORDS[kind].uses if vague else ())
        assert types_called(said) == (kind,)
        assert ref.plain == (said in WORDS[kind].names)


def said_word(text, uses):
    return next((use for use in sorted(uses, key=len, reverse=True) if text.endswith(use)), text)


@pytest.mark.parametrize("room", ["kitchen_1", "living_1", "bedroom_1", "bathroom_1"])
def test_vague_words_stand_for_a_place_only_where_nothing_else_in_the_room_fits(room):
    bare = {kind: ("{s0}",) for kind in ("open", "close", "switch_on", "switch_off")}
    shown = {kind: ("{s}",) for kind in bare}
    found = situation(room, vague=1.0, templates=shown, spoken={}, verbs={})
    here = found.room.landmarks
    told = 0
    for number in range(300):
        ask = one_ask(stream(0, room, str(number)), found, ("open", "switch_on")[number % 2])
        if ask is None or ask.goals[0].arguments[0] not in here:
            continue
        place = ask.goals[0].arguments[0]
        text = ask.text.removeprefix("the ")
        word = said_word(text, WORDS[place].uses)
        if word not in (*WORDS[place].kinds, *WORDS[place].uses):
            continue  # a longer use of another place ends alike
        told += 1
        assert not [rival for rival in here if rival != place and word in WORDS[rival].words]
    assert told > 50


def test_somewhere_cold_takes_no_article():
    shown = {"open": ("{s}",)}
    found = situation(vague=1.0, templates=shown, spoken={}, verbs={})
    asks = [one_ask(stream(0, str(n)), found, "open") for n in range(800)]
    said = {ask.text for ask in asks if ask is not None}
    assert {text for text in said if "somewhere" in text}
    assert not {text for text in said if re.search(r"\b(the|a|that) (some|what|where)", text)}
