"""HELPER: its example memory, object memory, inspector, locator and rectifier."""

import numpy as np
import pytest
from support.experiences import Words, experience, sight
from support.household import kitchen

from karma.agent.planning.planner import Planner
from karma.agent.planning.program import parse_program
from karma.files import to_json
from karma.loading.planner_files import ExampleMemory
from karma.models.scripted import ScriptedModel
from karma.plugins.baselines.helper import HelperMethod, HelperSettings, seed_examples
from karma.plugins.baselines.helper_memory import (
    ObjectMemory,
    ends_there,
    idle,
    whole_first,
    with_object,
    without_object,
)
from karma.types.events import Plan, SkillResult
from karma.types.planning import WorkedExample
from karma.types.space import SceneRef
from karma.types.tasks import SubTask
from karma.world.sim import EmbeddedWorld

APPLE = "GoToObject(robot, 'Apple')\nPickupObject(robot, 'Apple')\n"
MUG = "GoToObject(robot, 'Mug')\nPickupObject(robot, 'Mug')\n"


def call(text):
    return parse_program(text)[0]


def remembering(*sights, held=None, gone=()):
    memory = ObjectMemory(here=lambda: (0.0, 0.9, 0.0))
    memory.observe(experience(*sights, held=held, missed=gone))
    return memory


# ----------------------------------------------------------------- examples


def test_seed_examples_are_seven_to_ten_programs():
    examples, errors = seed_examples()
    assert 7 <= len(examples) <= 10
    assert len(errors) >= 3
    assert len({example.instruction for example in (*examples, *errors)}) == len(examples + errors)


def examples_of(*texts):
    return [WorkedExample(instruction=text, program="GoToObject(robot, 'Apple')") for text in texts]


def test_nearest_examples_are_those_by_brute_force():
    seeds, _ = seed_examples()
    embedder, text = Words(), "place two forks in the drawer"
    memory = ExampleMemory(embedder, seeds)
    rows = embedder.embed([seed.instruction for seed in seeds])
    gaps = np.linalg.norm(rows - embedder.embed([text])[0], axis=1)
    order = [seeds[row] for row in np.argsort(gaps, kind="stable")]
    assert [memory.nearest(text, k) for k in (1, 3, 99)] == [
        tuple(order[:1]), tuple(order[:3]), tuple(order)
    ]  # fmt: skip


def test_example_that_is_added_to_a_copy_is_found_there_only():
    seeds = ExampleMemory(Words(), examples_of("wash a cup", "fetch a book"))
    memory = seeds.copy()
    (new,) = examples_of("smell the roses")
    memory.add(new)
    assert memory.nearest("smell some roses", 1) == (new,)
    assert len(memory) == 3
    assert len(seeds) == 2
    assert new not in seeds.nearest("smell the roses", 3)


# ----------------------------------------------------------------- object memory


def test_memory_prefers_what_was_put_down_then_the_nearest():
    memory = remembering(sight("Mug", 1.0), sight("Mug", 2.0), sight("Mug", 3.0))
    assert [one.object_id for one in memory.of("Mug")] == ["Mug|1.0", "Mug|2.0", "Mug|3.0"]
    memory.placed("Mug|3.0")
    assert memory.best("Mug").object_id == "Mug|3.0"
    memory.failed("Mug|3.0")
    memory.failed("Mug|1.0")
    assert [one.object_id for one in memory.of("Mug")] == ["Mug|2.0", "Mug|3.0", "Mug|1.0"]


def test_memory_lets_everything_be_used_again_by_the_next_instruction():
    memory = remembering(sight("Fork"))
    memory.finish("Fork|1.0")
    memory.could_not_find.add("Spoon")
    assert memory.best("Fork") is None
    memory.begin_instruction()
    assert memory.best("Fork") is not None
    assert memory.could_not_find == set()


def test_memory_knows_pieces_and_basins_by_the_wholes_name():
    memory = remembering(sight("AppleSliced"), sight("SinkBasin"))
    assert memory.best("Apple").object_type == "AppleSliced"
    assert memory.best("Sink").object_type == "SinkBasin"


# ----------------------------------------------------------------- the inspector


def skills(calls):
    return [(one.skill, *one.objects) for one in calls]


PICK, CUT = "PickupObject(robot, 'Apple')", "SliceObject(robot, 'Bread')"
KNIFE_FETCHED = [("PickupObject", "ButterKnife")]


@pytest.mark.parametrize(
    ("text", "held", "first"),
    [
        (PICK, "Mug", [("PutObject", "Mug|1.0", "CounterTop")]),
        (PICK, "Apple", []),
        (PICK, None, []),
        (CUT, None, KNIFE_FETCHED),
        (CUT, "Mug", [("PutObject", "Mug|1.0", "CounterTop"), *KNIFE_FETCHED]),
        (CUT, "Knife", []),
    ],
)
def test_hand_is_freed_and_a_knife_is_fetched_before_the_object_is_looked_for(text, held, first):
    memory = remembering(sight("Mug"), sight("CounterTop"), sight("ButterKnife"))
    found = without_object(call(text), sight(held) if held else None, memory)
    assert skills(found) == first


@pytest.mark.parametrize(
    "text", ["PutObject(robot, 'Mug', 'Fridge|1.0')", "PickupObject(robot, 'Egg|1.0')"]
)
def test_closed_receptacle_is_opened_before_putting_and_taking(text):
    for state, first in (("closed", [("OpenObject", "Fridge|1.0")]), ("opened", [])):
        egg = sight("Egg", parents=("Fridge|1.0",))
        memory = remembering(sight("Fridge", states=(state,)), egg)
        assert skills(with_object(call(text), memory)) == first


def test_opening_and_closing_what_cannot_be_or_is_so_already_is_dropped():
    memory = remembering(sight("Sofa"), sight("Fridge", states=("opened",)))
    assert idle(call("OpenObject(robot, 'Sofa|1.0')"), memory)
    assert idle(call("OpenObject(robot, 'Fridge|1.0')"), memory)
    assert not idle(call("CloseObject(robot, 'Fridge|1.0')"), memory)
    assert not idle(call("PickupObject(robot, 'Sofa|1.0')"), memory)


def test_piece_that_there_is_not_yet_is_cut_first():
    take = call("PickupObject(robot, 'AppleSliced')")
    first = whole_first(take, remembering(sight("Apple")))
    assert skills([first]) == [("SliceObject", "Apple")]
    assert whole_first(take, remembering(sight("AppleSliced"))) is None
    assert whole_first(call("PickupObject(robot, 'Apple')"), remembering()) is None


def test_thing_is_done_where_it_is_not_used_again_or_another_goes_there_too():
    put = "PutObject(robot, 'Fork', 'Drawer')\n"
    assert ends_there(call(put), parse_program("PickupObject(robot, 'Cup')"))
    assert ends_there(call(put), parse_program(f"PickupObject(robot, 'Fork')\n{put}"))
    wash = "PickupObject(robot, 'Fork')\nPutObject(robot, 'Fork', 'Sink')"
    assert not ends_there(call(put), parse_program(wash))
    assert not ends_there(call(put), parse_program("PickupObject(robot, 'Fork')"))


# ----------------------------------------------------------------- in a kitchen


@pytest.fixture
def start(tmp_path):
    path = tmp_path / "handmade.json"
    path.write_bytes(to_json(kitchen()))

    def begin(answers, profile="compact", **settings):
        model = ScriptedModel(answers)
        method = HelperMethod(Planner(model, profile), Words(), HelperSettings(**settings))
        world = EmbeddedWorld(path)
        episode = method.begin(world, SceneRef.of(str(path)), seed=0, folder=tmp_path)
        return episode, model

    return begin


def do(episode, text):
    return list(episode.do(SubTask(instruction=text)))


def results(moments):
    return [moment for moment in moments if isinstance(moment, SkillResult)]


def deeds(moments):
    return [
        (m.call.skill, *(name.split("|")[0] for name in m.call.objects))
        for m in results(moments)
        if m.call.skill not in ("Explore", "GoToObject")
    ]


def test_home_is_looked_round_once_within_the_budget_and_counts_as_exploration(start):
    episode, _ = start([MUG] * 2, explore_steps=40)
    moments = do(episode, "take the mug")
    first = [m for m in results(moments) if m.call.objects[0].startswith("node_")]
    assert len(first) == sum(m.explorations for m in first)
    assert 20 < sum(m.actions for m in first) <= 40
    assert not any(
        m.call.objects[0].startswith("node_") for m in results(do(episode, "take the mug"))
    )


def test_what_is_shut_in_is_searched_where_it_is_likely_and_taken(start):
    episode, _ = start(["PickupObject(robot, 'Egg')"])
    moments = do(episode, "fetch the egg")
    searched = [m.call.positions[0].split("|")[0] for m in results(moments) if m.call.positions]
    assert searched[-1] == "Fridge"
    assert deeds(moments)[-1] == ("PickupObject", "Egg")
    assert moments[-1].finished


def test_search_is_given_up_within_its_budgets_and_not_begun_again(start):
    episode, _ = start(["PickupObject(robot, 'Boots')\nGoToObject(robot, 'Boots')\n" + MUG] * 2)
    moments = do(episode, "bring the boots")
    looks = [m for m in results(moments) if m.call.skill == "Explore"]
    points = [m for m in looks if m.call.positions[0].startswith("point_")]
    assert len(points) == 20
    assert all(m.actions <= 50 for m in points)
    assert "Boots" in episode.memory.could_not_find
    assert deeds(moments) == [("PickupObject", "Mug")]
    assert not moments[-1].finished


def test_failure_is_replanned_once_with_the_error_then_given_up(start):
    episode, model = start(["OpenObject(robot, 'Window')\nBreakObject(robot, 'Bread')\n", MUG])
    moments = do(episode, "break the bread")
    plans = [moment for moment in moments if isinstance(moment, Plan)]
    assert len(plans) == 2
    assert "#error Failed sub-goal: BreakObject" in model.prompts[1].changing
    assert plans[1].examples == tuple(
        e.instruction for e in episode._errors.nearest(_error(moments), 3)
    )
    assert deeds(moments)[-1] == ("PickupObject", "Mug")


def _error(moments):
    failed = next(m for m in results(moments) if not m.ok and m.call.skill != "Explore")
    return f"Failed sub-goal: {failed.call}. Error: {failed.reason}"


def test_second_failure_turns_to_the_next_instance(start):
    bad = "PutObject(robot, 'Apple', 'StoveBurner')\n"
    episode, _ = start([APPLE + bad, APPLE + bad])
    moments = do(episode, "apple on the stove")
    failed = [m for m in results(moments) if not m.ok]
    assert len(failed) == 3  # once as planned, twice as corrected
    assert not moments[-1].finished


def test_completed_instruction_becomes_an_example(start):
    episode, _ = start([APPLE, MUG])
    before = len(episode.examples)
    do(episode, "take the shiny apple")
    assert len(episode.examples) == before + 1
    (learnt,) = episode.examples.nearest("take the shiny apple", 1)
    assert learnt.program == APPLE.strip()
    plan = next(m for m in do(episode, "take the shiny mug") if isinstance(m, Plan))
    assert plan.examples[0] == "take the shiny apple"


def test_full_profile_shows_the_examples_and_the_compact_one_has_no_room(start):
    texts = {}
    for profile in ("full", "compact"):
        episode, model = start([MUG], profile=profile)
        plan = next(m for m in do(episode, "Make some coffee.") if isinstance(m, Plan))
        texts[profile] = model.prompts[0].text
        assert plan.examples[0] == "Make coffee in the mug."
        assert len(plan.examples) == 3
    assert "ToggleOn(robot, 'CoffeeMachine')" in texts["full"]
    assert texts["full"].index("Make coffee in the mug.") < texts["full"].index("Make some coffee.")
    assert "CoffeeMachine" not in texts["compact"]
