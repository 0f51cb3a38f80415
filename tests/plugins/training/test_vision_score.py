"""Scoring a vision model: hand-counted figures, the questions, the page."""

import json
import re

import numpy as np
import pytest

from karma.models.picture_questions import STATES
from karma.plugins.training.moments import generator, moments, room, samples
from karma.plugins.training.picture_score import (
    NOTHING,
    AskedCrop,
    Clock,
    confusion,
    examine,
    held_out_rooms,
    page,
    score,
)
from karma.world.core import scene


def asked(truth, said, *, share=0.01, kind="Mug"):
    words = None if said is None else tuple(sorted(said.split(", ")))
    picture = np.full((8, 8, 3), 90, dtype=np.uint8)
    return AskedCrop(
        room="kitchen_1", frame=0, object_type=kind, share=share,
        truth=tuple(sorted(truth.split(", "))), said=words, picture=picture,
    )  # fmt: skip


ANSWERS = [
    asked("dirty, filled", "dirty, filled", share=0.05),
    asked("dirty", "cleaned", share=0.05),
    asked("cleaned", "cleaned, filled"),
    asked("none", None, kind="Fork"),
    asked("opened", "closed", kind="Fridge", share=0.3),
    asked("closed", "closed", kind="Fridge"),
]


class Knowing:
    """Says of each object what it was told; reads no metadata."""

    name, needs_pictures = "knowing", True

    def __init__(self, answer=lambda one: ("none",)):
        self.answer, self.asked = answer, []

    def read_states(self, image, instruction, objects):
        self.asked.append((image, instruction, objects))
        return {one.object_id: self.answer(one) for one in objects}


def figures(answers=ANSWERS):
    return score(answers, model="hand", seed=0, clock=Clock())


def test_words_are_counted_by_hand():
    found = figures()
    dirty, filled, closed = (found.words[word] for word in ("dirty", "filled", "closed"))
    assert (dirty.support, dirty.precision, dirty.recall) == (2, 1.0, 0.5)
    assert (filled.support, filled.precision, filled.recall) == (1, 0.5, 1.0)
    assert dirty.f1 == filled.f1 == closed.f1 == pytest.approx(2 / 3)
    assert found.words["on"].support == 0
    assert found.words["on"].f1 is None
    # dirty, filled, cleaned, closed 2/3 each; opened and none 0
    assert found.macro_f1 == pytest.approx(4 * (2 / 3) / 6)


def test_an_answer_is_right_when_all_its_words_are():
    found = figures()
    assert found.accuracy == pytest.approx(2 / 6)
    assert (found.large.right, found.large.of) == (1, 3)
    assert found.unanswered == 1
    assert (found.types["Fridge"].right, found.types["Fridge"].of) == (1, 2)
    assert found.types["Fork"].value == 0.0


def test_nothing_asked_leaves_everything_undefined():
    found = figures([])
    assert found.accuracy is found.macro_f1 is found.large.value is found.ms_per_frame is None


def test_the_matrix_pairs_opposites_and_shows_what_is_missing_or_too_much():
    matrix = confusion(ANSWERS)
    assert matrix["dirty"]["dirty"] == 1
    assert matrix["dirty"]["cleaned"] == 1
    assert matrix["opened"]["closed"] == 1
    assert matrix["none"][NOTHING] == 1
    assert matrix[NOTHING]["filled"] == 1
    assert sum(map(sum, (row.values() for row in matrix.values()))) == 8
    both = confusion([asked("cooked, dirty", "cleaned, heated")])
    assert (both["dirty"]["cleaned"], both["cooked"]["heated"]) == (1, 1)


def test_the_page_holds_figures_matrix_and_pictures_and_nothing_external():
    text = page(figures(), ANSWERS)
    assert text.count("data:image/png;base64,") == 4
    assert not re.search(r"(src|href)=\"(?!data:)|https?://|url\(", text)
    assert "no usable answer" in text
    assert text == page(figures(), ANSWERS)
    hostile = page(figures(), [asked("none", None, kind="<script>x</script>")])
    assert "<script>" not in hostile


# ------------------------------------------------------------------ the questions


def test_questions_bring_frames_names_and_regions_but_no_states():
    model, clock = Knowing(), Clock()
    rooms = [scene.load("kitchen_1"), scene.load("bathroom_1")]
    answers = list(examine(model, rooms, frames=6, seed=3, clock=clock))
    assert clock.frames == len(model.asked) == 6
    assert {one.room for one in answers} == {"kitchen_1", "bathroom_1"}
    for image, instruction, objects in model.asked:
        assert image.shape == (300, 300, 3)
        assert "Sliced" not in instruction
        assert all(one.states == () and one.region for one in objects)
    assert all((one.picture is None) == one.right for one in answers)
    assert {word for one in answers for word in one.truth} <= set(STATES)


def test_equal_arguments_ask_the_same_questions():
    rooms = [scene.load("kitchen_1")]
    runs = [list(examine(Knowing(), rooms, frames=3, seed=s, clock=Clock())) for s in (1, 1, 2)]
    assert runs[0] == runs[1] != runs[2]


def test_rooms_by_default_are_all_that_ship_and_sixteen_fresh_ones():
    rooms = held_out_rooms((), 0)
    assert len(rooms) == len(list(scene.SCENES.glob("*.json"))) + 16
    assert [one.name for one in held_out_rooms(("kitchen_1",), 0)] == ["kitchen_1"]
    assert len(held_out_rooms(("fresh",), 0)) == 16


# ------------------------------------------------------------------ moments


def test_every_state_comes_about_and_the_truth_is_the_world_s():
    seen = set()
    for number in range(4):
        for event in moments(room(5, number), generator(5, str(number)), states=2, views=8):
            for one in samples(event):
                thing = event.get_object(one.seen.object_id)
                seen.update(one.states)
                assert one.pixels >= 64
                assert ("dirty" in one.states) == thing["isDirty"]
                assert ("opened" in one.states) == (thing["isOpen"] and thing["openable"])
                assert ("heated" in one.states) == (thing["temperature"] == "Hot")
    assert seen >= set(STATES) - {"cooked", "used up"}


def test_equal_streams_give_equal_moments():
    runs = [
        [event.frame.tobytes() for event in moments(room(1, 0), generator(1), states=1, views=3)]
        for _ in range(2)
    ]
    assert runs[0] == runs[1]


def test_the_command_writes_figures_and_a_page(tmp_path):
    from support.tiny_vision import save_family
    from typer.testing import CliRunner

    from karma.cli import app

    model = save_family("llava", tmp_path / "model")
    (model / "karma.json").write_text(
        '{"profile":"compact","crop":1.4,"max_tokens":3,"attempts":1}'
    )
    done = CliRunner().invoke(
        app,
        ["vlm", "eval", "--model", str(model), "--frames", "2", "--rooms", "bathroom_1",
         "--json", str(tmp_path / "f.json"), "--html", str(tmp_path / "f.html")],
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "macro-F1" in done.output
    assert json.loads((tmp_path / "f.json").read_text())["frames"] == 2
    assert "<h1>model:" in (tmp_path / "f.html").read_text()
    wrong = CliRunner().invoke(app, ["vlm", "eval", "--model", "karma-nano-vlmm"])
    assert wrong.exit_code == 1
