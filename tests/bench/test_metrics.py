"""Metrics of hand-made records, reductions against twins, and the causes of failures."""

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.made_records import (
    APPLE,
    KNIFE,
    answer,
    call,
    episode,
    plain,
    runs,
    sub,
    write_run,
)

from karma.bench.figures.columns import OFF_ROW, figures
from karma.bench.figures.columns import plain as plain_figures
from karma.bench.figures.failures import CAUSES, count, failures
from karma.bench.figures.metrics import (
    METRICS,
    episodes_of,
)
from karma.bench.figures.results import result_of
from karma.journal.entries import Ended, Enter, Instruction
from karma.journal.run_folder import read_run
from karma.models.session import Spent
from karma.types.memory import MemoryUnit, Tour
from karma.types.planning import RefusedRequest

CUT, KEEP = "STATE(Apple, sliced): 1", "INSIDE(Apple, Fridge): 1"
HOLD = "HOLDON(robot, Mug): 1"
TAP = "TOGGLEON(Faucet): 1"


def saved(records):
    """Return the figures of all episodes of the row that saves."""
    return next(one for one in figures(records) if one.pairs and one.kind == "all")


def value(records, key, *, row="KARMA", kind="all", timings=None):
    """Return one figure."""
    lines = {(line.row, line.kind): line for line in figures(records, timings)}
    return lines[row, kind].values[key].value


# ----------------------------------------------------------------- success


def test_success_of_a_task_needs_every_sub_task():
    records = [
        episode(sub(CUT), sub(KEEP), task="t1"),
        episode(sub(CUT), sub(KEEP, unmet=True), task="t2"),
    ]
    assert value(records, "success") == 0.5
    assert value(records, "subtasks_done") == 0.75


def test_errors_stay_in_every_denominator_with_what_was_never_tried():
    records = [
        episode(sub(CUT), sub(KEEP, HOLD), seed=0),
        episode(sub(CUT), seed=1, error="WorldLost: gone"),
    ]
    assert value(records, "success") == 0.5
    assert value(records, "subtasks_done") == 0.75
    assert value(records, "goals_met") == 4 / 6
    assert value(records, "planner_calls") == 1.5


# ----------------------------------------------------------------- memory


def test_mra_asks_for_the_things_that_an_earlier_sub_task_was_about():
    first = sub(CUT)
    right = episode(first, sub(KEEP, recalled=[KNIFE, APPLE], hits=1, queries=1), task="t1")
    wrong = episode(first, sub(KEEP, recalled=[KNIFE], hits=1, queries=1), task="t2")
    gone = episode(first, sub(KEEP, recalled=[KNIFE], hits=0, queries=1), task="t3")
    assert value([right], "retrieved") == 1
    assert value([right, wrong], "retrieved") == 0.5
    assert value([right, wrong, gone], "retrieved") == 1 / 3


def test_mra_of_unrelated_tasks_and_of_rows_without_memory_is_undefined():
    unrelated = episode(sub(CUT, recalled=[KNIFE]), sub(HOLD, recalled=[APPLE]))
    assert value([unrelated], "retrieved") is None
    forgetful = episode(sub(CUT), sub(KEEP, queries=1))
    for key in ("retrieved", "hits", "hits_later"):
        assert value([forgetful], key) is None
    expert = episode(sub(CUT, answers=[]), sub(KEEP, answers=[], queries=1))
    assert value([expert], "retrieved") is None
    assert value([expert], "planner_calls") is None


def test_hits_count_things_cold_and_in_the_later_half():
    parts = [sub(CUT, hits=0, queries=2), sub(CUT, hits=0, queries=1),
             sub(KEEP, hits=1, queries=1), sub(KEEP, hits=1, queries=2)]  # fmt: skip
    assert value([episode(*parts)], "hits") == 2 / 6
    assert value([episode(*parts)], "hits_later") == 2 / 3
    assert value([episode(*parts[:3])], "hits_later") == 1  # the middle one is not later


# ----------------------------------------------------------------- cost


def test_amounts_are_means_per_episode_and_unknown_ones_stay_unknown():
    known = episode(sub(CUT, answers=[answer(prompt_tokens=70), answer(prompt_tokens=30)],
                        calls=[call("A", actions=4, explorations=2), call("B", actions=5)]),
                    task="t1")  # fmt: skip
    unknown = episode(sub(CUT, answers=[answer(prompt_tokens=None)]), task="t2")
    assert value([known], "prompt_tokens") == 100
    assert value([known], "explorations") == 2
    assert value([known], "actions") == 9
    assert value([known, unknown], "prompt_tokens") == 100
    assert value([unknown], "prompt_tokens") is None
    assert value([known], "cost") is None


def test_an_episode_that_dies_before_its_first_prompt_asked_the_planner_nothing(tmp_path):
    """In the terminal, in `results.json` and in the tables alike: 0 calls, 0 tokens, 0 steps."""
    done = [answer(prompt_tokens=90, completion_tokens=8)] * 2
    records = [
        episode(sub(CUT, answers=done, calls=[call("A", actions=6)]), task="t1"),
        episode(task="t2", error="WorldLost: gone"),
    ]
    keys = ("planner_calls", "prompt_tokens", "completion_tokens", "actions")
    assert [value(records, key) for key in keys] == [1, 90, 8, 3]
    alone = [episode(task="t2", error="WorldLost: gone")]
    assert [value(alone, key) for key in keys] == [None, None, None, 0]  # has it a planner?
    run = read_run(write_run(tmp_path / "run", records))
    (line, _) = result_of(run, {}).figures
    assert [line.values[key].value for key in keys] == [1, 90, 8, 3]


def test_hosted_models_count_per_episode_where_there_are_any():
    spent = Spent(role="planner", model="m", requests=3, failures=0, prompt_tokens=9,
                  completion_tokens=5, cost=0.5, seconds=None)  # fmt: skip
    asked = replace(episode(sub(CUT)), hosted=(spent,))
    records = [asked, episode(task="t2", error="WorldLost: gone")]
    keys = ("hosted_requests", "hosted_tokens", "cost")
    assert [value(records, key) for key in keys] == [1.5, 7, 0.25]
    assert [value(records[1:], key) for key in keys] == [None] * 3
    unknown = replace(asked, hosted=(replace(spent, cost=None),))
    assert value([unknown], "cost") is None


@given(records=runs(), data=st.data())
@settings(max_examples=12)
def test_figures_do_not_depend_on_the_order_of_records(records, data):
    turned = data.draw(st.permutations(records))
    named = {(line.row, line.kind): line for line in figures(turned)}
    for line in figures(records):
        assert named[line.row, line.kind] == line


@given(records=runs())
@settings(max_examples=15)
def test_rates_are_undefined_or_between_0_and_1_inside_their_intervals(records):
    for line in figures(records):
        for metric in METRICS:
            found = line.values[metric.key]
            assert (found.value is None) == (found.number == 0)
            if found.value is not None and metric.is_rate:
                assert 0 <= found.value <= 1
            if found.interval is not None:
                assert found.value in found.interval


# ----------------------------------------------------------------- reductions


def twins(*amounts, row="KARMA"):
    """Return a row's and its memory-off twin's episodes from (task, seed, places, places off)."""
    records = []
    for task, seed, places, off in amounts:
        records.append(plain(True, places=places, steps=10 * places, row=row, task=task, seed=seed))
        records.append(
            plain(True, places=off, steps=10 * off, row=OFF_ROW, task=task, seed=seed)
        )  # fmt: skip
    return records


def test_reduction_is_what_the_twin_spent_less_what_the_row_spent():
    records = twins(("t1", 0, 1, 10), ("t1", 1, 3, 10), ("t2", 0, 0, 20))
    line = saved(records)
    assert (line.row, line.pairs) == ("KARMA", 3)
    assert line.values["re"].value == pytest.approx(1 - 4 / 40)
    assert line.values["rt"].value == pytest.approx(1 - 4 / 40)
    assert line.values["rt_clock"].value is None  # nobody timed it


TOUR = Tour(scene="kitchen_1", places=12, actions=120)


def test_the_first_tour_is_spread_over_what_was_asked_in_the_room():
    """Three instructions in one room, 5 places and 50 steps each; 10 and 100 without a map."""
    records = [
        replace(one, tours=(TOUR,)) if one.row == "KARMA" else one
        for one in twins(("t1", 0, 5, 10), ("t1", 1, 5, 10), ("t2", 0, 5, 10))
    ]
    assert value(records, "tour_places") == 12
    assert value(records, "tour_actions") == 120
    assert value(records, "tour_places", row=OFF_ROW) is None
    assert value(records, "re") == pytest.approx(1 - 15 / 30)
    assert value(records, "re_toured") == pytest.approx(1 - (15 + 12) / 30)
    assert value(records, "rt_toured") == pytest.approx(1 - (150 + 120) / 300)


def test_reduction_pairs_by_task_and_seed_whatever_else_is_there():
    records = twins(("t1", 0, 2, 4), ("t2", 0, 3, 6))
    records += [plain(True, places=99, task="t1", seed=7)]
    line = saved(records)
    assert (line.pairs, line.values["re"].value) == (2, 0.5)


def test_reduction_of_related_sub_tasks_leaves_out_the_first_search():
    def row(name, first, second):
        looks = [call("Explore(robot, 'Apple')", explorations=n) for n in (first, second)]
        return episode(sub(CUT, calls=looks[:1]), sub(KEEP, calls=looks[1:]), row=name)

    line = saved([row("KARMA", 8, 1), row(OFF_ROW, 8, 8)])
    assert line.values["re"].value == pytest.approx(1 - 9 / 16)
    assert line.values["re_related"].value == pytest.approx(1 - 1 / 8)
    assert line.values["rt_related"].value == 0


def test_reduction_of_solved_pairs_leaves_out_who_gave_up():
    records = [*twins(("t1", 0, 5, 10)), plain(False, places=0, task="t2"),
               plain(True, places=10, row=OFF_ROW, task="t2")]  # fmt: skip
    line = saved(records)
    assert line.values["re"].value == 0.75
    assert (line.solved_pairs, line.values["re_solved"].value) == (1, 0.5)


@given(places=st.lists(st.tuples(st.integers(1, 30), st.floats(0, 1)), min_size=8, max_size=30))
@settings(max_examples=10)
def test_a_known_reduction_is_recovered_inside_its_interval(places):
    """Every twin searches so many places, and the row a fifth of them, give or take one."""
    records = twins(*(
        (f"t{number}", 0, off + round(wobble), 5 * off)
        for number, (off, wobble) in enumerate(places)
    ))  # fmt: skip
    line = saved(records)
    assert line.values["re"].value in line.values["re"].interval
    assert 0.6 - 1e-9 <= line.values["re"].value <= 0.8 + 1e-9


# ----------------------------------------------------------------- causes


def cause(*subtasks, steps=None, error=""):
    """Return the causes of an episode's failures, in order."""
    (one,) = episodes_of([episode(*subtasks, error=error)])
    return [found.cause for found in failures(one, steps)]


def unit(object_id):
    return MemoryUnit(
        object_id=object_id, object_type=object_id.split("|")[0], states=(), place_id=None,
        handled=True, position_m=(0.0, 0.0, 0.0), image=None,
    )  # fmt: skip


def log(*before_and_after):
    """Return a step log that knows memory before and after each sub-task."""
    steps = []
    for number, (before, after) in enumerate(before_and_after):
        steps.append(Instruction(number=number, instruction=""))
        held, kept = (tuple(map(unit, memory)) for memory in (before, after))
        steps.append(Ended(finished=True, resident=held, kept=kept, unmet=()))
    return steps


NEVER_NAMED = sub(KEEP, unmet=True, queries=1, calls=[call("GoToObject(robot, 'Mug')")])


UNREAD = [answer(error="line 1: no skill")] * 2
HELD = sub(KEEP, unmet=True, queries=1, hits=1, recalled=[KNIFE],
           calls=[call("GoToObject(robot, 'Knife')")])  # fmt: skip
RECALLED = sub(KEEP, unmet=True, recalled=[APPLE], hits=1, queries=1,
               calls=[call("GoToObject(robot, 'Mug')")])  # fmt: skip
NAMED = sub(KEEP, unmet=True, queries=1, calls=[call("Explore(robot, 'Apple')")])
UNRELATED = sub(HOLD, unmet=True, queries=1, calls=[call("GoToObject(robot, 'Knife')")])
LOST = sub(KEEP, unmet=True, finished=False, queries=1,
           calls=[call("Explore(robot, 'Apple')", "could not find Apple; searched 31 places")],
)  # fmt: skip


@pytest.mark.parametrize(
    ("parts", "steps", "expected"),
    [
        ([sub(CUT, unmet=True, answers=UNREAD, finished=False)], None, "planner"),
        ([sub(CUT, unmet=True, answers=[], finished=False)], None, "planner"),
        ([sub(CUT, unmet=True, calls=[call("PickupObject(robot, 'Apple')")])], None, "planner"),
        ([sub(CUT), HELD], None, "recall"),
        ([sub(CUT), HELD], log(([], [APPLE]), ([APPLE, KNIFE], [])), "recall"),
        ([sub(CUT), NEVER_NAMED], None, "evicted"),
        ([sub(CUT), NEVER_NAMED], log(([], [APPLE]), ([KNIFE], [])), "evicted"),
        ([sub(CUT), NEVER_NAMED], log(([], [KNIFE]), ([KNIFE], [])), "not stored"),
        ([sub(CUT), RECALLED], None, "planner"),
        ([sub(CUT), NAMED], None, "planner"),
        ([sub(CUT), UNRELATED], None, "planner"),
        ([sub(CUT), LOST], None, "evicted"),
        ([sub(CUT), LOST], log(([], [APPLE]), ([APPLE], [])), "recall"),
        ([LOST], None, "skill"),  # nobody spoke of it before
    ],
)
def test_cause_of_a_failure_follows_from_what_was_named_recalled_and_held(parts, steps, expected):
    assert cause(*parts, steps=steps) == [expected]


def test_cause_of_a_request_that_was_refused_is_its_own_and_is_counted():
    said = RefusedRequest(kind="thing", words=("hammer",))
    no = [answer(program="refuse('thing')\n", refused=said)]
    refused = sub(CUT, unmet=True, answers=no, finished=False)
    (found,) = failures(episodes_of([episode(refused)])[0])
    assert (found.cause, found.why) == (
        "refused",
        "I know of no 'hammer' in a home. (thing, by planner)",
    )
    assert value([episode(refused, sub(KEEP))], "refused") == 0.5
    assert value([episode(sub(CUT))], "refused") is None
    unasked = sub(KEEP, answers=[])
    assert value([episode(refused, unasked)], "refused") == 1


def in_room(scene, *object_ids):
    return tuple(replace(unit(one), scene=scene) for one in object_ids)


@pytest.mark.parametrize(("room", "expected"), [("kitchen", "recall"), ("bedroom", "evicted")])
def test_only_what_memory_held_of_the_room_concerned_was_held(room, expected):
    """Apple and knife have the same ids in both rooms."""
    before, after = in_room("kitchen", APPLE), in_room(room, APPLE)
    steps = [
        Enter(scene="kitchen"),
        Instruction(number=0, instruction=""),
        Ended(finished=True, resident=(), kept=before, unmet=()),
        Enter(scene="bedroom"),
        Instruction(number=1, instruction=""),
        Ended(finished=True, resident=before, kept=after, unmet=()),
        Enter(scene="kitchen"),
        Instruction(number=2, instruction=""),
        Ended(finished=False, resident=after, kept=after, unmet=()),
    ]
    elsewhere = replace(sub(KEEP), scene="bedroom")
    assert cause(sub(CUT), elsewhere, NEVER_NAMED, steps=steps) == [expected]


@pytest.mark.parametrize(
    ("text", "reason", "expected"),
    [
        ("Explore(robot, 'Knife')", "could not find Knife; searched 31 places", "skill"),
        ("Explore(robot, 'Safe')", "no Safe there", "skill"),
        ("OpenObject(robot, 'Fridge')", "CAPEAM has no sub-goal for it", "planner"),
        ("GoToObject(robot, 'Knife')", "gave up after 600 actions on Knife", "skill"),
        ("GoToObject(robot, 'Sink')", "could not get Sink into view and reach", "skill"),
        (f"GoToObject(robot, '{KNIFE}')", f"no {KNIFE} is known; Explore(robot, 'Knife') first",
         "skill"),
        ("GoToObject(robot, 'Knife')", "no Knife is known; Explore(robot, 'Knife') first",
         "planner"),
        ("PickupObject(robot, 'Knife')", "the hand holds Apple; put it down first, e.g. x",
         "planner"),
        ("PutObject(robot, 'Apple', 'Sofa')", "Apple cannot be placed in Sofa", "planner"),
        ("PickupObject(robot, 'Egg')",
         "Egg is in the closed Fridge; OpenObject(robot, 'Fridge') first", "planner"),
        ("OpenObject(robot, 'Microwave')", "Target must be off to open! Do ToggleOff first.",
         "planner"),
        ("PutObject(robot, 'Apple', 'Plate')", "No valid positions to place object found",
         "world"),
        ("PickupObject(robot, 'Apple')", "Apple would collide with the wall", "world"),
    ],
)  # fmt: skip
def test_cause_of_a_refused_call_follows_from_its_reason(text, reason, expected):
    broken = sub(CUT, unmet=True, finished=False, calls=[call("A"), call(text, reason)])
    assert cause(broken) == [expected]


def test_cause_of_what_was_never_tried_is_the_error():
    full = episode(sub(CUT), sub(KEEP), sub(HOLD), seed=1)
    for error, expected in (("WorldLost: gone", "world"), ("ModelError: torn", "error")):
        torn = episode(sub(CUT), error=error)
        one = episodes_of([full, torn])[1]
        found = failures(one)
        assert [f.cause for f in found] == [expected] * 2
        assert [f.number for f in found] == [1, 2]
        assert [f.is_first for f in found] == [True, False]


@given(records=runs())
@settings(max_examples=30)
def test_every_failed_sub_task_has_one_cause(records):
    for one in episodes_of(records):
        found = failures(one)
        assert [f.number for f in found] == [
            number for number, part in enumerate(one.record.subtasks) if not part.success
        ]
        counts = count(found)
        assert tuple(counts) == CAUSES
        assert sum(counts.values()) == bool(found)


# ----------------------------------------------------------------- tasks apart


def apart():
    """Return a solved task, one with nothing to do, and one that nobody is judged by."""
    goal = "CLOSED(Fridge): 1"
    idle = replace(sub(goal), at_start=(goal,))
    return [
        plain(True, task="t1"),
        plain(False, task="t2"),
        episode(idle, task="t3"),
        replace(episode(sub(), task="t4"), unjudged="the scene has no Book"),
    ]


def test_tasks_that_nobody_is_judged_by_are_in_no_figure_but_named():
    for line in figures(apart()):
        assert (line.episodes, line.tasks, line.successes) == (3, 3, 2)
        assert line.unjudged == {"t4": "the scene has no Book"}
    assert plain_figures(figures(apart()))[0]["unjudged"] == {"t4": "the scene has no Book"}
    assert "unjudged" not in plain_figures(figures(apart()[:3]))[0]
