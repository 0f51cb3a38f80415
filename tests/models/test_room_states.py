"""States of rooms: put back they give the bits that evaluating gives, and nothing is ever mixed."""

import logging
import multiprocessing
import os
import resource
import sys
import time

import numpy as np
import pytest
from support.paths import ROOT
from support.tiny import answer, answer_elsewhere, opened

from karma.contracts import Prompt
from karma.models.checks import memory
from karma.models.llama import room_states
from karma.models.llama.room_states import RoomStates, StateOptions
from karma.testing import make_planner

NANO = ROOT / "models" / "nano" / "planner.gguf"
ROOMS = [  # the last is longer than a batch for the models made here
    Prompt(
        stable=f"#areas\nnode_{n} Fridge Sink Toaster\n" * lines, changing="#task go\n#program\n"
    )
    for n, lines in enumerate((3, 4, 5, 60))
]
NOWHERE = StateOptions(memory_mb=0)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Models by family; gemma3 attends within a window, and has a cache for it."""
    folder = tmp_path_factory.mktemp("made")
    return {name: make_planner(folder / f"{name}.gguf", name) for name in ("llama3", "gemma3")}


HOW = ({}, {"kv": "f32"}, {"flash_attention": "on"})
CASES = [("nano", {}), *((name, how) for name in ("llama3", "gemma3") for how in HOW)]


@pytest.mark.parametrize(("name", "how"), CASES, ids=str)
def test_rooms_kept_and_loaded_answer_as_evaluated_ones_to_the_bit(made, tmp_path, name, how):
    path, rooms = made.get(name, NANO), ROOMS if name in made else ROOMS[:3]
    told = [answer(opened(path, **how, states=NOWHERE), room) for room in rooms]
    assert {state for state, _ in told} == {"evaluated"}
    cold = [said for _, said in told]
    assert len({bits for _, bits in cold}) == len(rooms)
    kept = opened(path, **how, states=StateOptions(folder=tmp_path))
    assert [answer(kept, room) for room in rooms] == told
    for _ in range(2):
        for room, said in zip(reversed(rooms), reversed(cold), strict=True):
            assert answer(kept, room) == ("kept", said)
    assert name not in made or len(kept._cut(ROOMS[3])[0]) > kept.gguf.n_batch
    # With flash attention llama.cpp's bits depend on the threads, loaded or not.
    threads = 1 if "flash_attention" in how else 2
    loaded = opened(path, **how, n_ctx=4000, threads=threads, states=StateOptions(folder=tmp_path))
    for source in ("loaded", "kept"):
        assert [answer(loaded, room) for room in rooms] == [(source, said) for said in cold]


def test_state_of_another_process_is_loaded_and_gives_the_same_bits(made, tmp_path):
    cold, warm = (answer_elsewhere(made["llama3"], ROOMS[0], tmp_path) for _ in range(2))
    assert (cold[0], warm[0]) == ("evaluated", "loaded")
    assert cold[1] == warm[1] == answer(opened(made["llama3"], chat=False), ROOMS[0])[1]


def test_state_of_another_model_or_other_options_is_never_used(made, tmp_path):
    states = StateOptions(folder=tmp_path)
    other = make_planner(tmp_path / "other.gguf", "llama3", 1)  # of the same shape
    said = {
        what: answer(opened(path, states=states, **options), ROOMS[0])
        for what, path, options in (
            ("one", made["llama3"], {}), ("other", other, {}),
            ("f32", made["llama3"], {"kv": "f32"}), ("batch", made["llama3"], {"n_ctx": 256}),
        )
    }  # fmt: skip
    assert {state for state, _ in said.values()} == {"evaluated"}
    assert said["one"][1] != said["other"][1]
    assert len(list(tmp_path.glob("*.kvstate"))) == 4
    assert answer(opened(other, states=states), ROOMS[0]) == ("loaded", said["other"][1])


def test_new_version_of_llama_cpp_evaluates_anew(made, tmp_path, monkeypatch):
    states = StateOptions(folder=tmp_path)
    cold = answer(opened(made["llama3"], states=states), ROOMS[0])
    monkeypatch.setattr("llama_cpp.__version__", "0.0.1")
    assert "0.0.1" in room_states.llama_build()
    assert answer(opened(made["llama3"], states=states), ROOMS[0]) == cold


@pytest.mark.parametrize("damage", ["cut", "changed", "empty", "renamed"])
def test_damaged_file_is_thrown_away_told_of_and_evaluated_anew(made, tmp_path, caplog, damage):
    states = StateOptions(folder=tmp_path)
    cold = answer(opened(made["llama3"], states=states), ROOMS[0])
    (path,) = tmp_path.glob("*.kvstate")
    data = bytearray(path.read_bytes())
    if damage == "renamed":  # the state of another room under this one's name
        answer(opened(made["llama3"], states=states), ROOMS[1])
        (foreign,) = set(tmp_path.glob("*.kvstate")) - {path}
        room = path.name.partition(".")[0]
        path.unlink()
        foreign.rename(tmp_path / f"{room}.{foreign.name.partition('.')[2]}")
    else:
        data[len(data) // 2] ^= 1
        path.write_bytes({"cut": data[:-1], "changed": data, "empty": b""}[damage])
    caplog.set_level(logging.WARNING)
    assert answer(opened(made["llama3"], states=states), ROOMS[0]) == cold
    assert "torn or changed, thrown away" in caplog.text
    assert answer(opened(made["llama3"], states=states), ROOMS[0]) == ("loaded", cold[1])


def test_state_that_llama_cpp_refuses_is_forgotten_and_evaluated_anew(made, tmp_path):
    model = opened(made["llama3"], states=StateOptions(folder=tmp_path))
    cold = answer(model, ROOMS[0])
    answer(model, ROOMS[1])
    tokens = model._cut(ROOMS[0])[0]
    model.gguf._states.forget(tokens)
    model.gguf._states.keep(tokens, np.zeros(1000, np.uint8))  # whole, and not a state
    assert answer(model, ROOMS[0]) == cold
    answer(model, ROOMS[1])
    assert answer(model, ROOMS[0]) == ("kept", cold[1])


@pytest.fixture
def full_disk(monkeypatch):
    """No file may grow beyond 4 kB; half a .pyc would end whoever imports it next."""
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4_000, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.usefixtures("full_disk")
def test_full_disk_is_told_of_once_and_fails_nothing(made, tmp_path, caplog):
    model = opened(made["llama3"], states=StateOptions(folder=tmp_path / "states"))
    said = [answer(model, room) for room in ROOMS]
    assert said == [answer(opened(made["llama3"]), room) for room in ROOMS]
    assert list((tmp_path / "states").iterdir()) == []
    assert caplog.text.count("states are not saved") == 1
    assert answer(model, ROOMS[0]) == ("kept", said[0][1])


def test_folder_that_cannot_be_made_is_told_of_and_fails_nothing(made, tmp_path, caplog):
    (tmp_path / "file").write_text("in the way")
    model = opened(made["llama3"], states=StateOptions(folder=tmp_path / "file" / "states"))
    assert answer(model, ROOMS[0])[0] == "evaluated"
    assert "states are not saved" in caplog.text


# ------------------------------------------------------------------------ budgets, without a model


def state(number, size=100_000):
    return np.full(size, number, np.uint8)


def numbers(states, count=8):
    """Which of the rooms are there, and that each is itself."""
    found = {number: states.find([number]) for number in range(count)}
    there = {number: one for number, one in found.items() if one is not None}
    assert all(np.array_equal(one[0], state(n)) for n, one in there.items())
    return list(there)


def test_memory_keeps_the_rooms_used_last_within_its_budget():
    states = RoomStates("m", StateOptions(memory_mb=1))
    for number in range(12):
        states.keep([number], state(number))
        states.find([0])
    assert numbers(states, 12) == [0, 3, 4, 5, 6, 7, 8, 9, 10, 11]
    states.keep([99], state(99, 2_000_000))  # more than all
    assert states.find([99]) is None


def test_memory_that_is_needed_elsewhere_keeps_nothing(tmp_path, monkeypatch):
    (tmp_path / "meminfo").write_text("MemAvailable: 150 kB\n")
    monkeypatch.setattr(memory, "MEMINFO", tmp_path / "meminfo")
    states = RoomStates("m", StateOptions())
    states.keep([0], state(0))
    assert states.find([0]) is None


def test_folder_keeps_the_rooms_used_last_within_its_budget_and_touches_no_other_file(tmp_path):
    options = StateOptions(folder=tmp_path, folder_mb=1, memory_mb=0)
    states = RoomStates("m", options)
    (tmp_path / "notes.txt").write_text("mine" * 1_000_000)
    left = tmp_path / ".00ff.kvstate.abcd"
    left.write_bytes(b"half")
    os.utime(left, (time.time() - 7200,) * 2)
    for number in range(12):
        states.keep([number], state(number))
        if number == 5:
            assert states.find([0])[1] == "loaded"
    assert numbers(states, 12) == [0, 3, 4, 5, 6, 7, 8, 9, 10, 11]
    assert sum(path.stat().st_size for path in tmp_path.glob("*.kvstate")) <= 1_000_000
    assert (tmp_path / "notes.txt").exists()
    assert not left.exists()
    states.keep([99], state(99, 2_000_000))  # more than all: nothing goes for it
    assert len(numbers(states, 12)) == 10


def test_models_in_one_folder_do_not_see_each_other_s_states(tmp_path):
    options = StateOptions(folder=tmp_path)
    one, other = (RoomStates(name, options) for name in ("one", "other"))
    one.keep([1, 2], state(1))
    assert other.find([1, 2]) is None
    assert one.find([1]) is None
    assert RoomStates("one", options).find([1, 2])[1] == "loaded"


def work(folder, seed):
    """Save and load at random; a state that is found must be the one."""
    states = RoomStates("m", StateOptions(folder=folder, folder_mb=1, memory_mb=0))
    generator, loaded = np.random.default_rng(seed), 0
    for number in generator.integers(0, 16, 150).tolist():
        found = states.find([number])
        if found is None:
            states.keep([number], state(number))
        else:
            assert np.array_equal(found[0], state(number))
            loaded += 1
    return loaded


def test_processes_that_share_a_folder_find_whole_states_or_none(tmp_path, caplog):
    with multiprocessing.get_context("fork").Pool(3) as pool:
        loaded = pool.starmap(work, [(tmp_path, seed) for seed in range(3)])
    assert min(loaded) > 20
    assert caplog.text == ""
    found = list(tmp_path.iterdir())
    assert {path.suffix for path in found} == {".kvstate"}
    assert len(found) <= 12  # two may have been saved while a third made room
