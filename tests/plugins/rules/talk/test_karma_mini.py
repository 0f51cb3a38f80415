"""The planner of who names none, where set-up could make it: a handful of plain errands."""

import os
import shutil

import pytest

from karma import Agent
from karma.models.manifest import PLANNER, PLANNERS, default_planner, manifest_path


@pytest.fixture(scope="module")
def agent(mini, tmp_path_factory):
    folder = tmp_path_factory.mktemp("mini")
    return Agent("kitchen_1", planner="karma-mini", folder=folder / "run", maps=folder / "maps")


@pytest.mark.parametrize(
    ("said", "status"),
    [
        ("put the apple in the fridge", "done"),
        ("rinse the mug for me, would you", "done"),
        ("is the fridge open?", "answered"),
        ("put the banana in the bowl", "refused"),
    ],
)
def test_what_comes_of_a_request(agent, said, status):
    assert agent.do(said).status == status


def test_the_best_planner_that_is_here_is_taken(mini, monkeypatch, tmp_path):
    monkeypatch.delenv(PLANNER)
    assert default_planner() == PLANNERS[0] == "karma-mini"
    shutil.copy(manifest_path(), tmp_path / "manifest.toml")
    monkeypatch.setenv("KARMA_MODELS", str(tmp_path))
    assert default_planner() == "karma-nano"
    monkeypatch.setenv(PLANNER, "smollm2-135m")
    assert default_planner() == "smollm2-135m"


def test_tests_plan_with_small_weights():
    assert os.environ[PLANNER] == "karma-nano"
