"""Reports of sequences: several rooms, many instructions, and what of them a page shows.

The browser's tests need Chromium, and skip without it.
"""

import json
import re
from dataclasses import replace
from urllib.parse import quote

import pytest
from support.made_records import episode, sub
from support.report_run import (
    AGENT,
    EXPERT,
    SEQUENCE_KEYS,
    data_of,
    make_run,
    replay,
    replayed,
    scene_of,
)
from support.run_files import karma

from karma.agent.journal.run_folder import read_run
from karma.agent.journal.steps import Ended, Enter, Instruction, Start, read_steps, steps_path
from karma.bench.figures.results import result_of
from karma.bench.report.episodes import LEAST, TOGETHER, Replayer, choose, choose_instructions
from karma.bench.report.html import Frames
from karma.bench.report.page import page_of, render
from karma.bench.report.replay import Rooms
from karma.bench.report.results import SHORT
from karma.bench.report.story import changes, told
from karma.contracts import MemoryUnit
from karma.errors import KarmaError

ROOMS = ("kitchen_1", "bedroom_1", "kitchen_1", "bedroom_1")  # of the sequence of four


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return make_run(tmp_path_factory.mktemp("run"), SEQUENCE_KEYS)


@pytest.fixture(scope="module")
def run(folder):
    return read_run(folder)


@pytest.fixture(scope="module")
def made(run):
    """(replays, page as HTML)."""
    frames = Frames()
    replays = replayed(Replayer(run, frames, "ends"), run.records)
    return replays, render(page_of(run, result_of(run, {}), replays), frames)


def story_of(run, key):
    return told(read_steps(steps_path(run.folder, *key)))


# ----------------------------------------------------------------- rooms


def test_story_gives_each_instruction_its_room_and_each_door_to_what_it_is_opened_for(run):
    story = story_of(run, (AGENT, "s4", 0))
    assert tuple(part.scene for part in story.parts) == ROOMS
    assert story.scenes == ("kitchen_1", "bedroom_1")
    doors = [(moment.part, moment.text) for moment in story.moments if moment.kind == "enter"]
    assert doors == [(1, "bedroom_1"), (2, "kitchen_1"), (3, "bedroom_1")]


def test_replays_of_sequences_find_rooms_as_they_were_left(made):
    replays, _ = made
    assert [one.record.key for one in replays] == list(SEQUENCE_KEYS)
    for one in replays:
        assert one.replay.differing == ()
        assert one.replay.actions > 20
        assert list(one.rooms) == ["kitchen_1", "bedroom_1"]
    expert = replays[1]
    hand = dict(
        (moment.part, sight.held)
        for moment, sight in zip(expert.story.moments, expert.replay.sights, strict=True)
        if moment.kind == "outcome"
    )
    assert hand[2].startswith("Apple|")  # out of the fridge, where it had put it
    assert hand[1].startswith("CD|")
    doors = [
        sight.held
        for moment, sight in zip(expert.story.moments, expert.replay.sights, strict=True)
        if moment.kind == "enter"
    ]
    assert doors == [None] * 3  # nothing goes through a door


def test_replay_without_its_doors_leaves_the_log(run):
    story = story_of(run, (EXPERT, "s4", 0))
    walled = tuple(moment for moment in story.moments if moment.kind != "enter")
    assert replay(replace(story, moments=walled), Rooms(), Frames(), "none").differing


def test_changes_tell_equal_ids_of_two_rooms_apart():
    def unit(scene, handled=False):
        return MemoryUnit(
            object_id="Mug|1", object_type="Mug", states=(), place_id=None, handled=handled,
            position_m=(0.0, 0.0, 0.0), image=None, scene=scene,
        )  # fmt: skip

    found = changes([unit("a"), unit("b")], [unit("b", handled=True), unit("c")])
    assert found == {"b/Mug|1": "changed", "c/Mug|1": "added", "a/Mug|1": "left"}


def test_story_that_breaks_off_at_a_door_has_no_instruction_behind_it():
    story = told(
        [
            Start(scene="a", seed=0),
            Instruction(number=0, instruction="x", memory=()),
            Ended(finished=True, memory=(), unmet=()),
            Enter(scene="b"),
        ]
    )
    assert story.moments[-1].part == 0
    assert scene_of(story, story.moments[-1]) == "b"


# ----------------------------------------------------------------- the choice


def record(task, met, error=""):
    parts = [sub("OPEN(Fridge): 1", unmet=not ok or ()) for ok in met]
    return episode(*parts, task=task, kind="sequence", error=error)


def test_choice_of_instructions_takes_short_episodes_whole_and_failures_of_long_ones_first():
    short, long = record("t", [True] * SHORT), record("u", [n % 100 != 7 for n in range(1000)])
    first, second = choose_instructions([short, long], "auto")
    assert first == tuple(range(SHORT))
    assert len(second) == TOGETHER
    assert set(range(7, 1000, 100)) < set(second)
    assert max(second) > 900  # the others are spread, too
    many = choose_instructions([long] * 100, "auto")
    assert {len(one) for one in many} == {LEAST}
    assert all(number % 100 == 7 for number in many[0])


def test_choice_of_instructions_counts_the_one_that_an_error_ended():
    (chosen,) = choose_instructions([record("t", [True] * 300, error="broke")], "auto")
    assert 300 in chosen


@pytest.mark.parametrize(
    ("wanted", "numbers"), [("all", (0, 1, 2, 3)), ("2", (1,)), ("3-9, 1", (0, 2, 3))]
)
def test_choice_of_instructions_by_number(wanted, numbers):
    assert choose_instructions([record("t", [True] * 4)], wanted) == [numbers]


@pytest.mark.parametrize("wanted", ["0", "5", "3-2", "x", "", "1-", "-2", "1,,2"])
def test_choice_of_instructions_refuses_what_there_is_not(wanted):
    with pytest.raises(KarmaError, match=r"--instructions .* names none of 1 to 4"):
        choose_instructions([record("t", [True] * 4)], wanted)


def test_choice_takes_one_episode_by_its_key(run):
    assert [one.key for one in choose(run.records, f"{EXPERT}/s4/0")] == [(EXPERT, "s4", 0)]


# ----------------------------------------------------------------- the page


def test_page_shows_the_chosen_instructions_and_names_the_command_for_others(run):
    frames = Frames()
    key = (EXPERT, "s16", 0)
    records = [one for one in run.records if one.key == key]
    (one,) = replayed(Replayer(run, frames, "none"), records, "2,7-8")
    assert one.replay.differing == ()
    page = render(page_of(run, result_of(run, {}), [one]), frames)
    (told_,) = data_of(page)
    shown = [number for number, part in enumerate(told_["parts"]) if part["shown"]]
    assert shown == [1, 6, 7]
    assert len(told_["parts"]) == 16
    assert "program" not in json.dumps([p for p in told_["parts"] if not p["shown"]])
    assert set(told_["moments"]["part"]["values"]) == {-1, 1, 6, 7}
    assert "karma report RUN --episodes ROW/TASK/SEED --instructions" in page


def test_page_of_a_long_sequence_marks_which_instructions_failed(run):
    (long,) = (one for one in run.records if one.key == (EXPERT, "s16", 0))
    parts = [
        replace(part, unmet=part.goals) if number in (3, 9) else part
        for number, part in enumerate(long.subtasks)
    ]
    records = (*run.records[:2], replace(long, subtasks=tuple(parts)))
    page = render(page_of(run, result_of(run, {}), []), Frames())
    assert "16 of 16" in page
    assert "Memory hits, % (MHR steady)" in page
    assert "--episodes 'ROW/s16/0'" in page
    changed = replace(run, records=records)
    page = render(page_of(changed, result_of(changed, {}), []), Frames())
    assert "14 of 16" in page
    assert "M3 0h1v10h-1zM9 0h1v10h-1z" in page
    listed = re.findall(r'<li value="(\d+)">', page.split('id="task-s16"')[1])
    assert listed == ["4", "10"]


def test_command_takes_instructions(folder, tmp_path):
    command = ["report", folder, "--out", tmp_path / "a.html", "--frames", "none"]
    command += ["--episodes", "s4", "--instructions"]
    karma(*command, "2")
    assert {
        tuple(e["moments"]["part"]["values"]) for e in data_of((tmp_path / "a.html").read_text())
    } == {(-1, 1)}
    assert "To fix: auto, all, or numbers" in karma(*command, "9", code=1)


# ----------------------------------------------------------------- in a browser


@pytest.fixture
def page(made):
    """The page that the browser has open."""
    return made[1]


def test_browser_steps_from_room_to_room(tab, made):
    story = made[0][0].story
    tab.open(f"{tab.page}#episode={quote(f'{AGENT}/s4/0')}&step=0")
    tab.value("document.getElementById('replay').scrollIntoView()")
    begun = 0
    for number, moment in enumerate(story.moments):
        if moment.kind == "enter":
            begun = number
        if moment.kind in ("enter", "outcome", "skill"):
            room = scene_of(story, moment)
            assert tab.text("now").startswith(f"step {number + 1} of ")
            assert room in tab.text("room-name").lower()
            assert room in tab.value("document.querySelector('#room svg').ariaLabel")
            path = tab.value("document.getElementById('walked').getAttribute('d')")
            assert path.count("L") == number - begun
        tab.press("ArrowRight")
    assert begun > 0
    assert tab.value("document.getElementById('eye').checkVisibility()")


def test_browser_shows_units_of_other_rooms_apart(tab, made):
    story = made[0][0].story
    step = next(n for n, m in enumerate(story.moments) if m.kind == "subtask" and m.part == 1)
    assert {unit.scene for unit in story.parts[1].before} == {"kitchen_1"}
    tab.open(f"{tab.page}#episode={quote(f'{AGENT}/s4/0')}&step={step}")
    count = len(story.parts[1].before)
    assert tab.value("document.querySelectorAll('#memory tr.elsewhere').length") == count
    assert tab.value("document.querySelectorAll('#room .unit').length") == 0
    assert f"{count} of other rooms" in tab.text("memory-title").lower()
    assert "in kitchen_1" in tab.text("memory")


def test_browser_finds_an_instruction_of_many(tab, made):
    story = made[0][2].story
    tab.open(f"{tab.page}#episode={quote(f'{EXPERT}/s16/0')}&step=0")
    visible = "[...document.querySelectorAll('#list li:not([hidden]) b')].map((b) => b.innerText)"
    assert len(tab.value(visible)) == 16
    tab.value(
        "(() => { const e = document.getElementById('find'); e.value = 'pen bed'; "
        "e.dispatchEvent(new Event('input')); })()"
    )
    assert tab.value(visible) == ["3.", "4.", "7.", "8.", "11.", "12.", "15.", "16."]
    assert tab.text("found") == "8 of 16"
    tab.click("#list [data-part='7']")
    begun = next(n for n, m in enumerate(story.moments) if m.kind == "subtask" and m.part == 7)
    assert tab.text("now").startswith(f"step {begun + 1} of ")
    assert tab.value("document.querySelector('#list [aria-current]').dataset.part") == "7"
    tab.click("#only-failed")
    assert tab.value(visible) == []
