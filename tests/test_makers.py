"""Models made here: what llama.cpp loads of them, a seed decides every byte; and stand-ins."""

import pytest

from karma.errors import UnknownNameError
from karma.models.checks.gguf import check_gguf
from karma.testing import FAMILIES, StubVision, make_planner
from karma.types.tasks import SubTask

SIZE = {"layers": 3, "width": 64, "heads": 4, "kv_heads": 2, "feed_forward": 96}


@pytest.mark.parametrize("family", FAMILIES)
def test_planner_of_every_family_has_its_architecture_and_same_seed_same_bytes(tmp_path, family):
    first, again, other = (
        make_planner(tmp_path / name, family, seed) for name, seed in (("a", 1), ("b", 1), ("c", 2))
    )
    assert first.read_bytes() == again.read_bytes() != other.read_bytes()
    assert check_gguf(first)["general.architecture"] == FAMILIES[family].architecture
    assert first.stat().st_size < 1_000_000


def test_unknown_family_is_refused_with_those_there_are(tmp_path):
    with pytest.raises(UnknownNameError, match=r"no model family 'gpt'; there are llama3, qwen"):
        make_planner(tmp_path / "x.gguf", "gpt")
    assert list(tmp_path.iterdir()) == []


def test_fixture_begins_an_episode_that_acts_and_remembers(karma_episode):
    program = "PickupObject(robot, 'Apple')\nPutObject(robot, 'Apple', 'CounterTop')\n"
    episode = karma_episode([program], vision=StubVision({"Apple": ("sliced",)}))
    outcome = list(episode.do(SubTask(instruction="move the apple")))[-1]
    assert outcome.finished
    assert "Apple" in {unit.object_type for unit in episode.memory.short_term.units()}
