"""Several rooms as one home: they stay as they were left, and nothing goes through a door."""

import shutil

import pytest
from support.written_tasks import write_tasks

from karma import registry
from karma.agent.karma import KarmaMethod, KarmaSettings
from karma.agent.planning.planner import Planner
from karma.bench.engine.episode import run_episode
from karma.errors import FileError, KarmaError
from karma.goals.files import load_tasks, with_whole
from karma.goals.goals import GoalTracker, WatchedWorld, parse_goal
from karma.household.places import BESIDE_A_DOOR
from karma.journal.entries import Action, Ended, Enter, Instruction
from karma.journal.steps import (
    StepLog,
    packed,
    read_steps,
)
from karma.memory.policies import make_policy
from karma.memory.recall import CosineRecall
from karma.memory.short_term import ShortTermMemory
from karma.models.scripted import MetadataVision, ScriptedModel
from karma.types.memory import MemoryUnit
from karma.types.space import SceneRef
from karma.types.tasks import SubTask, Task
from karma.world.core.scene import SCENES
from karma.world.home import Home
from karma.world.sim import EmbeddedWorld

KITCHEN, BEDROOM = "kitchen_1", "bedroom_1"


@pytest.fixture
def twin(tmp_path):
    """A second kitchen with the ids of the first."""
    path = tmp_path / "twin.json"
    shutil.copy(SCENES / f"{KITCHEN}.json", path)
    return str(path)


def one_of(world, kind):
    return next(t for t in world.last_event.metadata["objects"] if t["objectType"] == kind)


def change(world):
    """Open the fridge by force and take the apple."""
    for action, kind in (("OpenObject", "Fridge"), ("PickupObject", "Apple")):
        thing = one_of(world, kind)["objectId"]
        assert world.step(action, objectId=thing, forceAction=True)


def test_room_stays_as_it_was_left_and_the_hand_is_emptied_at_the_door(twin):
    home = Home(EmbeddedWorld)
    home.enter(KITCHEN)
    change(home)
    home.step("RotateRight")
    left = home.last_event.metadata["agent"]["rotation"]
    home.enter(twin)  # equal ids: another room
    assert (home.scene, one_of(home, "Fridge")["isOpen"]) == (twin, False)
    assert home.last_event.metadata["inventoryObjects"] == []
    home.enter(KITCHEN)
    assert one_of(home, "Fridge")["isOpen"]
    assert home.last_event.metadata["agent"]["rotation"] == left
    assert home.last_event.metadata["inventoryObjects"] == []
    apple = one_of(home, "Apple")
    assert apple["parentReceptacles"]
    assert not apple["isPickedUp"]
    assert apple["position"] != one_of(EmbeddedWorld(KITCHEN), "Apple")["position"]
    assert home.step("PickupObject", objectId=apple["objectId"], forceAction=True)
    for room in (twin, KITCHEN):  # both are known by now
        home.enter(room)
        assert home.last_event.metadata["inventoryObjects"] == []


def test_what_is_in_the_hand_is_put_onto_a_surface_and_not_in_the_way(twin):
    home = Home(EmbeddedWorld)
    home.reset(KITCHEN)
    cells = home.step("GetReachablePositions").metadata["actionReturn"]
    for kind in ("Pot", "Apple", "Knife"):
        thing = one_of(home, kind)["objectId"]
        assert home.step("PickupObject", objectId=thing, forceAction=True)
        home.enter(twin)
        home.enter(KITCHEN)
        (parent,) = {name.split("|")[0] for name in one_of(home, kind)["parentReceptacles"]}
        assert parent in BESIDE_A_DOOR
    assert home.step("GetReachablePositions").metadata["actionReturn"] == cells


def test_room_that_is_not_there_leaves_the_agent_where_it_is():
    home = Home(EmbeddedWorld)
    with pytest.raises(KarmaError, match="no room has been entered"):
        _ = home.last_event
    home.enter(KITCHEN)
    with pytest.raises(FileError, match="no scene named 'attic'"):
        home.enter("attic")
    assert (home.scene, one_of(home, "Fridge")["isOpen"]) == (KITCHEN, False)
    home.stop()
    with pytest.raises(KarmaError, match="no room has been entered"):
        home.step("RotateRight")


# ----------------------------------------------------------------- memory over rooms


def unit(scene, **changes):
    return MemoryUnit(
        object_id="Mug|1", object_type="Mug", position_m=(0, 0, 0), scene=scene, **changes
    )


def test_equal_ids_of_two_rooms_are_two_lines_of_memory():
    memory = ShortTermMemory(make_policy("fifo-merge[2]"))
    memory.remember(unit("a", states=("dirty",)))
    memory.remember(unit("b", states=("filled",)))
    assert [u.states for u in memory.units()] == [("dirty",), ("filled",)]
    assert memory.units("a") == (unit("a", states=("dirty",)),)
    assert memory.units("b") == (unit("b", states=("filled",)),)
    assert memory.units("c") == ()
    memory.correct(unit("a", place_id="Sink|1"))
    memory.correct(unit("c"))
    assert [u.place_id for u in memory.units()] == ["Sink|1", None]
    assert memory.forget("Mug|1", "a")
    assert not memory.forget("Mug|1", "a")
    assert [u.scene for u in memory.units()] == ["b"]
    memory.remember(unit("c"))  # the forgotten line is free
    assert [u.scene for u in memory.units()] == ["b", "c"]


# ----------------------------------------------------------------- whole episodes

FETCH = "Explore(robot, 'Apple')\nGoToObject(robot, 'Apple')\nPickupObject(robot, 'Apple')\n"
AWAY = (
    f"{FETCH}GoToObject(robot, 'Fridge')\nOpenObject(robot, 'Fridge')\n"
    "PutObject(robot, 'Apple', 'Fridge')\nCloseObject(robot, 'Fridge')\n"
)
AGAIN = (
    "GoToObject(robot, 'Fridge')\nOpenObject(robot, 'Fridge')\nPickupObject(robot, 'Apple')\n"
    "CloseObject(robot, 'Fridge')\n"
)
STILL = "GoToObject(robot, 'Fridge')\n"
WASH = (
    f"{FETCH}PutObject(robot, 'Apple', 'Sink')\nToggleOn(robot, 'Faucet')\n"
    "ToggleOff(robot, 'Faucet')\n"
)


def sequence(*parts, kind="sequence"):
    """Return a task of (scene, instruction, goals...) in turn."""
    subtasks = tuple(
        SubTask(instruction=text, goals=tuple(map(parse_goal, goals)), scene=SceneRef.of(scene))
        for scene, text, *goals in parts
    )
    return with_whole(Task(id="s1", kind=kind, scene=SceneRef.of(parts[0][0]), subtasks=subtasks))


@pytest.fixture(scope="module")
def recall():
    return CosineRecall(registry.load("embedders", "minilm")())


class Kept(KarmaMethod):
    """KARMA, with its last episode at hand."""

    def begin(self, world, scene, *, seed, folder):
        self.episode = super().begin(world, scene, seed=seed, folder=folder)
        return self.episode


@pytest.fixture
def karma(recall):
    """A function that makes a KARMA agent whose model says the given answers."""

    def make(answers, **settings):
        usual = {"seen_kept": 0, **settings}
        planner = Planner(ScriptedModel(answers), "compact")
        return Kept(planner, recall, MetadataVision(), KarmaSettings(**usual), attempts=1)

    return make


def run(method, task, folder, steps=None):
    world = Home(EmbeddedWorld)
    return run_episode(method, world, task, row="r", seed=0, folder=folder, steps=steps)


def test_sequence_goes_from_room_to_room_and_its_log_leads_there_again(karma, twin, tmp_path):
    task = sequence(
        (KITCHEN, "Put the apple away.", "INSIDE(Apple, Fridge)", "CLOSED(Fridge)"),
        (twin, "Put the apple away.", "INSIDE(Apple, Fridge)"),
        (KITCHEN, "Bring the apple.", "HOLDON(robot, Apple)"),
        (twin, "Bring the apple.", "HOLDON(robot, Apple)"),
        (KITCHEN, "Put the apple away.", "INSIDE(Apple, Fridge)"),
    )
    steps, method = StepLog(), karma([AWAY, AWAY, AGAIN, AGAIN, AWAY])
    record = run(method, task, tmp_path, steps)
    assert record.success, record
    assert (record.method, record.kind, record.scene) == ("KARMA", "sequence", KITCHEN)
    assert [sub.scene for sub in record.subtasks] == ["", "twin", "", "twin", ""]
    assert [sub.hits for sub in record.subtasks] == [0, 0, 1, 1, 1]  # of the room concerned only
    assert [len(sub.recalled) for sub in record.subtasks] == [0, 0, 1, 1, 1]
    assert [sum(c.explorations for c in sub.calls) > 0 for sub in record.subtasks] == [
        True, True, False, False, False,
    ]  # fmt: skip
    (tmp_path / "log.gz").write_bytes(packed(steps.data()))
    ends, moves = replayed(read_steps(tmp_path / "log.gz"), {KITCHEN: KITCHEN, "twin": twin})
    assert ends == [(sub.finished, sub.unmet) for sub in record.subtasks]
    assert moves == ["twin", KITCHEN, "twin", KITCHEN]


def replayed(log, scenes):
    """Do all that a log says; returns how its sub-tasks ended and where it went."""
    start, *steps = log
    home, tracker, goals = Home(EmbeddedWorld), GoalTracker(), {}
    assert isinstance(start, Enter)
    for scene in scenes.values():
        home.reset(scene)
    home.reset(scenes[start.scene])
    watched, ends, moves = WatchedWorld(home, tracker), [], []
    for step in steps:
        if isinstance(step, Enter):
            home.enter(scenes[step.scene])
            moves.append(step.scene)
        elif isinstance(step, Instruction):
            goals[step.number] = step.instruction
            tracker.start(home.last_event)
        elif isinstance(step, Action):
            event = watched.step(step.action, **step.arguments)
            assert bool(event) == step.ok, step
        elif isinstance(step, Ended):
            ends.append((step.finished, step.unmet))
    return ends, moves


@pytest.mark.parametrize(("kind", "unmet"), [("sequence", 1), ("composite", 0)])
def test_only_in_a_sequence_every_sub_task_is_judged_by_itself(karma, tmp_path, kind, unmet):
    """No metadata keeps that an apple was washed; the task that it belongs to does."""
    wash = (KITCHEN, "Wash the apple.", "STATE(Apple, cleaned)")
    record = run(karma([WASH, STILL]), sequence(wash, wash, kind=kind), tmp_path)
    assert record.subtasks[0].success
    assert len(record.subtasks[1].unmet) == unmet


def test_what_was_in_the_hand_is_remembered_as_put_down(karma, tmp_path):
    task = sequence(
        (KITCHEN, "Bring the apple.", "HOLDON(robot, Apple)"),
        (BEDROOM, "Open the drawer.", "OPEN(Drawer)"),
        (KITCHEN, "Bring the apple.", "HOLDON(robot, Apple)"),
    )
    method = karma([FETCH, "OpenObject(robot, 'Drawer')\n", FETCH])
    record = run(method, task, tmp_path)
    assert [sub.success for sub in record.subtasks] == [True, True, True]
    assert sum(call.explorations for call in record.subtasks[2].calls) == 0
    episode = method.episode
    assert "Fridge" in {node.type for node in episode.memory.graph.objects()}
    episode.enter(SceneRef.of(BEDROOM))
    assert "Bed" in {node.type for node in episode.memory.graph.objects()}
    assert {unit.place_id for unit in episode.memory.short_term.units(KITCHEN)} == {None}


# ----------------------------------------------------------------- files


@pytest.mark.parametrize(
    ("kind", "scene", "said"),
    [
        ("composite", BEDROOM, "subtasks[1].scene: only the kind 'sequence' goes from room"),
        ("sequence", "attic", "subtasks[1].scene: no scene named 'attic'"),
        ("sequence", f"{SCENES}/{KITCHEN}.json", f"two rooms have the name '{KITCHEN}'"),
    ],
)
def test_task_file_with_a_wrong_room_is_refused(tmp_path, kind, scene, said):
    path = tmp_path / "tasks.jsonl"
    write_tasks(path, [sequence((KITCHEN, "a", "OPEN(Fridge)"), (scene, "b", "OPEN(Drawer)"),
                                kind=kind)])  # fmt: skip
    with pytest.raises(FileError) as caught:
        load_tasks(path)
    assert said in str(caught.value)
    assert "line 1" in str(caught.value)
