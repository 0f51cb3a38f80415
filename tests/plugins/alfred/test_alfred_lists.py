"""Lists of ALFRED's tasks as others publish them, and what people said of demonstrations."""

import json

import pytest
from support import alfred_kitchen as ours

from karma.errors import FileError
from karma.plugins.alfred.published_tasks import read_lists
from karma.plugins.alfred.sentences import plain, sentences_in

LISTS = {
    "base": [
        {"task": "pick_x/trial_1", "repeat_idx": 2, "instruction": "Rinse it.", "other": 1},
        {"task": "pick_y/trial_2", "instruction": "Put it away."},
    ],
    "bare": [{"task": "pick_z/trial_3", "repeat_idx": 1}],
}
SAID = [
    {"task_desc": "Chill an apple.", "high_descs": ["Walk to the table", "Take the apple."]},
    {"task_desc": "Put the apple in the fridge!", "high_descs": []},
]


def lists_file(folder, text=None):
    path = folder / "lists.json"
    path.write_text(json.dumps(LISTS) if text is None else text)
    return path


def test_lists_are_read_in_the_order_of_the_names(tmp_path):
    path = lists_file(tmp_path)
    assert [task.id for task in read_lists(path)] == ["base/0", "base/1", "bare/0"]
    assert [task.id for task in read_lists(path, ["bare", "base"])] == [
        "bare/0",
        "base/0",
        "base/1",
    ]
    first, _, bare = read_lists(path)
    assert (first.folder, first.trial, first.repeat) == ("pick_x", "trial_1", 2)
    assert (first.instruction, bare.instruction, bare.repeat) == ("Rinse it.", "", 1)


@pytest.mark.parametrize(
    ("text", "names", "said"),
    [
        ("{", (), "truncated"),
        ("[]", (), "Expected `object`"),
        ('{"base": [{"repeat_idx": 1}]}', (), r"missing required field `task`.*\[0\]"),
        ('{"base": [{"task": "trial_1"}]}', (), r"'trial_1' is not folder/trial.*\$\.base\[0\]"),
        (None, ("spatial",), r"no list 'spatial'; there are \['bare', 'base'\]"),
    ],
)
def test_torn_or_wrong_lists_are_named(tmp_path, text, names, said):
    path = lists_file(tmp_path, text)
    with pytest.raises(FileError, match=said) as caught:
        read_lists(path, names)
    assert str(path) in str(caught.value)


def test_sentences_of_goals_and_steps_are_known_whatever_their_case_and_marks(tmp_path):
    path = ours.write(tmp_path / "t.jsonl.gz", {**ours.trial(), "turk_annotations": SAID})
    known = sentences_in(path)
    assert plain("put the APPLE, in the fridge") in known
    assert plain("take the apple") in known
    assert plain("take the apples") not in known
