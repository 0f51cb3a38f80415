"""One task, one method, one world: what the record says of it."""

from contextlib import nullcontext
from importlib import import_module
from pkgutil import iter_modules

import pytest

import karma
from karma import registry
from karma.agent.karma import KarmaMethod, KarmaSettings
from karma.agent.planning.planner import Planner
from karma.bench.engine.episode import run_episode
from karma.bench.methods.expert import ExpertMethod
from karma.errors import (
    FileError,
    KarmaError,
    ModelError,
    ProgramError,
    RequestRefused,
    ServerLost,
    UnknownNameError,
    UnwritableError,
    WorkerLost,
    WorldLost,
)
from karma.goals.goals import parse_goal
from karma.memory.recall import CosineRecall
from karma.models.scripted import MetadataVision, ScriptedModel
from karma.offline.guard import NetworkRefused
from karma.types.events import Outcome
from karma.types.memory import MemoryUnit
from karma.types.space import SceneRef
from karma.types.tasks import SubTask, Task
from karma.world.sim import EmbeddedWorld

AWAY = (
    "Explore(robot, 'Apple')\nGoToObject(robot, 'Apple')\nPickupObject(robot, 'Apple')\n"
    "GoToObject(robot, 'Fridge')\nOpenObject(robot, 'Fridge')\n"
    "PutObject(robot, 'Apple', 'Fridge')\nCloseObject(robot, 'Fridge')\n"
)
BACK = (
    "GoToObject(robot, 'Fridge')\nOpenObject(robot, 'Fridge')\nPickupObject(robot, 'Apple')\n"
    "CloseObject(robot, 'Fridge')\n"
)


def task(*pairs, scene="kitchen_1"):
    subtasks = tuple(
        SubTask(instruction=text, goals=tuple(parse_goal(goal) for goal in goals))
        for text, *goals in pairs
    )
    return Task(
        id="t1", kind="simple", scene=SceneRef.of(scene), subtasks=subtasks, notes=("a note",)
    )


PUT_AND_FETCH = task(
    ("Put the apple away.", "INSIDE(Apple, Fridge)", "CLOSED(Fridge)"),
    ("Fetch it again.", "HOLDON(robot, Apple)"),
)


@pytest.fixture(scope="module")
def recall():
    return CosineRecall(registry.load("embedders", "minilm")())


@pytest.fixture
def run(recall, tmp_path):
    """A function that runs a task with a KARMA agent whose model says the given answers."""

    def run_with(answers, task=PUT_AND_FETCH, attempts=1, **settings):
        method = KarmaMethod(
            Planner(ScriptedModel(answers), "compact"), recall, MetadataVision(),
            KarmaSettings(**{"seen_kept": 0, **settings}), attempts=attempts,
        )  # fmt: skip
        return run_episode(method, EmbeddedWorld(), task, row="a row", seed=7, folder=tmp_path)

    return run_with


def test_record_of_a_success_says_what_was_asked_answered_and_done(run):
    record = run([AWAY, BACK])
    assert (record.row, record.task, record.kind, record.scene, record.seed) == (
        "a row", "t1", "simple", "kitchen_1", 7,
    )  # fmt: skip
    assert record.notes == ("a note",)
    assert record.success
    first, second = record.subtasks
    assert first.instruction == "Put the apple away."
    assert first.goals == ("INSIDE(Apple, Fridge): 1", "CLOSED(Fridge): 1")
    assert [answer.program for answer in first.answers] == [AWAY]
    assert len(first.calls) == 7
    assert all(call.ok for call in first.calls)
    assert sum(call.actions for call in first.calls) > 7
    assert first.calls[0].explorations > 0
    assert (first.recalled, first.finished) == ((), True)
    assert len(second.recalled) == 1


def test_record_says_what_the_first_tour_of_the_room_cost_also_where_the_map_was_there(
    run, recall, tmp_path
):
    (tour,) = run([AWAY, BACK]).tours
    assert tour.scene == "kitchen_1"
    assert tour.actions > tour.places > 1
    later = [
        run_episode(
            KarmaMethod(Planner(ScriptedModel([AWAY, BACK]), "compact"), recall, MetadataVision(),
                        maps=tmp_path / "maps"),
            EmbeddedWorld(), PUT_AND_FETCH, row="a row", seed=7, folder=tmp_path,
        )
        for _ in range(2)
    ]  # fmt: skip
    assert [record.tours for record in later] == [(tour,), (tour,)]
    assert run([AWAY, BACK], long_term=False).tours == ()


def test_record_counts_hits_among_what_can_be_carried_cold_start_included(run):
    first, second = run([AWAY, BACK]).subtasks
    assert (first.queries, first.hits) == (1, 0)  # the fridge is no query
    assert (second.queries, second.hits) == (1, 1)


def test_record_names_the_goals_that_do_not_hold(run):
    record = run([AWAY.replace("CloseObject(robot, 'Fridge')\n", ""), BACK])
    assert not record.success
    first, second = record.subtasks
    assert first.unmet == ("CLOSED(Fridge): 1",)
    assert first.finished  # the program ran to its end; it was the wrong program
    assert second.success


def test_record_keeps_refused_answers_and_failed_calls(run):
    record = run(["Fly(robot)", AWAY, "GoToObject(robot, 'Unicorn')\n"])
    first, second = record.subtasks
    assert [bool(answer.error) for answer in first.answers] == [True, False]
    assert "no skill Fly" in first.answers[0].error
    assert (second.finished, second.calls[0].ok) == (False, False)
    assert "Unicorn" in second.calls[0].reason


def test_error_of_the_agent_s_own_ends_the_episode_and_is_recorded_with_what_was_done(run):
    record = run([AWAY])
    assert record.error.startswith("RequestRefused: the script has run out")
    assert len(record.subtasks) == 1
    assert record.subtasks[0].success
    assert not record.success


def test_scene_that_is_not_there_is_no_agent_s_fault_and_ends_the_run(run):
    with pytest.raises(FileError, match="no scene named 'attic'"):
        run([AWAY], task(("Go.", "OPEN(Fridge)"), scene="attic"))


class Mute:
    """A method that ends without an outcome."""

    name = "mute"

    def begin(self, world, scene, *, seed, folder):
        return self

    def do(self, subtask):
        return iter(())


class Blurting(Mute):
    """A method whose memory holds a slice before anything was done."""

    def do(self, subtask):
        unit = MemoryUnit(object_id="x", object_type="AppleSliced", position_m=(0, 0, 0))
        yield Outcome(finished=True, resident=(unit,), handled_ids=())


def test_method_without_an_outcome_is_a_bug_and_no_failed_episode(tmp_path):
    with pytest.raises(KarmaError, match="mute ended an instruction without an outcome"):
        run_episode(Mute(), EmbeddedWorld(), PUT_AND_FETCH, row="mute", seed=0, folder=tmp_path)


class Failing(Mute):
    """A method in whose course an error comes up."""

    def __init__(self, error):
        self._error = error

    def do(self, subtask):
        raise self._error
        yield


class OfAPlugin(KarmaError):
    """What somebody's plug-in raises."""


NOT_THE_AGENTS = [
    KarmaError("x"), FileError("x", "torn"), UnwritableError("x", "full"), UnknownNameError("x"),
    ModelError("damaged weights"), ServerLost("x"), WorkerLost("x", "killed"),
    WorldLost("it died", during="PickupObject", log="x.log"),
    NetworkRefused("a socket", "x", ("y",)),
    OfAPlugin("x"),
]  # fmt: skip


@pytest.mark.parametrize("error", NOT_THE_AGENTS, ids=lambda error: type(error).__name__)
@pytest.mark.parametrize("goals", [("OPEN(Fridge)",), ()], ids=["judged", "unjudged"])
def test_error_that_is_not_the_agent_s_is_no_record_of_a_failure(error, goals, tmp_path):
    asked = task(("Go.", *goals))
    unplayed = not goals and type(error) is FileError  # nobody is judged, and its room may be lost
    with nullcontext() if unplayed else pytest.raises(type(error)):
        run_episode(Failing(error), EmbeddedWorld(), asked, row="x", seed=0, folder=tmp_path)


@pytest.mark.parametrize(
    "error", [RequestRefused("too long"), ProgramError("no skill", line=1, code="Fly()")]
)
def test_error_of_the_agent_s_own_is_its_failure(error, tmp_path):
    record = run_episode(
        Failing(error), EmbeddedWorld(), PUT_AND_FETCH, row="x", seed=0, folder=tmp_path
    )
    assert record.error == f"{type(error).__name__}: {error}"
    assert not record.success


def test_every_error_of_the_package_is_the_agent_s_only_where_its_class_says_so():
    for module in iter_modules(karma.__path__, "karma."):
        import_module(module.name)
    kinds = {KarmaError}
    while more := {one for kind in kinds for one in kind.__subclasses__()} - kinds:
        kinds |= more
    ours = {kind.__name__ for kind in kinds if kind.agents_own and "test" not in kind.__module__}
    assert ours == {"RequestRefused", "ProgramError"}


def test_slice_in_memory_is_a_hit_for_the_whole(tmp_path):
    record = run_episode(
        Blurting(), EmbeddedWorld(), PUT_AND_FETCH, row="x", seed=0, folder=tmp_path
    )
    assert [sub.hits for sub in record.subtasks] == [1, 1]
    assert not record.success


def test_expert_s_record_has_calls_but_no_answers(tmp_path):
    record = run_episode(
        ExpertMethod(), EmbeddedWorld(), PUT_AND_FETCH, row="expert", seed=0, folder=tmp_path
    )
    assert record.success
    assert all(sub.calls and not sub.answers for sub in record.subtasks)


def test_record_tells_goals_that_held_when_the_task_began(run):
    done = task(("Keep it shut.", "CLOSED(Fridge)"), ("Fetch it.", "HOLDON(robot, Apple)"))
    record = run(["", BACK], task=done, attempts=0)
    assert [sub.at_start for sub in record.subtasks] == [("CLOSED(Fridge): 1",), ()]
    assert record.to_do
    idle = run([AWAY], task=task(("Keep it shut.", "CLOSED(Fridge)")))
    assert idle.success
    assert not idle.to_do


def test_record_of_a_task_without_goals_says_why_nobody_is_judged_by_it(run):
    record = run([AWAY], task=task(("Put it away.",)))
    assert (record.unjudged, record.success) == ("a note", False)
    assert run([AWAY, BACK]).unjudged == ""
