"""Where a page opens, what an episode failed of, and where the wanted thing was.

The browser's tests need Chromium, and skip without it.
"""

import re
from dataclasses import replace
from urllib.parse import quote

import pytest
from support.report_run import AGENT, EXPERT, data_of, make_run, replayed

from karma.agent.journal.run_folder import read_run
from karma.agent.journal.steps import Action, Ended, Instruction, Planned, SkillStep, Start
from karma.bench.figures.results import result_of
from karma.bench.report.episodes import Replayer
from karma.bench.report.html import Frames
from karma.bench.report.page import page_of, render
from karma.bench.report.replay import names_in
from karma.bench.report.story import endings, failed_at, told
from karma.world.core import scene as scenes

KEYS = ((EXPERT, "t1", 0), (AGENT, "t2", 0))
FAILED = f"{AGENT}/t2/0"


def plan(error="", refused=""):
    return Planned(recalled=(), prompt="p", program="x", error=error, refused=refused)


def skill(ok=True, reason=""):
    return SkillStep(call="PickupObject(robot, 'Mug')", ok=ok, reason=reason, object_ids=())


def story(*steps, unmet=("HOLDON(robot, Mug)",), finished=True):
    end = [] if unmet is None else [Ended(finished=finished, memory=(), unmet=unmet)]
    begin = (
        Start(scene="kitchen_1", seed=0),
        Instruction(number=0, instruction="a", memory=()),
    )
    return told([*begin, *steps, *end])


PASS = Action(action="Pass", arguments={}, ok=False, error="no")


@pytest.mark.parametrize(
    ("made", "moment", "words"),
    [
        (story(plan(), PASS, skill(False, "it is shut")), 4, "failed: it is shut"),
        (story(plan("line 1"), plan(), skill(False, "b")), 2, "no program: line 1"),
        (story(plan(refused="I cannot.")), 2, "the planner refused: I cannot."),
        (story(plan(), PASS, skill()), 5, "it ended with goals unmet"),
        (story(plan(), skill(), PASS, unmet=None), 4, "the episode broke off"),
    ],
)
def test_failed_episode_fails_at_the_first_refusal_or_else_at_its_end(made, moment, words):
    found = failed_at(made, {0})
    assert (found.moment, found.part) == (moment, 0)
    assert words in found.words


def test_episode_without_unmet_goals_fails_nowhere():
    assert failed_at(story(plan(), skill(False, "x"), unmet=()), {0}) is None
    assert failed_at(story(plan()), set()) is None


def test_attempts_each_say_why_they_ended():
    made = story(
        plan("line 1"), plan(refused="No."), plan(), skill(), skill(False, "shut"), plan(), skill(),
    )  # fmt: skip
    assert endings(made.parts[0]) == (
        "no program: line 1",
        "the planner refused: No.",
        "PickupObject(robot, 'Mug') failed: shut",
        "the program ran to its end, with 1 of its goals unmet",
    )
    (part,) = story(plan(), unmet=None).parts
    assert endings(part) == ("the episode broke off",)


def test_names_in_goals_are_told_once_and_what_cannot_be_read_has_none():
    goals = (
        "INSIDE(Apple/Egg, Fridge): 1",
        "2*ON(Apple/Egg, Table)",
        "all is well",
        "STATE(Mug, x",
    )
    assert names_in(goals) == ("Apple/Egg", "Fridge", "Table")


# ----------------------------------------------------------------- a run


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return read_run(make_run(tmp_path_factory.mktemp("run"), KEYS))


@pytest.fixture(scope="module")
def made(run):
    """(replays, page as HTML)."""
    frames = Frames()
    replays = replayed(Replayer(run, frames, "ends"), run.records)
    return replays, render(page_of(run, result_of(run, {}), replays), frames)


def test_replay_says_where_the_wanted_thing_is_by_the_worlds_truth(made):
    solved, failed = (one.replay.sights for one in made[0])
    assert not any(sight.wanted for sight in solved)
    (mug,) = (one for one in failed[failed_step(made)].wanted if one.name == "Mug")
    real = {one.id: one.center for one in scenes.load("kitchen_1").objects if one.type == "Mug"}
    assert {one.object_id for one in mug.things} == set(real)
    assert mug.count == len(real)
    for one in mug.things:
        x, _, z = real[one.object_id]
        assert (one.x_m, one.z_m) == pytest.approx((x, z), abs=0.2)
        assert one.where.startswith("at Cabinet (")
        assert one.loose


def failed_step(made):
    return made[0][1].opens_at


def test_replay_tells_how_far_it_is(run):
    shares = [one for one in Replayer(run, Frames(), "none").replaying(run.records)
              if isinstance(one, float)]  # fmt: skip
    assert shares == sorted(shares)
    assert 0 <= shares[0] < 0.5 <= shares[-1] < 1


def test_page_steps_through_a_failed_episode_from_where_it_failed(made):
    replays, page = made
    at = failed_step(made)
    assert 0 < at < len(replays[1].steps) - 1
    assert f'step={at}">step through, from where it failed (step {at + 1})</a>' in page
    assert 'step=0">step through</a>' in page
    assert page.count("<b>First failure:</b>") == 1
    assert re.findall(r'id="task-(\w+)" open', page) == ["t2"]


def test_page_of_a_run_without_failures_opens_at_its_top(run, made):
    solved = replace(run, records=tuple(one for one in run.records if one.success))
    page = render(page_of(solved, result_of(solved, {}), made[0][:1]), Frames())
    assert "First failure" not in page
    assert 'data-first=""' in page
    assert not re.findall(r'id="task-(\w+)" open', page)


def test_page_without_replays_opens_the_first_task_that_failed(run):
    page = render(page_of(run, result_of(run, {}), []), Frames())
    assert '<a href="#task-t2">t2</a>' in page
    assert re.findall(r'id="task-(\w+)" open', page) == ["t2"]


def test_page_tells_unmet_goals_and_why_attempts_ended(made):
    failed = data_of(made[1])[1]
    assert failed["parts"][0]["unmet"] == ["HOLDON(robot, Mug): 1"]
    assert [part["after"] is None for part in failed["parts"]] == [False, True]
    assert failed["failed"]["part"] == 0
    assert failed["parts"][0]["endings"] == [
        "the program ran to its end, with 1 of its goals unmet"
    ]


# ----------------------------------------------------------------- in a browser


@pytest.fixture
def page(made):
    """The page that the browser has open."""
    return made[1]


@pytest.fixture
def tab(tab):
    """The browser with the page open, from the disk."""
    tab.open(tab.page)
    tab.value("document.getElementById('replay').scrollIntoView()")
    return tab


def test_browser_opens_a_failed_run_at_its_first_failure_and_says_so(tab, made):
    tab.open(tab.page)
    assert tab.value("document.getElementById('episode').value") == FAILED
    assert tab.text("now").startswith(f"step {failed_step(made) + 1} of ")
    assert abs(tab.value("document.getElementById('replay').getBoundingClientRect().top")) < 50
    assert "This is the step where it failed, in instruction 1" in tab.text("failed")
    assert "HOLDON(robot, Mug): 1 unmet" in " ".join(tab.text("goals").split())
    assert "Mug at " in tab.text("goals")
    assert tab.value("document.querySelectorAll('#room .wanted-mark').length") == 2
    assert "ATTEMPT 1 OF 1" in tab.text("program").upper()
    tab.click("#failed button")
    assert tab.text("now").startswith("step 1 of ")
    assert f"It failed at step {failed_step(made) + 1}" in tab.text("failed")


def test_browser_tells_attempts_apart_each_with_why_it_ended(tab):
    last = f"{tab.page}#episode={quote(FAILED)}&step=9999"
    tab.open(last)
    count = tab.value("document.querySelectorAll('#program .attempt').length")
    said = " ".join(tab.text("program").split())
    for number in range(count):
        assert f"ATTEMPT {number + 1} OF {count}" in said.upper()
    assert said.count("ended: ") == count
    assert tab.value("document.querySelectorAll('#program .attempt.present').length") == 1


def test_browser_has_a_lane_with_its_name_for_each_kind_of_mark(tab):
    names = tab.value("[...document.querySelectorAll('.lane-names span')].map((e) => e.innerText)")
    assert names == ["instructions", "attempts", "skill calls", "actions", "refused"]
    lanes = tab.value(
        "['part', 'plan', 'call', 'action', 'bad'].map((name) => "
        "[...new Set([...document.querySelectorAll('#timeline .lane-' + name)].map((e) => "
        "Math.floor(Number(e.getAttribute('y')) / 10)))].join())"
    )
    assert lanes[:4] == ["0", "1", "2", "3"]
    assert lanes[4] in ("", "4")
    assert "where the episode failed" in tab.value("document.querySelector('.lane-key').innerText")


def test_browser_goes_to_the_task_of_an_episode_that_cannot_be_stepped_through(tab):
    tab.open(f"{tab.page}#episode={quote(f'{EXPERT}/t1/7')}")
    assert tab.value("document.getElementById('task-t1').open") is True
