"""The sets of requests: locked by hash, and readable."""

from collections import Counter
from hashlib import sha256
from pathlib import Path

import pytest
from support.asked import load_several

from karma.errors import FileError
from karma.goals.files import load_said
from karma.world.core import scene

SETS = Path("eval/requests")
# Written before training began. Whoever changes a row has a new set, which nothing was measured on.
HASHES = {
    "refuse.jsonl": "cd6ea7e63b0c5107391313469977f1c32255d343e161c64c061c537f0d58c488",
    "do.jsonl": "99c58429767d7f590fa99a90bb09eaa548ccb7ebf3c5a2c793af3cb285dbe3de",
    "several.jsonl": "f07bd30367369a4ed4a0b031021735d58d9a01e27402d0c87e434c3985fdfefb",
}


@pytest.mark.parametrize("name", HASHES)
def test_requests_are_as_they_were_written(name):
    assert sha256((SETS / name).read_bytes()).hexdigest() == HASHES[name]


def test_requests_are_two_hundred_of_each_and_said_in_rooms_that_exist():
    refuse, do = load_said(SETS / "refuse.jsonl"), load_said(SETS / "do.jsonl")
    several = load_several(SETS / "several.jsonl")
    assert len(refuse) == len(do) == len(several) == 200
    assert not any(one.goals for one in refuse)
    assert all(one.goals for one in do)
    for room in {one.scene for one in (*refuse, *do, *several)}:
        scene.find(room)
    texts = Counter(one.text for one in (*refuse, *do, *several))
    assert max(texts.values()) == 1


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (
            '{"id": "a", "kind": "x", "scene": "kitchen_1", "text": "t", "goals": ["FLY(Mug)"]}',
            "FLY",
        ),
        ('{"id": "a", "kind": "x", "scene": "kitchen_1", "words": "t"}', "words"),
        ('{"id": "a", "kind": "x", "scene": "k", "text": "t"}\n' * 2, "twice"),
    ],
)
def test_requests_that_cannot_be_read_are_refused_by_line(tmp_path, line, reason):
    file = tmp_path / "requests.jsonl"
    file.write_text(line)
    with pytest.raises(FileError, match=reason):
        load_said(file)
