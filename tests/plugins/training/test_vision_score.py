"""Scoring a vision model: hand-counted figures, the questions, the command."""

import json
from dataclasses import replace

import pytest

from karma.agent.seeing.perceive import truth_of
from karma.models.picture_questions import STATES
from karma.plugins.training.moments import generator, moments, room, samples, shown_states
from karma.plugins.training.vision_score import (
    AskedFrame,
    AskedObject,
    examine,
    held_out_rooms,
    score,
)
from karma.world.core import scene
from karma.world.sim import EmbeddedWorld


def asked(truth, answer, *, share=0.01):
    words = None if answer is None else tuple(sorted(answer.split(", ")))
    return AskedObject(
        object_type="Mug", share=share, truth=tuple(sorted(truth.split(", "))), answer=words
    )


ANSWERS = (
    asked("dirty, filled", "dirty, filled", share=0.05),
    asked("dirty", "cleaned", share=0.05),
    asked("cleaned", "cleaned, filled"),
    asked("none", None),
    asked("opened", "closed", share=0.3),
    asked("closed", "closed"),
)


class Recording:
    """Answers "none" of each object, and keeps the questions."""

    name, needs_pictures = "recording", True

    def __init__(self):
        self.asked = []

    def read_states(self, image, instruction, objects):
        self.asked.append((image, instruction, objects))
        return {seen.object_id: ("none",) for seen in objects}


def test_figures_are_those_counted_by_hand():
    found = score([AskedFrame(room="kitchen_1", seconds=0.6, objects=ANSWERS)], model="m", seed=0)
    dirty, filled, closed = (found.words[word] for word in ("dirty", "filled", "closed"))
    assert (dirty.support, dirty.precision, dirty.recall) == (2, 1.0, 0.5)
    assert (filled.support, filled.precision, filled.recall) == (1, 0.5, 1.0)
    assert dirty.f1 == filled.f1 == closed.f1 == pytest.approx(2 / 3)
    assert found.words["on"].support == 0
    assert found.words["on"].f1 is None
    # dirty, filled, cleaned, closed 2/3 each; opened and none 0
    assert found.macro_f1 == pytest.approx(4 * (2 / 3) / 6)
    assert found.accuracy == pytest.approx(2 / 6)
    assert found.large_accuracy == pytest.approx(1 / 3)
    assert (found.frames, found.objects, found.unanswered) == (1, 6, 1)
    assert found.ms_per_object == pytest.approx(100)


def test_no_answers_leave_every_figure_undefined():
    found = score([], model="m", seed=0)
    assert found.accuracy is found.macro_f1 is found.large_accuracy is found.ms_per_object is None


def test_questions_bring_frames_names_and_regions_but_no_states():
    model = Recording()
    rooms = [scene.load("kitchen_1"), scene.load("bathroom_1")]
    frames = list(examine(model, rooms, frames=6, seed=3))
    assert len(model.asked) == len(frames) == 6
    assert {frame.room for frame in frames} == {"kitchen_1", "bathroom_1"}
    for image, instruction, objects in model.asked:
        assert image.shape == (300, 300, 3)
        assert "Sliced" not in instruction
        assert all(seen.states == () and seen.region for seen in objects)
    assert {word for f in frames for asked in f.objects for word in asked.truth} <= set(STATES)


def test_equal_arguments_ask_the_same_questions():
    rooms = [scene.load("kitchen_1")]
    runs = [
        [frame.objects for frame in examine(Recording(), rooms, frames=3, seed=seed)]
        for seed in (1, 1, 2)
    ]
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


def test_the_command_writes_figures(tmp_path):
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
         "--json", str(tmp_path / "f.json")],
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "macro-F1" in done.output
    assert json.loads((tmp_path / "f.json").read_text())["frames"] == 2
    wrong = CliRunner().invoke(app, ["vlm", "eval", "--model", "karma-nano-vlmm"])
    assert wrong.exit_code == 1


@pytest.mark.parametrize(
    ("states", "dirtyable", "words"),
    [
        ((), False, ("none",)),
        ((), True, ("cleaned",)),
        (("dirty", "filled"), True, ("dirty", "filled")),
        (("closed", "on"), False, ("closed", "on")),
        (("cooked", "heated"), True, ("cleaned", "cooked", "heated")),
    ],
)
def test_what_a_picture_can_tell(states, dirtyable, words):
    thing = truth_of(EmbeddedWorld("kitchen_1").last_event).objects[0]
    assert shown_states(replace(thing, states=states, dirtyable=dirtyable)) == words
