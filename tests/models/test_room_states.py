"""States of rooms: put back they give the bits that evaluating gives, and nothing is ever mixed."""

import numpy as np
import pytest
from support.paths import ROOT
from support.tiny import answer, opened

from karma.models.checks import memory
from karma.models.llama import room_states
from karma.models.llama.room_states import RoomStates
from karma.testing import make_planner
from karma.types.planning import Prompt

NANO = ROOT / "models" / "nano" / "planner.gguf"
ROOMS = [  # the last is longer than a batch for the models made here
    Prompt(
        stable=f"#areas\nnode_{n} Fridge Sink Toaster\n" * lines, changing="#task go\n#program\n"
    )
    for n, lines in enumerate((3, 4, 5, 60))
]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Models by family; gemma3 attends within a window, and has a cache for it."""
    folder = tmp_path_factory.mktemp("made")
    return {name: make_planner(folder / f"{name}.gguf", name) for name in ("llama3", "gemma3")}


@pytest.mark.parametrize("name", ["nano", "llama3", "gemma3"])
def test_kept_rooms_answer_as_evaluated_ones_to_the_bit(made, name):
    path, rooms = made.get(name, NANO), ROOMS if name in made else ROOMS[:3]
    evaluated = [answer(opened(path), room) for room in rooms]
    assert {state for state, _ in evaluated} == {"evaluated"}
    assert len({bits for _, (_, bits) in evaluated}) == len(rooms)
    kept = opened(path)
    assert [answer(kept, room) for room in rooms] == evaluated
    for _ in range(2):
        for room, (_, said) in zip(reversed(rooms), reversed(evaluated), strict=True):
            assert answer(kept, room) == ("kept", said)
    assert name not in made or len(kept._cut(ROOMS[3])[0]) > kept.gguf.n_batch


def test_state_that_llama_cpp_refuses_is_forgotten_and_evaluated_anew(made):
    model = opened(made["llama3"])
    cold = answer(model, ROOMS[0])
    answer(model, ROOMS[1])
    tokens = model._cut(ROOMS[0])[0]
    model.gguf._states.forget(tokens)
    model.gguf._states.keep(tokens, np.zeros(1000, np.uint8))  # whole, and not a state
    assert answer(model, ROOMS[0]) == cold
    answer(model, ROOMS[1])
    assert answer(model, ROOMS[0]) == ("kept", cold[1])


def state(number, size=100_000):
    return np.full(size, number, np.uint8)


def test_memory_keeps_the_rooms_used_last_within_its_budget(monkeypatch):
    monkeypatch.setattr(room_states, "MAX_STATES_MB", 1)
    states = RoomStates()
    for number in range(12):
        states.keep([number], state(number))
        states.find([0])
    found = {number: states.find([number]) for number in range(12)}
    kept = {number: one for number, one in found.items() if one is not None}
    assert list(kept) == [0, 3, 4, 5, 6, 7, 8, 9, 10, 11]
    assert all(np.array_equal(one, state(number)) for number, one in kept.items())
    states.keep([99], state(99, 2_000_000))  # more than all
    assert states.find([99]) is None


def test_memory_that_is_needed_elsewhere_keeps_nothing(tmp_path, monkeypatch):
    (tmp_path / "meminfo").write_text("MemAvailable: 150 kB\n")
    monkeypatch.setattr(memory, "MEMINFO", tmp_path / "meminfo")
    states = RoomStates()
    states.keep([0], state(0))
    assert states.find([0]) is None
