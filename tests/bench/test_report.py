"""Runs as pages: what they say, that they replay, that they are closed, and that one can step.

The browser's tests need Chromium, and skip without it.
"""

import base64
import gzip
import hashlib
import html
import re
import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser
from urllib.parse import quote

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.made_records import plain
from support.paths import ROOT
from support.report_run import (
    AGENT,
    EVIL,
    EXPERT,
    KEYS,
    POURED,
    data_of,
    make_run,
    replay,
    replayed,
)
from support.run_files import karma

from karma.agent.journal.records import EpisodeRecord, EpisodeTiming
from karma.agent.journal.run_folder import Finished, RunFolder, read_run
from karma.agent.journal.steps import (
    Action,
    Ended,
    Instruction,
    Start,
    packed,
    read_steps,
    steps_path,
)
from karma.bench.figures.columns import Figures
from karma.bench.figures.results import result_of
from karma.bench.figures.statistics import ConfidenceInterval, Estimate
from karma.bench.report.episodes import Replayer, choose
from karma.bench.report.html import Frames
from karma.bench.report.page import page_of, render
from karma.bench.report.replay import SIZE_PX, Rooms
from karma.bench.report.results import LEFT, WIDTH, episode_key, success_plot
from karma.bench.report.room import plan_of
from karma.bench.report.story import changes, told
from karma.contracts import MemoryUnit
from karma.world.core import scene as scenes


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return make_run(tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="module")
def run(folder):
    return read_run(folder)


@pytest.fixture(scope="module")
def made(run):
    """(frames, replays, page as HTML)."""
    frames = Frames()
    replays = replayed(Replayer(run, frames, "calls"), run.records)
    return frames, replays, render(page_of(run, result_of(run, {}), replays), frames)


def moments_of(episode):
    columns = episode["moments"]
    count = len(columns["kind"]["at"])
    return [
        {name: one["values"][one["at"][row]] for name, one in columns.items()}
        for row in range(count)
    ]


def blocks(page, tag):
    return re.findall(rf"<{tag}>(.*?)</{tag}>", page, re.S)


class Text(HTMLParser):
    """The texts of a page as a reader without scripts has them, and the names of its elements."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.said, self._inside = [], [], []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        self._inside.append(tag)

    def handle_endtag(self, tag):
        if tag in self._inside:
            while self._inside.pop() != tag:
                pass

    def handle_data(self, data):
        if not {"script", "style", "template"} & set(self._inside):
            self.said.append(data)


# ----------------------------------------------------------------- the story of a log


def unit(name, **fields):
    usual = {"states": (), "place_id": None, "handled": False, "position_m": (0.0, 0.0, 0.0)}
    return MemoryUnit(object_id=name, object_type=name, image=None, **(usual | fields))


def test_changes_name_what_came_changed_and_left():
    before = [unit("Apple"), unit("Mug"), unit("Egg")]
    after = [unit("Mug", states=("dirty",)), unit("Egg"), unit("Pan")]
    assert changes(before, after) == {"Mug": "changed", "Pan": "added", "Apple": "left"}


@given(st.lists(st.integers(0, 9)), st.lists(st.integers(0, 9)))
def test_changes_applied_to_memory_before_give_memory_after(old, new):
    found = changes([unit(str(n)) for n in old], [unit(str(n), handled=True) for n in new])
    kept = {name for name in map(str, old) if found.get(name) != "left"}
    assert kept | {name for name, how in found.items() if how == "added"} == set(map(str, new))


def test_story_gives_each_action_to_the_skill_call_that_it_belongs_to(run):
    (record,) = (one for one in run.records if one.key == (AGENT, "t1", 0))
    story = told(read_steps(steps_path(run.folder, *record.key)))
    assert [part.instruction for part in story.parts] == [p.instruction for p in record.subtasks]
    for number, part in enumerate(record.subtasks):
        mine = [m for m in story.moments if m.part == number and m.kind == "action"]
        counts = [sum(m.call == call for m in mine) for call in range(len(part.calls))]
        first, *others = [call.actions for call in part.calls]
        assert counts[1:] == others
        assert counts[0] - first in (0, 1)  # a look before the first call
        assert [call.text for call in story.parts[number].calls] == [c.text for c in part.calls]


def test_story_of_memory_is_gapless_and_shows_what_was_evicted(run):
    story = told(read_steps(steps_path(run.folder, AGENT, "t1", 0)))
    assert story.parts[0].before == ()
    for part, following in zip(story.parts, story.parts[1:], strict=False):
        assert part.after == following.before
    assert all(len(part.after) <= 2 for part in story.parts)
    assert "left" in story.parts[1].changes.values()  # two lines only


def test_story_of_a_log_that_breaks_off_is_told_as_far_as_it_goes():
    story = told(
        [
            Start(scene="kitchen_1", seed=0),
            Instruction(number=0, instruction="a", memory=()),
            Ended(finished=True, memory=(unit("Apple"),), unmet=()),
            Instruction(number=1, instruction="b", memory=(unit("Apple"),)),
            Action(action="Pass", arguments={}, ok=True, error=""),
        ]
    )
    assert [part.after is None for part in story.parts] == [False, True]
    assert [m.kind for m in story.moments] == [
        "start", "subtask", "outcome", "subtask", "action",
    ]  # fmt: skip
    assert story.moments[-1].call == -1


# ----------------------------------------------------------------- the replay


def test_replays_of_all_episodes_go_as_logged_also_of_another_seed(made, run):
    _, replays, _ = made
    assert [episode_key(one.record) for one in replays] == [
        episode_key(record) for record in run.records
    ]
    assert {one.record.seed for one in replays} == {0, 1}
    for one in replays:
        assert one.replay.actions > 20
        assert one.replay.differing == ()
        assert len(one.replay.sights) == len(one.story.moments)


def test_replay_says_which_action_did_not_go_as_logged(run):
    story = told(read_steps(steps_path(run.folder, EXPERT, "t1", 0)))
    number = next(n for n, m in enumerate(story.moments) if m.text == "OpenObject Fridge")
    wrong = replace(story.moments[number], ok=False)
    story = replace(story, moments=(*story.moments[:number], wrong, *story.moments[number + 1 :]))
    found = replay(story, Rooms(), Frames(), "none")
    assert found.differing == (number,)


def test_replay_ends_where_the_episode_ended(run):
    story = told(read_steps(steps_path(run.folder, EXPERT, "t1", 0)))
    found = replay(story, Rooms(), Frames(), "none")
    assert found.sights[-1].held.startswith("Apple|")
    assert all(sight.frame == -1 for sight in found.sights)
    (closing,) = (
        sight.targets
        for moment, sight in zip(story.moments, found.sights, strict=True)
        if moment.kind == "skill" and moment.part == 0 and moment.text.startswith("PutObject")
    )
    fridge = next(o for o in scenes.load("kitchen_1").objects if o.type == "Fridge")
    assert any(
        abs(x - fridge.center[0]) < fridge.size[0] / 2
        and abs(z - fridge.center[2]) < fridge.size[2] / 2
        for x, z in closing
    )


def test_replay_takes_the_scene_that_a_run_brought_along(run, tmp_path):
    (record,) = (one for one in run.records if one.key == (EXPERT, "t1", 0))
    elsewhere = replace(record, scene="FloorPlan999")
    log = gzip.decompress(steps_path(run.folder, *record.key).read_bytes())
    for data, place in (
        (scenes.find("kitchen_1").read_bytes(), tmp_path / "scenes" / "FloorPlan999.json"),
        (packed(log.replace(b"kitchen_1", b"FloorPlan999")), steps_path(tmp_path, *record.key)),
    ):
        place.parent.mkdir(parents=True)
        place.write_bytes(data)
    moved = replace(run, folder=tmp_path, records=(elsewhere,))
    (one,) = replayed(Replayer(moved, Frames(), "none"), moved.records)
    assert one.replay.actions > 20
    assert one.replay.differing == ()
    (room,) = one.rooms.values()
    assert room.scene == "FloorPlan999"
    assert room.areas == ()  # this run has left no map


def test_pictures_of_every_action_are_more_than_those_of_calls(run):
    story = told(read_steps(steps_path(run.folder, EXPERT, "t1", 0)))
    every, calls = Frames(), Frames()
    replay(story, Rooms(), every, "every")
    replay(story, Rooms(), calls, "calls")
    assert len(every) > len(calls) > 4


def test_frames_keep_each_different_picture_once(run):
    one, other = (np.full((SIZE_PX, SIZE_PX, 3), shade, dtype=np.uint8) for shade in (10, 200))
    frames = Frames()
    assert [frames.add(picture) for picture in (one, other, one.copy(), other)] == [0, 1, 0, 1]
    assert len(frames) == len(frames.uris()) == 2
    again = Frames()
    again.add(one)
    assert again.uris() == frames.uris()[:1]
    assert frames.uris()[0].startswith("data:image/webp;base64,UklGR")  # RIFF


def test_frames_of_equal_moments_are_drawn_once_and_are_what_would_have_been_drawn(run):
    story = told(read_steps(steps_path(run.folder, EXPERT, "t1", 0)))
    frames = Frames()
    first = replay(story, Rooms(), frames, "every")
    count = len(frames)
    assert replay(story, Rooms(), frames, "every") == first
    assert len(frames) == count
    alone, rooms = Frames(), Rooms()
    rooms.enter("kitchen_1")
    actions = [moment.action for moment in story.moments if moment.action is not None]
    for action in actions:
        event = rooms.step(action.action, **action.arguments)
        alone.add(event.frame)
    assert set(alone.uris()) <= set(frames.uris())


# ----------------------------------------------------------------- the choice


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
    ],
)
def test_choice_takes_failures_first_from_the_rows_in_turn(wanted, keys):
    assert [one.row + one.task[1:] for one in choose(RECORDS, wanted)] == keys


def test_choice_takes_all_episodes_of_a_task(run):
    assert [one.key for one in choose(run.records, "t1")] == [k for k in KEYS if k[1] == "t1"]


# ----------------------------------------------------------------- the page


def test_page_is_the_same_each_time(made, run):
    frames, replays, page = made
    assert render(page_of(run, result_of(run, {}), replays), frames) == page


def test_page_escapes_whatever_the_model_or_a_task_says(made):
    _, _, page = made
    assert "document.title" in page
    parsed = Text(page)
    assert [attrs for tag, attrs in parsed.tags if "onerror" in attrs] == []
    assert sum(tag == "script" for tag, _ in parsed.tags) == 3  # data, frames, ours
    said = "".join(parsed.said)
    assert EVIL in said
    assert AGENT in said
    assert "small <i>run</i>" in said
    data = data_of(page)
    assert {one["row"] for one in data} == {AGENT, EXPERT}
    programs = [p["program"] for one in data for part in one["parts"] for p in part["plans"]]
    assert POURED in programs


def test_page_allows_its_own_script_and_style_only_and_names_no_other_place(made):
    _, _, page = made
    policy = html.unescape(re.search(r'Content-Security-Policy" content="([^"]*)"', page)[1])
    for tag in ("style", "script"):
        (block,) = blocks(page, tag)
        wanted = base64.b64encode(hashlib.sha256(block.encode()).digest()).decode()
        assert f"{tag}-src 'sha256-{wanted}'" in policy
    assert policy.startswith("default-src 'none'; img-src data:;")
    places = [
        attrs[name]
        for tag, attrs in Text(page).tags
        for name in ("src", "href", "action", "data", "poster", "srcset", "xlink:href")
        if attrs.get(name)
    ]
    assert [place for place in places if not place.startswith(("#", "data:"))] == []
    assert re.findall(r"url\(|@import|fetch\(|XMLHttp|WebSocket|import\(", page) == []


def test_page_says_without_scripts_what_was_asked_written_and_done(made, run):
    _, _, page = made
    said = " ".join("".join(Text(page).said).split())
    for one in run.records:
        for part in one.subtasks:
            assert " ".join(part.instruction.split()) in said
            assert all(call.text in said for call in part.calls)
            assert all(" ".join(a.program.split()) in said for a in part.answers)
    assert said.count("✗ HOLDON(robot, Mug): 1") == 1
    assert "the script has run out" in said
    actions = sum(one["kind"] == "action" for e in data_of(page) for one in moments_of(e))
    assert f"{actions} of {actions} actions, done again in the embedded world" in said


def test_page_has_the_figures_that_the_tables_have(made, run):
    _, _, page = made
    found = result_of(run, {})
    said = "".join(Text(page).said)
    for line in found.figures:
        rate = line.values["success"]
        span = f"{rate.value:.2f} {rate.interval.low:.2f}–{rate.interval.high:.2f}"
        assert span in said
    assert [one.cause for one in found.failures if one.is_first]  # one episode failed ...
    (first,) = (one for one in found.failures if one.is_first)
    assert f"cause: {first.cause}" in said  # ... and the page says of what


def test_page_of_a_replay_that_left_the_log_says_so(made, run):
    frames, replays, _ = made
    wrong = replace(replays[0], replay=replace(replays[0].replay, differing=(5,)))
    page = render(page_of(run, result_of(run, {}), [wrong]), frames)
    (told_,) = data_of(page)
    assert "1 of" in told_["trouble"]
    assert "step 6" in told_["trouble"]
    assert [m["differs"] for m in moments_of(told_)].index(True) == 5
    assert "1 did not; the episodes say where" in page


def test_page_without_step_logs_has_tables_and_no_replay(run):
    page = render(page_of(run, result_of(run, {}), []), Frames())
    assert 'id="tasks"' in page
    assert "<script" not in page
    assert 'id="replay"' not in page


def test_episode_that_ended_before_it_began_is_in_the_tables_only(tmp_path):
    folder = make_run(tmp_path / "run", KEYS[:1])
    record = EpisodeRecord(
        row=EXPERT, task="t1", kind="simple", scene="kitchen_1", seed=0, notes=(), subtasks=(),
        error="RequestRefused: too long",
    )  # fmt: skip
    timing = EpisodeTiming(row=EXPERT, task="t1", seed=0, subtasks=())
    files = RunFolder(folder, steps=True)
    (folder / "results.json").unlink()  # it goes on
    files.commit(Finished(record=record, timing=timing))
    result = karma("report", folder, "--episodes", "all")
    assert "1 of 2 episodes to step through" in " ".join(result.split())
    page = (folder / "report.html").read_text()
    assert [one["key"] for one in data_of(page)] == [f"{AGENT}/t1/0"]
    assert "RequestRefused" in page


def test_success_plot_puts_rates_and_intervals_on_the_scale():
    ends = ConfidenceInterval(low=0.0, high=1.0)
    found = [Estimate(value=0.25, interval=ends, number=4), Estimate(value=None)]
    rate, unknown = (
        Figures(row=row, kind="simple", episodes=4, tasks=4, seeds=1, values={"success": one})
        for row, one in zip("ab", found, strict=True)
    )
    plot = success_plot([rate, unknown])
    (dot,) = plot.dots
    assert (dot.low, dot.x, dot.high) == (LEFT, LEFT + WIDTH / 4, LEFT + WIDTH)
    assert [name.text for name in plot.names] == ["a", "b"]


@pytest.mark.parametrize("path", sorted(scenes.SCENES.glob("*_1.json")), ids=lambda p: p.stem)
def test_room_plan_has_the_furniture_within_its_walls_and_labels_apart(path):
    scene = scenes.load(path)
    plan = plan_of(scene, None)
    floor = plan.floor
    assert {"Fridge", "Bed", "Sofa", "Toilet"} & {shape.title for shape in plan.shapes}
    for shape in plan.shapes:
        assert floor.x - 30 < shape.x + shape.width / 2 < floor.x + floor.width + 30
        assert floor.y - 30 < shape.y + shape.height / 2 < floor.y + floor.height + 30
    centers = [
        (s.x + s.width / 2, s.y + s.height / 2) for s in plan.shapes if s.label and not s.upright
    ]
    assert len(centers) == len(set(centers)) > 1
    assert plan.cells.count("M") == len(scene.reachable)


# ----------------------------------------------------------------- the command


def test_command_writes_the_page(folder, tmp_path):
    done = karma(
        "report", folder, "--out", tmp_path / "a.html", "--episodes", "1", "--frames", "none"
    )
    assert "1 of 4 episodes" in done
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert [one["task"] for one in data_of(page)] == ["t2"]  # the one that failed
    assert data_of(page, "frames") == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--episodes", "t9"], "To fix: all, a number, ROW/TASK/SEED, or one of t1, t2"),
        (["--frames", "most"], "To fix: auto, every, calls, ends, none"),
    ],
)
def test_command_refuses_what_it_does_not_know(folder, tmp_path, arguments, words):
    done = karma("report", folder, "--out", tmp_path / "a.html", *arguments, code=1)
    assert words in done
    assert not (tmp_path / "a.html").exists()


def test_command_names_a_folder_without_a_run(tmp_path):
    done = karma("report", tmp_path, code=1)
    assert "karma eval" in done


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


# ----------------------------------------------------------------- in a browser


@pytest.fixture
def page(made):
    """The page that the browser has open."""
    return made[2]


@pytest.fixture
def tab(tab):
    """The browser with the page open, from the disk."""
    tab.open(tab.page)
    tab.value("document.getElementById('replay').scrollIntoView()")
    return tab


BEGIN = f"#episode={quote(f'{AGENT}/t1/0')}&step=0"


def test_browser_opens_an_address_at_its_step(tab, made):
    assert tab.requests() == [tab.page]
    tab.open(tab.page + BEGIN)
    count = len(made[1][0].story.moments)
    assert tab.text("now") == f"step 1 of {count}"
    assert tab.value("document.getElementById('stage').hidden") is False
    assert tab.value("document.querySelectorAll('#room svg .low').length") > 3
    assert tab.value("document.getElementById('eye').naturalWidth") == SIZE_PX


def test_browser_steps_by_keys_through_a_whole_episode(tab, made):
    replayed = made[1][0]
    tab.open(tab.page + BEGIN)
    seen = []
    for number, moment in enumerate(replayed.story.moments):
        assert tab.text("now").startswith(f"step {number + 1} of ")
        assert int(tab.value("document.getElementById('slider').value")) == number
        assert tab.value("document.getElementById('walked').getAttribute('d')").count("L") == number
        if moment.kind == "action":
            assert moment.text in tab.text("happening")
        seen.append(tab.value("document.getElementById('eye').src"))
        tab.press("ArrowRight")
    assert len(set(seen)) > 5
    tab.press("ArrowLeft")
    assert tab.text("now").startswith(f"step {len(seen) - 1} of ")
    tab.press("Home")
    assert tab.text("now").startswith("step 1 of ")
    tab.press("End")
    assert tab.text("now").startswith(f"step {len(seen)} of ")


def test_browser_shows_memory_as_it_fills_and_evicts(tab, made):
    story = made[1][0].story
    for number, part in enumerate(story.parts):
        step = next(
            n for n, m in enumerate(story.moments) if m.kind == "outcome" and m.part == number
        )
        tab.open(f"{tab.page}#episode={quote(f'{AGENT}/t1/0')}&step={step}")
        for how in ("added", "changed", "left"):
            ids = [name for name, change in part.changes.items() if change == how]
            rows = tab.value(
                f"[...document.querySelectorAll('#memory tr.{how}')].map((row) => row.title)"
            )
            assert sorted(rows) == sorted(ids)
            assert tab.value(f"document.querySelectorAll('#room .unit.{how}').length") == len(ids)
        assert (
            tab.text("memory-title")
            .lower()
            .startswith(f"short-term memory: {len(part.after)} unit")
        )
    assert {how for part in story.parts for how in part.changes.values()} >= {"added", "left"}


def test_browser_goes_by_buttons_calls_and_instructions(tab, made):
    story = made[1][0].story
    tab.open(tab.page + BEGIN)
    calls = [n for n, m in enumerate(story.moments) if m.kind not in ("action", "start")]
    for number in calls[:4]:
        tab.click("[data-move=call-on]")
        assert tab.text("now").startswith(f"step {number + 1} of ")
    tab.press("ArrowLeft", shift=True)
    assert tab.text("now").startswith(f"step {calls[2] + 1} of ")
    tab.click("#parts [data-part='1']")
    begun = [n for n, m in enumerate(story.moments) if m.kind == "subtask"][1]
    assert tab.text("now").startswith(f"step {begun + 1} of ")
    assert EVIL in tab.text("happening")
    tab.click("[data-move=call-on]")
    assert "PickupObject(robot, 'Apple')" in tab.text("program")
    assert "#memory" in tab.text("prompt")


def test_browser_goes_to_the_episode_of_an_address(tab, made):
    tab.open(f"{tab.page}#episode={quote(f'{EXPERT}/t1/1')}&step=7")
    assert tab.text("now").startswith("step 8 of ")
    assert tab.value("document.getElementById('episode').value") == f"{EXPERT}/t1/1"
    tab.open(f"{tab.page}#episode={quote(f'{AGENT}/t2/0')}&step=0")
    assert "the script has run out" in tab.text("trouble")


def test_browser_refuses_scripts_and_requests_that_are_not_the_pages_own(tab):
    tab.value(
        "(() => { const s = document.createElement('script'); s.textContent = "
        "\"document.title = 'owned'\"; document.body.append(s); "
        "const i = new Image(); i.src = 'http://127.0.0.1:9/x.png'; })()"
    )
    assert tab.value("document.title") != "owned"
    refused = [text for text in tab.complaints() if "Content Security Policy" in text]
    assert len(refused) == 2
    tab.events.clear()


def test_browser_without_scripts_shows_the_tables(tab):
    tab.send("Emulation.setScriptExecutionDisabled", value=True)
    try:
        tab.open(tab.page)
        assert tab.value("document.getElementById('stage').hidden") is True
        assert "needs scripts" in tab.value("document.getElementById('replay').innerText")
        assert tab.value("document.querySelectorAll('#results tbody tr').length") > 3
        assert tab.value("document.querySelectorAll('details.task').length") == 2
    finally:
        tab.send("Emulation.setScriptExecutionDisabled", value=False)


def test_browser_shows_no_sideways_scrolling_on_a_small_screen(tab):
    tab.send(
        "Emulation.setDeviceMetricsOverride", width=400, height=800, deviceScaleFactor=1,
        mobile=False,
    )  # fmt: skip
    try:
        assert tab.value("document.documentElement.scrollWidth") <= 400
    finally:
        tab.send("Emulation.clearDeviceMetricsOverride")


def test_browser_prints_tables_and_plots_without_the_replay(tab):
    shown = "(e) => e.checkVisibility()"
    unfolded = f"[...document.querySelectorAll('.sheet table')].filter({shown}).length"
    assert tab.value(unfolded) == 0
    dark = [{"name": "prefers-color-scheme", "value": "dark"}]
    tab.send("Emulation.setEmulatedMedia", media="print", features=dark)
    tab.send(
        "Emulation.setDeviceMetricsOverride", width=1000, height=700, deviceScaleFactor=1,
        mobile=False,
    )  # fmt: skip
    try:
        tables = tab.value("document.querySelectorAll('.sheet table').length")
        assert tab.value(unfolded) == tables > 2
        assert tab.value("document.getElementById('replay').checkVisibility()") is False
        assert tab.value("document.querySelectorAll('#plots svg').length") == 5
        assert tab.value("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
        wide = "[...document.querySelectorAll('table')].filter((e) => e.scrollWidth > 1000).length"
        assert tab.value(wide) == 0
    finally:
        tab.send("Emulation.setEmulatedMedia", media="", features=[])
        tab.send("Emulation.clearDeviceMetricsOverride")


# ----------------------------------------------------------------- the same bytes everywhere


def test_page_does_not_depend_on_the_hash_seed(folder, tmp_path):
    pages = []
    for seed in ("0", "4242"):
        out = tmp_path / f"{seed}.html"
        command = [sys.executable, "-m", "karma.cli", "report", str(folder), "--out", str(out),
                   "--frames", "none"]  # fmt: skip
        code = "from karma.cli import app; app()"
        command[1:3] = ["-c", code]
        subprocess.run(
            command, check=True, capture_output=True, env={"PYTHONHASHSEED": seed, "PATH": ""},
            cwd=ROOT,
        )  # fmt: skip
        pages.append(out.read_bytes())
    assert pages[0] == pages[1]
