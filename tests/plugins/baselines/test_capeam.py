"""CAPEAM-style: programs as frames, the table, the environment memory, and a handmade kitchen."""

import pytest
from support.experiences import experience, sight
from support.household import kitchen

from karma.agent.planning.planner import Planner
from karma.agent.planning.program import parse_program
from karma.files import to_json
from karma.models.scripted import ScriptedModel
from karma.plugins.baselines.baseline import BaselineSettings, likely_places
from karma.plugins.baselines.capeam import ANYWHERE, CapeamMethod, EnvironmentMemory
from karma.plugins.baselines.capeam_frames import ProgramReader, SubGoal, expand
from karma.types.events import Plan, SkillResult
from karma.types.space import SceneRef
from karma.types.tasks import SubTask
from karma.world.sim import EmbeddedWorld


def program(*lines):
    return parse_program("\n".join(lines))


def frames(*lines, held=""):
    return [(f.action, f.thing, f.place) for f in ProgramReader(program(*lines), held).frames]


FETCH_APPLE = ("GoToObject(robot, 'Apple')", "PickupObject(robot, 'Apple')")
WASH_APPLE = (
    "GoToObject(robot, 'Sink')",
    "PutObject(robot, 'Apple', 'Sink')",
    "ToggleOn(robot, 'Faucet')",
    "ToggleOff(robot, 'Faucet')",
)


# ----------------------------------------------------------------- frames


PUT_AWAY = ("PutObject(robot, 'Apple', 'Fridge')", "CloseObject(robot, 'Fridge')")
TAKE_OUT = ("OpenObject(robot, 'Fridge')", "PickupObject(robot, 'Apple')")
TAKE = ("Pickup", "Apple", "")
MEANT = {
    "washing that ends in the hand is one clean frame": (
        (*FETCH_APPLE, *WASH_APPLE, TAKE_OUT[1], "PutObject(robot, 'Apple', 'CounterTop')"),
        [TAKE, ("Clean", "Apple", "Sink"), ("Put", "Apple", "CounterTop")],
    ),
    "washing that leaves the thing in the sink puts it back": (
        (*FETCH_APPLE, *WASH_APPLE), [TAKE, ("Clean", "Apple", "Sink"), ("Put", "Apple", "Sink")]
    ),
    "putting into a sink without the tap is only putting": (
        (*FETCH_APPLE, *WASH_APPLE[:2]), [TAKE, ("Put", "Apple", "Sink")]
    ),
    "a fridge does not cool what stays in it": (
        (*FETCH_APPLE, *PUT_AWAY), [TAKE, ("Put", "Apple", "Fridge")]
    ),
    "a fridge cools what is taken out again": (
        (*FETCH_APPLE, *PUT_AWAY, *TAKE_OUT), [TAKE, ("Cool", "Apple", "Fridge")]
    ),
    "a cut fetches a knife and frees the hand of it": (
        ("SliceObject(robot, 'Bread')", "PickupObject(robot, 'Bread')"),
        [("Pickup", "Knife", ""), ("Slice", "Bread", ""), ("Put", "Knife", ""),
         ("Pickup", "Bread", "")],
    ),
    "frames of one chain speak of one object": (
        (*FETCH_APPLE, "PutObject(robot, 'Tomato', 'Fridge')"), [TAKE, ("Put", "Apple", "Fridge")]
    ),
    "throwing away is putting into the garbage can": (
        (*FETCH_APPLE, "ThrowObject(robot, 'Apple')"), [TAKE, ("Put", "Apple", "GarbageCan")]
    ),
    "taking out of what was opened names the place": (
        (TAKE_OUT[0], *FETCH_APPLE, "CloseObject(robot, 'Fridge')"), [("Pickup", "Apple", "Fridge")]
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", MEANT)
def test_program_is_read_as_frames(case):
    lines, wanted = MEANT[case]
    assert frames(*lines) == wanted


# ----------------------------------------------------------------- the table


def skills(*steps):
    return [(step.skill.removesuffix("Object"), *step.objects) for step in steps]


@pytest.mark.parametrize(
    ("action", "place", "steps"),
    [
        ("Heat", "Microwave", [
            ("Open", "Microwave"), ("Put", "Egg", "Microwave"), ("Close", "Microwave"),
            ("ToggleOn", "Microwave"), ("ToggleOff", "Microwave"),
            ("Open", "Microwave"), ("Pickup", "Egg"), ("Close", "Microwave"),
        ]),
        ("Cool", "Fridge", [
            ("Open", "Fridge"), ("Put", "Egg", "Fridge"), ("Close", "Fridge"),
            ("Open", "Fridge"), ("Pickup", "Egg"), ("Close", "Fridge"),
        ]),
        ("Clean", "Sink", [
            ("Put", "Egg", "Sink"), ("ToggleOn", "Faucet"), ("ToggleOff", "Faucet"),
            ("Pickup", "Egg"),
        ]),
    ],
)  # fmt: skip
def test_table_expands_what_changes_a_thing(action, place, steps):
    assert skills(*expand(SubGoal(action=action, thing="Egg", place=place))) == steps


# ----------------------------------------------------------------- memory and prior


def remembering(*sights):
    memory = EnvironmentMemory(here=lambda: (0.0, 0.9, 0.0))
    memory.observe(experience(*sights))
    return memory


def test_what_was_put_somewhere_is_passed_over_when_the_same_is_asked_again():
    memory = remembering(near := sight("Fork", 1.0), far := sight("Fork", 2.0))
    memory.was_put("Fork", "Drawer", near.object_id)
    memory.begin_subgoal("Fork", "Drawer")
    assert memory.best("Fork") == far
    memory.begin_subgoal("Fork", "Sink")
    assert memory.best("Fork") == near


def test_closed_receptacles_that_can_hold_a_type_are_drawn_too_the_likely_ones_more():
    closed = ("closed",)
    memory = remembering(
        sight("Fridge", 5.0, states=closed), sight("Cabinet", 1.0, states=closed),
        sight("Cabinet", 2.0, states=closed), sight("Laptop", 3.0, states=closed),
    )  # fmt: skip
    shares = likely_places("Egg")
    assert shares["Fridge"] > 0.5
    assert "Cabinet" not in shares
    weights = [(one.object_type, weight) for one, weight in memory.closed("Egg")]
    few, many = pytest.approx(ANYWHERE / 2), pytest.approx(ANYWHERE + shares["Fridge"])
    assert weights == [("Cabinet", few), ("Cabinet", few), ("Fridge", many)]
    assert memory.closed("Safe") == []


# ----------------------------------------------------------------- in a kitchen


@pytest.fixture
def start(tmp_path):
    path = tmp_path / "handmade.json"
    path.write_bytes(to_json(kitchen()))

    def begin(answers, seed=0, **settings):
        planner = Planner(ScriptedModel(answers), "compact")
        method = CapeamMethod(planner, BaselineSettings(**settings))
        world = EmbeddedWorld(path)
        episode = method.begin(world, SceneRef.of(str(path)), seed=seed, folder=tmp_path)
        return episode, world

    return begin


def do(episode, text):
    return list(episode.do(SubTask(instruction=text, goals=())))


def texts(moments):
    return [
        (m.call.skill, *(name.split("|")[0] for name in m.call.objects))
        for m in moments
        if isinstance(m, SkillResult) and m.call.skill != "Explore"
    ]


def test_washing_follows_the_table_and_leaves_the_apple_in_the_sink(start):
    episode, _ = start(["\n".join((*FETCH_APPLE, *WASH_APPLE))])
    moments = do(episode, "wash the apple")
    assert texts(moments) == [
        ("PickupObject", "Apple"),
        ("PutObject", "Apple", "SinkBasin"),
        ("ToggleOn", "Faucet"),
        ("ToggleOff", "Faucet"),
        ("PickupObject", "Apple"),
        ("PutObject", "Apple", "SinkBasin"),
    ]
    assert moments[-1].finished
    assert moments[-1].resident == ()


def test_thing_that_is_shut_in_is_opened_for_and_closed_again(start):
    put = ("PutObject(robot, 'Apple', 'Fridge')",)
    episode, _ = start(["\n".join((*FETCH_APPLE, *put)), "\n".join(FETCH_APPLE)])
    do(episode, "put the apple away")
    moments = do(episode, "take the apple")
    assert texts(moments) == [
        ("OpenObject", "Fridge"), ("PickupObject", "Apple"), ("CloseObject", "Fridge")
    ]  # fmt: skip
    assert not any(isinstance(m, SkillResult) and m.explorations for m in moments)


def test_planner_is_asked_once_whatever_fails(start):
    episode, _ = start(["GoToObject(robot, 'Boots')\nPickupObject(robot, 'Boots')"], steps=200)
    moments = do(episode, "bring boots")
    assert [isinstance(m, Plan) for m in moments].count(True) == 1
    assert not moments[-1].finished
    spent = sum(m.actions for m in moments if isinstance(m, SkillResult))
    assert 150 < spent <= 200


def test_unsupported_sub_goal_is_a_refusal_and_the_rest_is_done(start):
    episode, _ = start(["BreakObject(robot, 'Plate')\n" + "\n".join(FETCH_APPLE)])
    moments = do(episode, "smash the plate")
    refused = next(m for m in moments if isinstance(m, SkillResult))
    assert (refused.ok, refused.reason) == (False, "CAPEAM has no sub-goal for it")
    assert texts(moments)[-1] == ("PickupObject", "Apple")
    assert not moments[-1].finished


def test_what_is_nowhere_is_given_up_when_everything_was_looked_at_once(start):
    episode, _ = start(["PickupObject(robot, 'Boots')"])
    *moments, outcome = do(episode, "bring the boots")
    looks = [m for m in moments if isinstance(m, SkillResult)]
    places = [m.call.positions for m in looks]
    assert len(places) == len(set(places)) > 3
    assert not any(m.ok for m in looks)
    assert sum(m.actions for m in looks) < episode.settings.steps
    assert not outcome.finished


def test_seed_decides_where_it_looks(start):
    def places(seed):
        episode, _ = start(["\n".join(FETCH_APPLE)], seed=seed)
        return [
            m.call.positions
            for m in do(episode, "take the apple")
            if isinstance(m, SkillResult) and m.call.skill == "Explore"
        ]

    assert places(0) == places(0)
    assert len({tuple(places(seed)) for seed in range(6)}) > 1


def test_planner_is_told_of_furniture_only_when_asked(start):
    for told in (False, True):
        episode, _ = start(["\n".join(FETCH_APPLE)] * 2, furniture=told)
        do(episode, "take the apple")
        plan = next(m for m in do(episode, "take the apple") if isinstance(m, Plan))
        assert ("CounterTop" in plan.prompt.stable) == told
