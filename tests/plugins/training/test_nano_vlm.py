"""The vision model that ships: its files, its size, and that it reads rooms it never saw."""

import pytest

from karma import registry
from karma.models.manifest import file_paths, find_model, verify
from karma.plugins.training.vision_score import examine, score
from karma.plugins.vision.vlm import NANO
from karma.world.core import scene

pytestmark = pytest.mark.model


@pytest.fixture(scope="module")
def nano():
    return registry.load("vision_models", "nano-vlm")()


def test_its_files_are_the_manifest_s_and_small():
    entry = find_model(NANO)
    verify(entry)
    assert (entry.role, entry.format) == ("vlm", "safetensors")
    assert sum(path.stat().st_size for path in file_paths(entry)) < 30_000_000
    assert {path.suffix for path in file_paths(entry)} == {".safetensors", ".json", ".jinja"}


def test_it_is_asked_as_it_was_trained(nano):
    options = nano.options
    assert (options.profile, options.attempts, options.threads) == ("compact", 1, 1)
    processor = file_paths(find_model(NANO))[0].parent / "processor_config.json"
    assert processor.exists()


def test_it_reads_rooms_that_it_never_saw(nano):
    rooms = [scene.load(name) for name in ("kitchen_1", "kitchen_3", "living_2", "bedroom_1")]
    asked = list(examine(nano, rooms, frames=24, seed=11))
    found = score(asked, model=nano.name, seed=11)
    assert found.unanswered == 0
    assert found.accuracy > 0.78  # 0.89 over 320 frames; these are 24


def test_equal_pictures_give_equal_answers(nano):
    runs = [
        [frame.objects for frame in examine(nano, [scene.load("bathroom_1")], frames=2, seed=1)]
        for _ in range(2)
    ]
    assert runs[0] == runs[1]
