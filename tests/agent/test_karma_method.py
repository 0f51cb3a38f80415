"""KARMA's episode: what goes from memory into the prompt, and from experience into memory."""

import pytest
from support.experiences import Words, begun
from support.household import bring, kitchen

from karma.agent.karma import KarmaMethod, KarmaSettings
from karma.agent.planning.planner import Planner
from karma.errors import FileError, KarmaError
from karma.memory.recall import CosineRecall
from karma.memory.scene_graph import SceneGraph
from karma.models.scripted import MetadataVision, ScriptedModel
from karma.types.completion import Decoding
from karma.types.events import Plan, SkillResult
from karma.types.roles import Resources
from karma.types.tasks import SubTask

FIND_APPLE = "Explore(robot, 'Apple', ['node_3'])\n"
TAKE_APPLE = f"{FIND_APPLE}GoToObject(robot, 'Apple')\nPickupObject(robot, 'Apple')\n"
WASH = (
    "GoToObject(robot, 'SinkBasin')\nPutObject(robot, 'Apple', 'SinkBasin')\n"
    "ToggleOn(robot, 'Faucet')\nToggleOff(robot, 'Faucet')\n"
)
CUT = (
    "Explore(robot, 'Knife', ['node_3'])\nGoToObject(robot, 'Knife')\n"
    "PickupObject(robot, 'Knife')\nGoToObject(robot, 'Apple')\nSliceObject(robot, 'Apple')\n"
)


def remembered(episode, kind):
    """Return the unit of that type that was used last, None if there is none."""
    units = reversed(episode.memory.short_term.units())
    return next((unit for unit in units if unit.object_type == kind), None)


@pytest.fixture
def start(tmp_path):
    """A function that begins an episode whose model says the given programs."""

    def begin(answers, *, refusing=False, **options):
        model, decoding = ScriptedModel(answers), Decoding(attempts=1, refusing=refusing)
        episode, world = begun(tmp_path, model, decoding=decoding, **{"seen_kept": 0, **options})
        return episode, model, world

    return begin


def do(episode, instruction, whole=""):
    return list(episode.do(SubTask(instruction=instruction, whole=whole)))


def types(units):
    return [unit.object_type for unit in units]


# ----------------------------------------------------------------- into memory


def test_refused_instruction_does_nothing_and_the_next_one_is_carried_out(start):
    episode, _, world = start(["refuse('thing')\n", TAKE_APPLE], refusing=True)
    plan, outcome = do(episode, "bring me the hammer")
    assert plan.refused.kind == "thing"
    assert not outcome.finished
    assert outcome.handled_ids == ()
    assert world.last_event.metadata["lastAction"] != "PickupObject"
    *_, after = do(episode, "take the apple")
    assert after.finished


def test_memory_is_written_after_the_instruction_in_the_order_of_use(start):
    episode, _, _ = start([TAKE_APPLE + WASH])
    events = episode.do(SubTask(instruction="wash the apple"))
    during = [len(episode.memory.short_term) for _ in events]
    assert set(during[:-1]) == {0}
    apple = remembered(episode, "Apple")
    assert types(episode.memory.short_term.units())[-1] == "Apple"
    assert apple.handled
    assert "cleaned" in apple.states
    assert apple.place_id.startswith("SinkBasin|")


@pytest.mark.parametrize(("left_in", "states"), [("SinkBasin", ("cleaned",)), ("Bowl", ())])
def test_memory_marks_what_was_left_in_the_sink_when_the_tap_runs_later(start, left_in, states):
    put = f"GoToObject(robot, '{left_in}')\nPutObject(robot, 'Apple', '{left_in}')\n"
    run = "ToggleOn(robot, 'Faucet')\nToggleOff(robot, 'Faucet')\n"
    episode, _, _ = start([TAKE_APPLE + put, run])
    do(episode, f"put the apple in the {left_in}")
    assert remembered(episode, "Apple").states == ()
    do(episode, "run the tap")
    assert remembered(episode, "Apple").states == states


def kitchen_id(kind):
    return next(thing.id for thing in kitchen().objects if thing.type == kind)


def test_stale_memory_is_forgotten_after_it_misled(start):
    episode, _, world = start([TAKE_APPLE + WASH, "GoToObject(robot, 'Apple')\n"], attempts=1)
    do(episode, "wash the apple")
    assert remembered(episode, "Apple")
    world.step("OpenObject", objectId=kitchen_id("Fridge"), forceAction=True)
    assert bring(world, "Apple", "Fridge")[0]
    world.step("CloseObject", objectId=kitchen_id("Fridge"), forceAction=True)
    *_, result, outcome = do(episode, "go to the apple")
    assert not outcome.finished
    assert "not at its remembered place" in result.reason
    assert remembered(episode, "Apple") is None


def test_receptacle_of_a_remembered_thing_is_known_though_it_is_not_remembered_itself(start):
    into_bowl = "GoToObject(robot, 'Bowl')\nPutObject(robot, 'Apple', 'Bowl')\n"
    programs = [TAKE_APPLE + into_bowl, "GoToObject(robot, 'Bowl')\n"]
    episode, _, world = start(programs, attempts=1, seen_kept=0, long_term=False)
    do(episode, "put the apple in the bowl")
    for _ in range(2):
        world.step("RotateRight")  # the bowl is out of view
    episode.memory.short_term.forget(kitchen_id("Bowl"), "handmade")
    assert types(episode.memory.short_term.units()) == ["Apple"]
    *_, result, outcome = do(episode, "go to the bowl")
    assert outcome.finished
    assert result.object_ids[-1] == kitchen_id("Bowl")


# ----------------------------------------------------------------- into the prompt


def test_prompt_names_what_an_earlier_instruction_handled(start):
    episode, model, _ = start([TAKE_APPLE + WASH, "GoToObject(robot, 'Apple')\n"])
    do(episode, "wash the apple")
    plan, result, outcome = do(episode, "go to the clean fruit")
    assert " @SinkBasin cleaned *Apple\n" in model.prompts[1].changing
    assert result.ok
    assert result.explorations == 0
    assert plan.names["Apple"] == result.object_ids[0] == kitchen_id("Apple")
    assert outcome.resident == plan.units == tuple(one.unit for one in plan.recalled)


def test_prompt_without_short_term_memory_holds_no_units(start):
    episode, model, _ = start(
        [TAKE_APPLE + WASH, "GoToObject(robot, 'SinkBasin')\n"], short_term=False
    )
    do(episode, "wash the apple")
    plan, *_, outcome = do(episode, "go to the sink")
    assert (plan.recalled, outcome.resident, len(episode.memory.short_term)) == ((), (), 0)
    assert "#memory\n#program" in model.prompts[1].changing
    assert "node_1" in model.prompts[1].stable


def test_prompt_without_long_term_memory_holds_no_areas(start, tmp_path):
    episode, model, _ = start(
        ["Explore(robot, 'Apple')\nGoToObject(robot, 'Apple')\n"], long_term=False, maps=tmp_path
    )
    *_, outcome = do(episode, "go to the apple")
    assert outcome.finished
    assert episode.memory.graph is None
    assert model.prompts[0].stable == "#areas\nunknown\n"
    assert model.specs[0].positions == ()
    assert list(tmp_path.glob("maps/*")) == []


@pytest.mark.parametrize(("paper_prompt", "recalled"), [(True, "Apple"), (False, "Bowl")])
def test_recall_asks_with_the_whole_text_or_the_part(start, paper_prompt, recalled):
    put = "PutObject(robot, 'Apple', 'DiningTable')\n"
    bowl = "GoToObject(robot, 'Bowl')\nPickupObject(robot, 'Bowl')\n"
    episode, _, _ = start(
        [TAKE_APPLE + put + bowl, "GoToObject(robot, 'Fridge')\n"],
        recall_k=1,
        paper_prompt=paper_prompt,
    )
    do(episode, "take things")
    plan, *_ = do(episode, "the bowl", whole="an apple an apple an apple")
    assert types(plan.units) == [recalled]


def test_failed_program_is_asked_for_again_with_the_reason_and_what_is_new(start):
    episode, model, _ = start(
        ["GoToObject(robot, 'Unicorn')\n", TAKE_APPLE + "GoToObject(robot, 'Unicorn')\n", WASH]
    )
    events = do(episode, "wash the apple")
    assert [type(event) for event in events].count(Plan) == 3
    assert events[-1].finished
    assert "#error" not in model.prompts[0].changing
    assert "could not find Unicorn" in model.prompts[1].changing
    assert "#held Apple\n" in model.prompts[2].changing
    assert " @hand *Apple\n" in model.prompts[2].changing


@pytest.mark.parametrize(
    ("first", "swapped"),
    [
        ("Explore(robot, 'Kettle')\nPickupObject(robot, 'Kettle')\n"
         "PutObject(robot, 'Kettle', 'Fridge')\n",
         TAKE_APPLE + "OpenObject(robot, 'Fridge')\nPutObject(robot, 'Apple', 'Fridge')\n"),
        ("Explore(robot, 'Lettuce')\nPickupObject(robot, 'Lettuce')\n", TAKE_APPLE),
        ("SwitchOn(robot, 'Laptop')\n", "ToggleOn(robot, 'Microwave')\n"),
        ("SliceObject(robot, 'Lettuce')\n", CUT),
        ("Explore(robot, 'Laptop')\n", TAKE_APPLE),
        ("PickupObject(robot, 'Kettle')\n", "GoToObject(robot, 'Fridge')\n"),  # and no more
    ],
)  # fmt: skip
def test_what_only_the_first_program_asked_for_is_not_reported_as_done(start, first, swapped):
    episode, _, _ = start([first, swapped, swapped])
    *_, outcome = do(episode, "see to it")
    assert not outcome.finished


def test_do_gives_up_after_its_attempts(start):
    episode, model, _ = start(["GoToObject(robot, 'Unicorn')\n"] * 9, attempts=3)
    events = do(episode, "go to the unicorn")
    assert len(model.prompts) == 3
    assert not events[-1].finished
    assert [event.ok for event in events if isinstance(event, SkillResult)] == [False] * 3


def test_second_program_may_not_search_for_what_is_not_there(start):
    missing = "Explore(robot, 'Laptop', ['node_3'])\n"
    episode, model, _ = start([missing, TAKE_APPLE])
    plans = [p for p in do(episode, "switch it on") if isinstance(p, Plan)]
    offered = [spec.objects for spec in model.specs]
    assert len(plans) == 2
    assert "Laptop" in offered[0]
    assert "Laptop" not in offered[1]
    assert "Apple" in offered[1]


# ----------------------------------------------------------------- long-term memory


def test_map_is_saved_on_the_first_visit_and_loaded_with_equal_results(start, tmp_path):
    maps = tmp_path / "maps"
    episode, model, _ = start([TAKE_APPLE], maps=maps)
    path = maps / "handmade.json"
    written = path.read_bytes()
    first = do(episode, "take the apple")
    assert SceneGraph.load(path).areas() == episode.memory.graph.areas()
    again, model_again, _ = start([TAKE_APPLE], maps=maps)
    assert do(again, "take the apple") == first
    assert model_again.prompts == model.prompts
    assert path.read_bytes() == written  # episodes never change it


@pytest.mark.parametrize("content", [b"", b'{"version": 1, "flo', b'{"version": 1}'])
def test_torn_map_is_refused_by_name_with_the_fix(start, tmp_path, content):
    path = tmp_path / "maps" / "handmade.json"
    path.parent.mkdir()
    path.write_bytes(content)
    with pytest.raises(FileError, match=r"maps/handmade\.json.*\n.*delete it"):
        start([], maps=tmp_path / "maps")
    assert path.read_bytes() == content


def test_map_of_another_floor_is_explored_anew(start, tmp_path):
    path = tmp_path / "maps" / "handmade.json"
    SceneGraph.over([(9.0, 9.0)]).save(path)
    episode, _, _ = start([], maps=tmp_path / "maps")
    assert len(episode.memory.graph.areas()) > 1
    assert SceneGraph.load(path) == episode.memory.graph


# ----------------------------------------------------------------- a row's options


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({}, "KARMA"),
        ({"short_term": False}, "KARMA (w/o short term memory)"),
        ({"long_term": False}, "KARMA (w/o long term memory)"),
    ],
)
def test_name_says_which_memory_is_missing(options, name):
    planner = Planner(ScriptedModel(), "compact")
    method = KarmaMethod(planner, CosineRecall(Words()), MetadataVision(), KarmaSettings(**options))
    assert method.name == name


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"short_trem": False}, "unknown option 'short_trem'; known options: long_term, short_t"),
        ({"recall_k": "many"}, "Expected `int`, got `str`.*recall_k"),
        ({"means": "none"}, "means = 'none': one of"),
        ({"policy": "lrru[3]"}, "lrru"),
    ],
)
def test_build_of_a_wrong_option_names_it(options, reason):
    resources = Resources(
        model=ScriptedModel(),
        profile="compact",
        recall=CosineRecall(Words()),
        vision=MetadataVision(),
    )
    with pytest.raises(KarmaError, match=reason):
        KarmaMethod.build(resources, options)
