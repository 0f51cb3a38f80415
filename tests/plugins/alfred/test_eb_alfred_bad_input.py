"""What is wrong with answers, tasks or servers is counted or named, and ends no run."""

import json
import re

import pytest
from support.eb_alfred import hosted, run_files
from support.hosted_server import chat, plant_key, wire_server

from karma.bench.engine.run import Run
from karma.plugins.alfred.suites.players import KEPT

ROWS = ('name = "hosted"', 'name = "hosted, strict"\nstrict = true')
MEGABYTES = 2_000_000
TASKS = {
    "base": [
        ("ours_1", "out of range"), ("ours_1", "partly out of range"), ("ours_1", "no JSON"),
        ("ours_1", "2 MB"), ("ours_1", "500 actions"), ("ours_1", "a thing that is gone"),
        ("ours_1", "not there"), ("ours_1", "refused by the server"),
        ("ours_1", "half a character"),
        ("ours_1", "nested for ever"),
    ]
}  # fmt: skip
CUT = ("find a Apple", "slice the Apple", "slice the Apple", "find a Apple")  # the whole is gone


def answer(path, body, headers):
    prompt = "\n".join(message["content"] for message in body["messages"])
    numbers = dict(reversed(one) for one in re.findall(r"^(\d+): (.+)$", prompt, re.MULTILINE))
    task = re.search(r"## Instruction\n(.+)", prompt)[1]
    if task == "refused by the server":
        return 400, {}, b'{"error": {"message": "no such thing"}}'

    def plan(*ids):
        return json.dumps({"executable_plan": [{"action_id": one} for one in ids]})

    begun = "## Done so far" in prompt
    said = {
        "out of range": plan(9999, 0),
        "partly out of range": plan() if begun else plan(int(numbers["find a Fridge"]), 9999, 1),
        "no JSON": "I would rather open the fridge.",
        "2 MB": "x" * MEGABYTES,
        "500 actions": plan(*[int(numbers["find a Fridge"])] * 500),
        "a thing that is gone": plan() if begun else plan(*(int(numbers[one]) for one in CUT)),
        "not there": plan() if begun else plan(int(numbers["find a Pen"]), 0),
        "half a character": '{"executable_plan": "\\ud800"}',
        "nested for ever": '{"executable_plan": [' * 30_000,
    }[task]
    return chat(said)


@pytest.fixture(scope="module")
def keep():
    return {}


@pytest.mark.parametrize("workers", [1, 3])
def test_everything_that_is_wrong_is_counted_or_named_and_the_run_goes_on(
    experiment, tmp_path, monkeypatch, keep, workers
):
    plant_key(monkeypatch)
    with wire_server(answer) as (url, _):
        path = experiment(hosted(url, *ROWS), tasks=TASKS)
        records = list(Run(path, tmp_path / "a").episodes(workers))
    assert keep.setdefault("files", run_files(tmp_path / "a")) == run_files(tmp_path / "a")
    assert len(records) == 2 * len(TASKS["base"])
    found = {(one.row, one.instruction): one for one in records}
    for row in ("hosted", "hosted, strict"):
        mine = {task: found[row, task] for _, task in TASKS["base"]}
        ends = {task: (one.end, one.invalid, len(one.steps)) for task, one in mine.items()}
        never = ("invalid actions", 10, 0)
        assert ends == {
            "out of range": never,
            "partly out of range": ("empty plan", 0, 1),
            "no JSON": never,
            "2 MB": never,
            "500 actions": ("steps", 0, 30),
            "a thing that is gone": ("empty plan", 1, len(CUT) - 1),
            "not there": ("empty plan", 1, 1),
            "refused by the server": ("error", 0, 0),
            "half a character": never,
            "nested for ever": never,
        }
        assert not any(one.success for one in mine.values())
        assert {task for task, one in mine.items() if one.no_json} == {
            "no JSON", "2 MB", "half a character", "nested for ever"
        }  # fmt: skip
        assert "there is no action 9999" in mine["out of range"].answers[0].error
        assert {(len(a.text), a.characters) for a in mine["2 MB"].answers} == {(KEPT, MEGABYTES)}
        assert "no such thing" in mine["refused by the server"].error
        assert mine["not there"].steps[0].feedback.startswith("Invalid: no Pen was found")
    lines = keep["files"]["episodes.jsonl"].splitlines()
    assert max(map(len, lines)) < 12 * KEPT  # ten answers of the longest that is kept
