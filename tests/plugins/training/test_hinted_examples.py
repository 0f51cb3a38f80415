"""Hints of drawn requests: what share has them, and what they say."""

import numpy as np
import pytest

from karma.plugins.rules.wording.hints import WordFile, Words
from karma.plugins.training.hinted import INVENTED, UNKNOWN, DrawnHints
from karma.plugins.training.samples import TrainingExample
from karma.seeds import stream
from karma.types.planning import PlanRequest

FILE = WordFile(
    types={"Cup": ("glass", "beaker"), "Mug": ("mug", "tea mug"), "Pen": ("pen",)},
    deeds={"put": ("put",), "wash": ("wash",)},
    phrases=frozenset(("glass", "mug", "pen", "put")),
    words=frozenset(("put", "mug")),
)
ROWS = np.eye(7, dtype=np.float32)[[0, 0, 1, 1, 2, 3, 4]]  # a direction per type or deed
DRAWN = DrawnHints(
    words=Words(FILE, ROWS),
    vectors={"glass": ROWS[0], "mug": ROWS[2], "jar": ROWS[0], "put": ROWS[5]},
    names=frozenset(("glass", "mug")),
)


def told(text, seed):
    sentence, hints = DRAWN.hinted(stream(seed, "test"), text)
    return PlanRequest(instruction=sentence, hints=hints)


def test_hints_of_an_example_stand_behind_its_task():
    example = TrainingExample(
        kind="place", stable="#areas\n", changing="#task put the jar there\n#memory\n", program="x"
    )
    found = DRAWN.told(stream(0, "test"), example)
    assert found.changing == "#task put the jar there\n#words jar: Cup 9 Mug 0 Pen 0\n#memory\n"
    assert (found.stable, found.program) == (example.stable, example.program)


def test_unknown_phrase_with_a_vector_always_has_its_hint():
    for seed in range(50):
        (hint, *_) = told("put the jar there", seed).hints
        assert (hint.phrase, hint.meanings[0].name) == ("jar", "Cup")


def test_unknown_phrase_without_a_vector_has_no_hint():
    assert all(
        hint.phrase != "gizmo" for seed in range(50) for hint in told("put the gizmo", seed).hints
    )


def test_known_phrases_are_hinted_in_the_share_of_requests_that_is_said():
    drawn = [told("put the mug on it", seed) for seed in range(2000)]
    hinted = sum(bool(one.hints) for one in drawn) / len(drawn)
    assert INVENTED < hinted < INVENTED + UNKNOWN + 0.03


def test_hint_of_a_forgotten_word_does_not_lean_on_texts_with_that_word():
    forgotten = [
        hint
        for seed in range(500)
        for hint in told("put the mug on it", seed).hints
        if hint.phrase == "mug"
    ]
    assert forgotten
    assert all(meaning.similarity < 0.5 for hint in forgotten for meaning in hint.meanings)


def test_invented_noun_stands_in_the_text_with_a_hint_that_says_what_is_meant():
    found = [told("put the mug on it", seed) for seed in range(1000)]
    found = [one for one in found if "mug" not in one.instruction]
    assert INVENTED / 2 < len(found) / 1000 < INVENTED * 2
    for one in found:
        (hint,) = one.hints
        assert one.instruction == f"put the {hint.phrase} on it"
        assert "Mug" in {meaning.name for meaning in hint.meanings}


@pytest.mark.parametrize("seed", range(3))
def test_same_seed_gives_the_same_request(seed):
    assert told("put the glass there", seed) == told("put the glass there", seed)
