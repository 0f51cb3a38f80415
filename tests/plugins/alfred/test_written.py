"""The sentences that were written by hand: each is as it says, and none is a test's."""

import os
from collections import Counter

import numpy as np
import pytest
from support.paths import ROOT

from karma.bench.engine.episode import run_episode
from karma.bench.methods.expert import ExpertMethod
from karma.files import to_json
from karma.goals.files import load_said, load_tasks, load_texts
from karma.loading.planner_files import examples_for, kept_vectors
from karma.models.embed.minilm import MiniLm
from karma.plugins.alfred.sentences import plain
from karma.types.planning import REFUSAL_KINDS
from karma.world.sim import EmbeddedWorld

WRITTEN = ROOT / "eval" / "requests" / "written.jsonl"
SAID = load_said(WRITTEN)
EVERY = 1 if os.environ.get("KARMA_SAMPLE") else 25  # of the sentences
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
def test_the_expert_does_what_it_is_said_to_mean(said, tmp_path):
    asked = {"instruction": said.text, "goals": said.goals}
    line = {"id": said.id, "kind": "simple", "scene": said.scene, "subtasks": [asked]}
    path = tmp_path / "task.jsonl"
    path.write_bytes(to_json(line))
    (task,) = load_tasks(path)
    record = run_episode(
        ExpertMethod(), EmbeddedWorld(), task, row="expert", seed=0, folder=tmp_path / "run"
    )
    assert not record.error
    assert not [sub.unmet for sub in record.subtasks if sub.unmet]


def test_the_nearest_examples_come_last():
    found = examples_for(3)("put the apple into the fridge")
    assert len(found) == 3
    assert "Apple" in found[-1].program and "Fridge" in found[-1].program
    assert examples_for(0) is None


def test_vectors_of_a_bank_are_computed_once_and_damage_is_seen(monkeypatch, tmp_path):
    monkeypatch.setenv("KARMA_CACHE", str(tmp_path))
    texts, computed = ["wash the mug", "open the box"], []
    embedder = MiniLm()
    embed = embedder.embed

    def counted(asked):
        computed.append(len(asked))
        return embed(asked)

    monkeypatch.setattr(embedder, "embed", counted)
    first = kept_vectors(embedder, texts)
    assert np.array_equal(kept_vectors(embedder, texts), first)
    assert computed == [2]
    (kept,) = (tmp_path / "vectors").iterdir()
    whole = kept.read_bytes()
    for damaged in (whole[:-4], bytes([whole[0] ^ 1]) + whole[1:], whole[:-1] + b"\0", b""):
        kept.write_bytes(damaged)
        assert np.array_equal(kept_vectors(embedder, texts), first)
        assert kept.read_bytes() == whole
    assert computed == [2] * 5
    assert len(kept_vectors(embedder, [*texts, "go"])) == 3  # other sentences, another file


def test_vectors_are_computed_where_nothing_can_be_kept(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("KARMA_CACHE", str(tmp_path / "file"))
    assert kept_vectors(MiniLm(), ["wash the mug"]).shape == (1, 384)
