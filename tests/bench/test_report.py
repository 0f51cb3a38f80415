"""Runs as pages: what they say, that they replay, and that they are closed."""

import base64
import gzip
import hashlib
import html
import re
import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser
from itertools import pairwise

import pytest
from support.made_records import plain
from support.paths import ROOT
from support.report_run import AGENT, EVIL, EXPERT, KEYS, POURED, SEQUENCE_KEYS, make_run
from support.run_files import karma

from karma.bench.figures.results import result_of
from karma.bench.figures.tables import sheets
from karma.bench.report.page import render
from karma.bench.report.replay import choose, episode_key, replay, replays
from karma.journal.entries import Action, Ended, Enter, Instruction
from karma.journal.records import EpisodeRecord, EpisodeTiming
from karma.journal.run_folder import Finished, RunFolder, read_run
from karma.journal.steps import (
    packed,
    read_steps,
    steps_path,
)
from karma.world.core import scene as scenes


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return make_run(tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="module")
def run(folder):
    return read_run(folder)


@pytest.fixture(scope="module")
def shown(run):
    return list(replays(run, run.records))


@pytest.fixture(scope="module")
def page(run, shown):
    return render(run, result_of(run, {}), shown)


class Text(HTMLParser):
    """The texts of a page, and its elements with their attributes."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.said, self._style = [], [], False
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        self._style = tag == "style"

    def handle_endtag(self, tag):
        self._style = False

    def handle_data(self, data):
        if not self._style:
            self.said.append(data)

    @property
    def words(self):
        return " ".join("".join(self.said).split())


# ----------------------------------------------------------------- the replay


def test_every_episode_replays_as_logged(run, shown):
    assert [episode_key(one.record) for one in shown] == [episode_key(one) for one in run.records]
    for one in shown:
        assert one.actions > 20
        assert one.differing == ()


def test_replay_has_the_instructions_attempts_and_calls_of_the_record(shown):
    for one in shown:
        for part, sub in zip(one.instructions, one.record.subtasks, strict=False):
            assert part.instruction == sub.instruction
            calls = [call for attempt in part.attempts for call in attempt.calls]
            assert [call.text for call in calls] == [call.text for call in sub.calls]
            programs = [a.plan.program for a in part.attempts if a.plan is not None]
            assert programs == [answer.program for answer in sub.answers]
            assert part.unmet == sub.unmet


def test_memory_after_an_instruction_is_that_before_the_next(shown):
    parts = shown[0].instructions
    assert parts[0].before == ()
    assert all(a.after == b.before for a, b in pairwise(parts))


def test_replay_says_which_action_did_not_go_as_logged(run):
    lines = list(read_steps(steps_path(run.folder, EXPERT, "t1", 0)))
    actions = [n for n, line in enumerate(lines) if isinstance(line, Action)]
    at = next(n for n in actions if lines[n].action == "OpenObject")
    line = lines[at]
    lines[at] = Action(action=line.action, arguments=line.arguments, ok=False, error="")
    found = replay(lines, run.records[0], run.folder)
    assert found.differing == (actions.index(at),)


def test_log_that_breaks_off_is_replayed_as_far_as_it_goes(run):
    lines = [
        Enter(scene="kitchen_1"),
        Instruction(number=0, instruction="a"),
        Ended(finished=True, resident=(), kept=(), unmet=()),
        Instruction(number=1, instruction="b"),
        Action(action="Pass", arguments={}, ok=True, error=""),
    ]
    found = replay(lines, run.records[0], run.folder)
    assert [part.after is None for part in found.instructions] == [False, True]
    assert found.actions == 1


def test_replay_goes_through_the_rooms_of_a_sequence(tmp_path):
    made = read_run(make_run(tmp_path / "run", SEQUENCE_KEYS))
    for one in replays(made, made.records):
        assert one.differing == ()
        assert {part.scene for part in one.instructions} == {"kitchen_1", "bedroom_1"}


def test_replay_takes_the_scene_that_a_run_brought_along(run, tmp_path):
    record = next(one for one in run.records if one.key == (EXPERT, "t1", 0))
    log = gzip.decompress(steps_path(run.folder, *record.key).read_bytes())
    for data, place in (
        (scenes.find("kitchen_1").read_bytes(), tmp_path / "scenes" / "FloorPlan999.json"),
        (packed(log.replace(b"kitchen_1", b"FloorPlan999")), steps_path(tmp_path, *record.key)),
    ):
        place.parent.mkdir(parents=True)
        place.write_bytes(data)
    (one,) = replays(replace(run, folder=tmp_path), [record])
    assert one.actions > 20
    assert one.differing == ()


# ----------------------------------------------------------------- the choice of episodes


RECORDS = [
    plain(True, row="a", task="t1"), plain(False, row="a", task="t2"),
    plain(False, row="a", task="t3"), plain(True, row="b", task="t1"),
    plain(True, row="b", task="t2"), plain(False, row="b", task="t3"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("wanted", "keys"),
    [
        ("all", ["a1", "a2", "a3", "b1", "b2", "b3"]),
        ("0", []),
        ("2", ["a2", "b3"]),
        ("3", ["a2", "a3", "b3"]),
        ("5", ["a1", "a2", "a3", "b1", "b3"]),
        ("99", ["a1", "a2", "a3", "b1", "b2", "b3"]),
        ("t2", ["a2", "b2"]),
        ("b/t2/0", ["b2"]),
    ],
)
def test_choice_takes_failures_first_from_the_methods_in_turn(wanted, keys):
    assert [one.row + one.task[1:] for one in choose(RECORDS, wanted)] == keys


# ----------------------------------------------------------------- the page


def test_page_is_the_same_each_time(run, shown, page):
    assert render(run, result_of(run, {}), shown) == page


def test_page_escapes_whatever_the_model_or_a_task_says(page):
    parsed = Text(page)
    assert not any("onerror" in attrs for _, attrs in parsed.tags)
    assert "script" not in {tag for tag, _ in parsed.tags}
    for words in (EVIL, AGENT, POURED, "small <i>run</i>"):
        assert words in parsed.words


def test_page_allows_its_own_style_only_and_names_no_other_place(page):
    policy = html.unescape(re.search(r'Content-Security-Policy" content="([^"]*)"', page)[1])
    (style,) = re.findall(r"<style>(.*?)</style>", page, re.S)
    wanted = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    assert policy.startswith("default-src 'none'; img-src data:;")
    assert f"style-src 'sha256-{wanted}'" in policy
    assert "script-src" not in policy
    places = [
        attrs[name]
        for _, attrs in Text(page).tags
        for name in ("src", "href", "action", "data", "poster", "srcset", "xlink:href")
        if attrs.get(name)
    ]
    assert [place for place in places if not place.startswith(("#", "data:"))] == []
    assert re.findall(r"url\(|@import", page) == []


def test_page_says_what_was_asked_written_and_done(run, page):
    words = Text(page).words
    for one in run.records:
        for part in one.subtasks:
            assert " ".join(part.instruction.split()) in words
            assert all(call.text in words for call in part.calls)
            assert all(" ".join(a.program.split()) in words for a in part.answers)
    assert "Unmet: HOLDON(robot, Mug): 1" in words
    assert "the script has run out" in words
    assert re.search(r"4 replayed: (\d+) of \1 actions went as logged", words)


def test_page_has_the_tables_of_karma_table(run, page):
    words = Text(page).words
    result = result_of(run, {})
    for sheet in sheets(result):
        assert sheet.title in words
        for line in sheet.lines:
            assert " ".join("".join(line).split()) in words
    (first,) = (one for one in result.failures if one.is_first)
    assert first.why in words


def test_page_of_a_replay_that_left_the_log_says_so(run, shown):
    words = Text(render(run, result_of(run, {}), [replace(shown[0], differing=(5,))])).words
    assert "actions did not go as logged, the first is number 6" in words


def test_episode_that_ended_before_it_began_is_in_the_tables_only(tmp_path):
    folder = make_run(tmp_path / "run", KEYS[:1])
    record = EpisodeRecord(
        row=EXPERT, task="t1", kind="simple", scene="kitchen_1", seed=0, notes=(), subtasks=(),
        error="RequestRefused: too long",
    )  # fmt: skip
    timing = EpisodeTiming(row=EXPERT, task="t1", seed=0, subtasks=())
    (folder / "results.json").unlink()  # the run resumes
    RunFolder(folder, steps=True).commit(Finished(record=record, timing=timing))
    said = karma("report", folder, "--episodes", "all")
    assert "1 of 2 episodes" in " ".join(said.split())
    assert "RequestRefused" in (folder / "report.html").read_text()


# ----------------------------------------------------------------- the command


def test_command_writes_the_page(folder, tmp_path):
    out = tmp_path / "a.html"
    done = karma("report", folder, "--out", out, "--episodes", "1")
    assert "1 of 4 episodes" in " ".join(done.split())
    words = Text(out.read_text(encoding="utf-8")).words
    assert f"First failure that was replayed: {AGENT}/t2/0" in words


def test_command_refuses_episodes_that_it_does_not_know(folder, tmp_path):
    out = tmp_path / "a.html"
    done = karma("report", folder, "--out", out, "--episodes", "t9", code=1)
    assert "To fix: all, a number, ROW/TASK/SEED, or one of t1, t2" in done
    assert not out.exists()


def test_command_names_a_folder_without_a_run(tmp_path):
    assert "karma eval" in karma("report", tmp_path, code=1)


def test_command_draws_a_figure_of_the_policy_laboratory(tmp_path):
    from karma.bench.policies.figure import figure_run

    (tmp_path / "fig.toml").write_text(
        'kind = "trace"\nname = "Fig. <4>"\nclaims = ["split"]\n'
        'policies = ["fifo-merge[10]", "wtinylfu-karma[1,9]", "wtinylfu-karma[9,1]"]\n'
        'workloads = ["type"]\nunit_sets = ["r4"]\nsequences = 2\nlength = 20\n'
    )
    for _ in figure_run(tmp_path / "fig.toml", tmp_path / "run").episodes():
        pass
    karma("report", tmp_path / "run")
    page = (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    assert "<h1>Fig. &lt;4&gt;</h1>" in page
    assert page.count("data:image/svg+xml;base64,") == 1
    assert "belady[10]" in page
    assert "Holds in" in page


def test_page_does_not_depend_on_the_hash_seed(folder, tmp_path):
    pages = []
    for seed in ("0", "4242"):
        out = tmp_path / f"{seed}.html"
        code = "from karma.cli import app; app()"
        command = [sys.executable, "-c", code, "report", str(folder), "--out", str(out)]
        subprocess.run(
            [*command, "--episodes", "1"], check=True, capture_output=True,
            env={"PYTHONHASHSEED": seed, "PATH": ""}, cwd=ROOT,
        )  # fmt: skip
        pages.append(out.read_bytes())
    assert pages[0] == pages[1]
