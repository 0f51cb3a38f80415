"""Requests to refuse and near misses, as training draws them."""

import re
from collections import Counter
from dataclasses import replace

import pytest

from karma.agent.planning.program import parse_program
from karma.agent.planning.recovery import refusal_in
from karma.plugins.rules.language.lexemes import types_called
from karma.plugins.training import refusals
from karma.plugins.training.drawing.memories import generated_rooms
from karma.plugins.training.drawing.phrases import our_book
from karma.plugins.training.packs import Data, PlannerRecipe, draw_pack
from karma.plugins.training.samples import draw_facts, situation
from karma.seeds import stream
from karma.types.planning import REFUSAL_KINDS

BOOK = our_book().part(held_out=False)
PATTERNS = (
    "talk", "ask", "tell", "errands", "deeds", "beings_asks", "harm", "nots", "kept", "off",
    "unclear", "cut_off", "nouns_only", "invented", "heeded",
)  # fmt: skip


@pytest.fixture(scope="module")
def rooms():
    return list(generated_rooms(4, 0))


@pytest.fixture(scope="module")
def drawn(rooms):
    rng = stream(0, "refused")
    return [refusals.draw_refusal(rng, rooms[n % 4], BOOK, mapped=bool(n % 2)) for n in range(800)]


def test_refused_request_has_one_line_of_its_kind_for_a_program(drawn):
    for example in drawn:
        assert example.kind == f"refuse_{refusal_in(example.program).refused.kind}"
        assert example.changing.startswith(f"#task {example.sentence}\n")
    kinds = Counter(example.kind.removeprefix("refuse_") for example in drawn)
    assert set(kinds) == set(REFUSAL_KINDS)
    assert min(kinds.values()) > 15, kinds


def test_refused_requests_hardly_repeat(drawn):
    sentences = [example.sentence for example in drawn]
    assert len(set(sentences)) > 0.95 * len(sentences)


def test_refused_request_comes_with_and_without_map_memory_and_hand(drawn):
    said = [example.stable + example.changing for example in drawn]
    for part in ("\nunknown\n", "node_1 ", "#held ", "#last "):
        assert 20 < sum(part in text for text in said) < 780, part


def test_things_and_places_that_are_not_there_mean_nothing_of_the_lexicon():
    words = (*refusals.phrases().words["things"], *refusals.phrases().words["places"])
    assert len(words) > 200
    assert not [word for word in words if types_called(word) or types_called(word.split()[-1])]


@pytest.mark.parametrize("group", PATTERNS)
def test_every_pattern_of_a_group_can_be_filled(group, rooms):
    rng = stream(1, "patterns", group)
    facts, _ = draw_facts(rng, rooms[0], mapped=True)
    scene = situation(rng, rooms[0], facts, BOOK, mapped=True)
    slots = refusals._Slots(rng, scene, request="wash the plate")
    for pattern in refusals.phrases().words[group]:
        said = slots.fill(pattern)
        assert said and not re.search(r"[(){}|]", said), (pattern, said)


@pytest.mark.parametrize(
    ("kind", "thing", "place", "impossible"),
    [
        ("slice", "Mug", "", True), ("slice", "Apple", "", False), ("hold", "Sofa", "", True),
        ("hold", "Pen", "", False), ("open", "Apple", "", True), ("open", "Fridge", "", False),
        ("switch_on", "Pillow", "", True), ("switch_on", "FloorLamp", "", False),
        ("fill", "Fork", "", True), ("fill", "Cup", "", False), ("break", "Pillow", "", True),
        ("place", "Fridge", "Mug", True), ("place", "Apple", "Fridge", False),
        ("place", "Pillow", "Toaster", True), ("heat", "Bed", "Microwave", True),
        ("heat", "Potato", "Microwave", False), ("clean", "Television", "Sink", True),
        ("slice", "BreadSliced", "", False),
    ],
)  # fmt: skip
def test_deed_is_impossible_where_the_table_of_types_does_not_allow_it(
    kind, thing, place, impossible
):
    assert refusals._cannot(kind, thing, place) is impossible


def test_near_miss_is_a_program_and_no_refusal_and_sounds_like_one(rooms):
    rng = stream(0, "near")
    drawn = [
        refusals.draw_near_miss(rng, rooms[n % 4], BOOK, mapped=bool(n % 2)) for n in range(300)
    ]
    assert all(parse_program(example.program) for example in drawn)
    sounds = re.compile(r"\bn[o']t\b|n't|\bnever|\bno\b|\?|\bhello|\bthank|nobody|nothing")
    assert sum(bool(sounds.search(one.sentence)) for one in drawn) > 120


def test_every_sentence_of_a_language_can_be_filled():
    for name, said in refusals.languages().items():
        for text in (*said.asks, *said.others):
            assert "{" not in text.format(x=said.x[0], r=said.r[0]), (name, text)


def test_share_of_refused_examples_is_that_of_the_recipe(rooms):
    data = Data(rooms=rooms, book=BOOK)
    recipe = replace(PlannerRecipe(), refused=0.3, near_misses=0.0)
    drawn = [one for n in range(60) for one in draw_pack(recipe, data, str(n))]
    share = sum(one.kind.startswith("refuse_") for one in drawn) / len(drawn)
    assert 0.2 < share < 0.4  # of about 290; a fair draw leaves this once in 5,000
    none = replace(recipe, refused=0.0)
    assert not [one for one in draw_pack(none, data, "0") if one.kind.startswith("refuse_")]
