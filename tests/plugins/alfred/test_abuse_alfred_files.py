"""Files of ALFRED and of the authors' tasks that mean harm: damaged and hostile."""

from functools import partial

from support.abuse import all_held
from support.abuse.files import Kind, as_json, files

from karma.plugins.alfred.published_tasks import load_authors_tasks
from karma.plugins.alfred.replay.trial import read_trials


def test_hostile_files_are_refused_by_name_and_leave_nothing(tmp_path):
    kinds = [
        Kind(name="authors.json", sound=as_json([]), read=lambda path: load_authors_tasks([path])),
        Kind(
            name="trials.jsonl", sound=as_json({"id": "t"}), read=lambda path: [*read_trials(path)]
        ),
    ]
    all_held(partial(files, kinds=kinds), 56, tmp_path)
