"""The sentences that were written by hand: each is as it says, and none is a test's."""

import os
import runpy
from collections import Counter

import pytest
from support.paths import ROOT

from karma.contracts import REFUSAL_KINDS
from karma.errors import FileError
from karma.loading.examples import bank_file, examples_for, read_bank
from karma.tasks.demonstrations import plain
from karma.tasks.files import load_tasks
from karma.tasks.requests import load_said, load_texts

WRITTEN = ROOT / "eval" / "requests" / "written.jsonl"
SAID = load_said(WRITTEN)
EVERY = 1 if os.environ.get("KARMA_SAMPLE") else 25
TESTS = ("do", "refuse", "several", "asked_open", "asked_locked")


def test_there_are_enough_and_no_two_are_alike():
    assert len(SAID) >= 800
    assert not [text for text, count in Counter(plain(one.text) for one in SAID).items()
                if text and count > 1]  # fmt: skip
    assert {one.kind for one in SAID if not one.goals} <= set(REFUSAL_KINDS)


def test_none_stands_in_a_test():
    told = {plain(text) for name in TESTS
            for text in load_texts(ROOT / "eval" / "requests" / f"{name}.jsonl")}  # fmt: skip
    for folder in ("alfred_l", "locked"):
        for task in load_tasks(ROOT / "eval" / folder / "tasks.jsonl"):
            told |= {plain(sub.instruction) for sub in task.subtasks}
    same = sorted({plain(one.text) for one in SAID} & (told - {""}))
    assert len(same) <= ALIKE, same


ALIKE = 0  # sentences so short that anybody says them: those are not drawn for training


@pytest.mark.parametrize("said", [one for one in SAID if one.goals][::EVERY], ids=lambda s: s.id)
def test_the_expert_does_what_it_is_said_to_mean(said):
    is_done = runpy.run_path(str(ROOT / "scripts" / "check_written.py"))["is_done"]
    assert is_done(said, said.scene)


def test_the_nearest_examples_come_last():
    found = examples_for(3)("put the apple into the fridge")
    assert len(found) == 3
    assert "Apple" in found[-1].program and "Fridge" in found[-1].program
    assert examples_for(0) is None


def test_a_lab_may_give_its_own(tmp_path):
    own = tmp_path / "own.jsonl"
    line = WRITTEN.read_text().splitlines()[0]
    own.write_text(line + "\n")
    (only,) = examples_for(4, str(own))("anything")
    assert only.instruction in line
    own.write_text("")
    with pytest.raises(FileError, match="no sentence with goals"):
        examples_for(4, str(own))
    assert bank_file() == WRITTEN


def test_alfreds_sentences_may_be_the_bank(shared):
    bank = list(read_bank(shared / "data" / "alfred" / "valid_seen.jsonl.gz"))
    assert len(bank) > 500
    assert all(one.program.startswith(("GoToObject", "Explore")) for one in bank)
