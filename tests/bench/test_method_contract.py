"""What every method must do, whatever row it is: to be registered is to be tested."""

import shutil
from dataclasses import replace
from functools import cache
from inspect import signature

import pytest
from support.needs import need_models
from support.paths import ROOT
from support.spy_world import Spied

from karma import registry
from karma.bench.engine.episode import run_episode
from karma.errors import KarmaError
from karma.files import to_json
from karma.goals.files import load_tasks
from karma.goals.goals import parse_goal
from karma.models.llama.model import LlamaModel
from karma.models.llama.opening import LlamaOptions
from karma.models.manifest import resolve_planner
from karma.models.scripted import MetadataVision, ScriptedModel
from karma.types.events import Outcome, Plan, SkillResult
from karma.types.planning import WorkedExample
from karma.types.roles import Episode, Method, Resources
from karma.types.space import SceneRef
from karma.types.tasks import SubTask, Task
from karma.world.core.scene import SCENES
from karma.world.home import Home
from karma.world.sim import EmbeddedWorld

METHODS = registry.names("methods")
SCENE = "kitchen_1"
ROOM = SceneRef.of(SCENE)
TASKS = ROOT / "eval" / "alfred_l" / "tasks.jsonl"
GOALS = ("INSIDE(Apple, Fridge)", "HOLDON(robot, Mug)")
FETCH = (
    "Explore(robot, 'Apple')\nGoToObject(robot, 'Apple')\nPickupObject(robot, 'Apple')\n"
    "GoToObject(robot, 'Fridge')\nOpenObject(robot, 'Fridge')\n"
    "PutObject(robot, 'Apple', 'Fridge')\nCloseObject(robot, 'Fridge')\n"
)
ANSWERS = [FETCH, "Fly(robot)", *["GoToObject(robot, 'Fridge')\n"] * 40]
TASK = Task(
    id="t1",
    kind="composite",
    scene=ROOM,
    subtasks=tuple(
        SubTask(instruction=text, goals=(parse_goal(goal),))
        for text, goal in zip(("Put the apple away.", "Fetch the mug."), GOALS, strict=True)
    ),
)

pytestmark = pytest.mark.parametrize("name", METHODS)


@cache
def embedder():
    return registry.load("embedders", "minilm")()


@pytest.fixture(scope="module")
def nano():
    need_models("karma-nano")
    file = resolve_planner("karma-nano")
    model = LlamaModel(file.path, options=LlamaOptions(threads=1))
    return model, file.prompt_profile


def worked(instruction):
    """The one example of a planner's prompt, for the row that copies it."""
    program = BRING if instruction.startswith(("Bring", "Fetch")) else FETCH
    return (WorkedExample(instruction=GOALS[0], program=program),)


def resources(model, profile):
    return Resources(
        model=model,
        profile=profile,
        recall=registry.load("recalls", "cosine")(embedder()),
        vision=MetadataVision(),
        embedder=embedder(),
        examples=worked,
    )


def build(name, options=None, answers=ANSWERS):
    loaded = resources(ScriptedModel(answers), "compact")
    return registry.load("methods", name).build(loaded, options or {})


def begun(name, folder):
    world = EmbeddedWorld(SCENE)
    return build(name).begin(world, ROOM, seed=0, folder=folder), world


def records(method, name, folder):
    """Two episodes of one method, as bytes."""
    world = EmbeddedWorld()
    found = [
        run_episode(method, world, TASK, row=name, seed=seed, folder=folder) for seed in (0, 1)
    ]
    return [to_json(record) for record in found]


def timeless(moment):
    """A moment without what may differ between equal episodes."""
    if not isinstance(moment, Plan):
        return moment
    said = replace(moment.completion, first_token_s=None, total_s=0.0, reused_tokens=None)
    return replace(moment, completion=said)


def test_method_and_episode_have_the_contract_s_methods(name, tmp_path):
    method, (episode, _) = build(name), begun(name, tmp_path)
    roles = (method, Method, ("build", "begin")), (episode, Episode, ("enter", "do"))
    for one, role, members in roles:
        for member in members:
            ours, told = (signature(getattr(kind, member)) for kind in (type(one), role))
            required = [n for n, one in ours.parameters.items() if one.default is one.empty]
            assert required == list(told.parameters)


def test_do_yields_its_outcome_last_and_once(name, tmp_path):
    episode, world = begun(name, tmp_path)
    for subtask in TASK.subtasks:
        *before, last = episode.do(subtask)
        assert isinstance(last, Outcome)
        assert all(isinstance(moment, Plan | SkillResult) for moment in before)
        there = {thing["objectId"] for thing in world.last_event.metadata["objects"]}
        assert set(last.handled_ids) <= there


def test_begin_leaves_the_world_as_the_scene_has_it(name, tmp_path):
    _, world = begun(name, tmp_path)
    assert things(world) == things(EmbeddedWorld(SCENE))


def things(world):
    seen_from = ("visible", "isInteractable", "distance")
    metadata = world.last_event.metadata
    return metadata["agent"], [
        {key: value for key, value in thing.items() if key not in seen_from}
        for thing in metadata["objects"]
    ]


def test_equal_inputs_give_equal_records(name, tmp_path):
    first, again = (records(build(name), name, tmp_path / part) for part in "ab")
    assert first == again


def test_goals_are_read_by_the_expert_only(name, tmp_path):
    moments = []
    for goals in (True, False):
        episode, _ = begun(name, tmp_path)
        moments.append(
            [
                timeless(moment)
                for subtask in TASK.subtasks
                for moment in episode.do(
                    SubTask(instruction=subtask.instruction, goals=subtask.goals if goals else ())
                )
            ]
        )
    assert (moments[0] == moments[1]) == (name != "expert")


def test_unknown_option_is_refused_by_name(name):
    with pytest.raises(KarmaError, match="unknown option 'colour'"):
        build(name, {"colour": "red"})


# ----------------------------------------------------------------- never the world's truth


def spied_record(method, task, folder, *, lies):
    """One episode seen through a spy, as bytes, and what the spy took note of."""
    spied = Spied(method, lies=lies)
    record = run_episode(spied, EmbeddedWorld(), task, row="row", seed=0, folder=folder)
    return to_json(record), spied.spy.offences


def test_what_is_out_of_view_changes_nothing_but_for_the_expert(name, tmp_path):
    honest, _ = spied_record(build(name), TASK, tmp_path / "a", lies=False)
    lied, offences = spied_record(build(name), TASK, tmp_path / "b", lies=True)
    assert (honest == lied) == (name != "expert")
    assert offences == [] or name == "expert"


# ----------------------------------------------------------------- from room to room


@pytest.fixture
def twin(tmp_path):
    """Another room whose things have the ids of the first."""
    path = tmp_path / "twin.json"
    shutil.copy(SCENES / f"{SCENE}.json", path)
    return str(path)


BRING = "GoToObject(robot, 'Fridge')\nOpenObject(robot, 'Fridge')\nPickupObject(robot, 'Apple')\n"


def apples(*rooms):
    """A sequence that has the apple put away in one room after the other; in the last, fetched."""
    last = len(rooms) - 1
    asked = [
        SubTask(instruction=text, whole=text, goals=(parse_goal(goal),), scene=SceneRef.of(room))
        for number, room in enumerate(rooms)
        for text, goal in [
            ("Bring the apple.", "HOLDON(robot, Apple)")
            if number == last
            else ("Put the apple away.", GOALS[0])
        ]
    ]
    return Task(id="s1", kind="sequence", scene=ROOM, subtasks=tuple(asked))


def test_who_has_been_in_another_room_meanwhile_goes_on_as_if_he_had_not(name, tmp_path, twin):
    told = []
    for away in (False, True):
        home = Home(EmbeddedWorld)
        home.reset(SCENE)
        episode = build(name).begin(home, ROOM, seed=0, folder=tmp_path)
        first, second = TASK.subtasks
        told.append([[timeless(moment) for moment in episode.do(first)]])
        if away:
            for room in (twin, SCENE):
                home.enter(room)
                episode.enter(SceneRef.of(room))
        told[-1].append([timeless(moment) for moment in episode.do(second)])
    assert told[0] == told[1]


def test_memory_of_a_room_outlasts_work_in_another(name, tmp_path, twin):
    """Who finds the apple again at once without leaving the room does so after it too."""
    searches = []
    for rooms in ((SCENE, SCENE), (SCENE, twin, SCENE)):
        method = build(name, answers=[*[FETCH] * (len(rooms) - 1), *[BRING] * 40])
        record = run_episode(
            method, Home(EmbeddedWorld), apples(*rooms), row=name, seed=0, folder=tmp_path
        )
        assert not record.error
        assert name.startswith(("lota", "idle")) or record.success
        searches.append(sum(call.explorations for call in record.subtasks[-1].calls))
    assert searches[0] == searches[1]
    assert name.startswith(("lota", "idle")) or searches[1] == 0


def test_no_room_is_acted_in_on_what_was_seen_in_another(name, tmp_path, twin):
    """The rooms have equal ids: who mixes them up reaches for what he has not seen."""
    told = []
    for lies in (False, True):
        spied = Spied(build(name, answers=[*[FETCH] * 3, *[BRING] * 40]), lies=lies)
        task = apples(SCENE, twin, SCENE, twin)
        home = Home(EmbeddedWorld)
        record = run_episode(spied, home, task, row=name, seed=0, folder=tmp_path)
        told.append((to_json(record), spied.spy.offences))
    assert (told[0][0] == told[1][0]) == (name != "expert")
    assert told[1][1] == [] or name == "expert"


# ----------------------------------------------------------------- an episode's borders


def test_begin_again_leaves_nothing_of_the_episode_before(name, tmp_path):
    method, world = build(name, answers=[FETCH] * 40), EmbeddedWorld()
    moments = []
    for _ in range(2):
        world.reset(SCENE)
        episode = method.begin(world, ROOM, seed=3, folder=tmp_path)
        moments.append([[timeless(m) for m in episode.do(sub)] for sub in TASK.subtasks])
    assert moments[0] == moments[1]


def test_model_that_refuses_what_is_asked_becomes_a_record(name, tmp_path):
    method = build(name, answers=[])
    record = run_episode(method, EmbeddedWorld(), TASK, row=name, seed=0, folder=tmp_path)
    asks = name not in ("copying", "expert", "idle")
    assert record.error.startswith("RequestRefused: ") == asks
    assert record.success == (name == "expert")


@pytest.mark.model
def test_what_is_out_of_view_does_not_lead_the_shipped_planner_either(name, tmp_path, nano):
    task = next(t for t in load_tasks(TASKS) if t.id == "composite-04")
    told = []
    for lies in (False, True):
        method = registry.load("methods", name).build(resources(*nano), {})
        told.append(spied_record(method, task, tmp_path, lies=lies))
    assert (told[0][0] == told[1][0]) == (name != "expert")
    assert told[1][1] == [] or name == "expert"
