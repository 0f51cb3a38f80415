"""The session: all that a plug-in needs to carry out an instruction in its own way."""

from dataclasses import replace

from support.experiences import begun
from support.household import kitchen

from karma.agent.loop import planned
from karma.agent.session import LOOK_OVER, SURVEY
from karma.models.scripted import ScriptedModel
from karma.types.events import Outcome, Plan, Review, SkillResult
from karma.types.planning import Advice, SkillCall
from karma.types.tasks import SubTask

TAKE = "Explore(robot, 'Apple')\nGoToObject(robot, 'Apple')\nPickupObject(robot, 'Apple')\n"


def id_of(kind):
    return next(thing.id for thing in kitchen().objects if thing.type == kind)


def carried_out(folder, answers, executor, **given):
    agent, world = begun(folder, ScriptedModel(answers), seen_kept=0)
    subtask = SubTask(instruction="take the apple")
    events = list(agent.execute(subtask, executor or planned(subtask), **given))
    return events, world


def test_executor_acts_looks_plans_and_words_the_report(tmp_path):
    known = {}

    def execute(session):
        yield session.call(SkillCall.of(SURVEY))
        table = next(name for name, kind in session.remembered().fixtures.items()
                     if kind == "DiningTable")  # fmt: skip
        yield session.call(SkillCall.of("GoToObject", table))
        yield session.call(SkillCall.of(LOOK_OVER, table))
        attempts = yield from session.do(SubTask(instruction="take the apple"))
        known.update(before=session.remembered(), seen=session.seen())
        session.say("the table was looked over", "seen")
        return attempts.finished

    events, _ = carried_out(tmp_path, [TAKE], execute)
    outcome = events[-1]
    assert [type(one) for one in events[:4]] == [SkillResult, SkillResult, SkillResult, Plan]
    assert outcome.finished
    assert [str(check) for check in outcome.checks] == [
        "the apple is in the hand: seen", "the table was looked over: seen",
    ]  # fmt: skip
    assert known["before"].held.object_type == "Apple"
    assert {"Apple", "Fridge"} <= known["before"].types
    assert known["seen"][id_of("Apple")].pickupable
    assert [unit.object_type for unit in outcome.change.remembered] == ["Apple"]


def test_instruction_for_which_nothing_is_done_leaves_memory_as_it_was(tmp_path):
    def refuse(session):
        session.say("I do nothing today", "unseen")
        return False
        yield

    (outcome,), world = carried_out(tmp_path, [], refuse)
    assert isinstance(outcome, Outcome)
    assert (outcome.finished, outcome.change, outcome.kept) == (False, None, ())
    assert world.last_event.metadata["lastAction"] != "PickupObject"


def test_what_is_to_stay_shut_is_opened_by_no_program(tmp_path):
    program = "GoToObject(robot, 'Fridge')\nOpenObject(robot, 'Fridge')\n"
    events, world = carried_out(tmp_path, [program] * 3, None, keep_shut={"Fridge"})
    assert not events[-1].finished
    fridge = next(o for o in world.last_event.metadata["objects"] if o["objectType"] == "Fridge")
    assert not fridge["isOpen"]


class Vegetarian:
    """A checker that lets no program touch the egg and puts one of its own in its place."""

    def review(self, answer, request, *, attempt, is_last):
        if not any("Egg" in call.objects for call in answer.calls):
            return Review(answer=answer)
        calls = (SkillCall.of("Explore", "Apple"), SkillCall.of("PickupObject", "Apple"))
        own = replace(
            answer, calls=calls, completion=replace(answer.completion, completion_tokens=0)
        )
        return Review(answer=replace(answer, calls=(), error="no eggs"), wrong="no eggs", own=own)


def test_checker_holds_an_answer_back_and_may_plan_in_its_place(tmp_path):
    def execute(session):
        attempts = yield from session.do(
            SubTask(instruction="take something"), Advice(checker=Vegetarian())
        )
        return attempts.finished

    events, _ = carried_out(tmp_path, ["PickupObject(robot, 'Egg')\n"], execute)
    held_back, own = (one for one in events if isinstance(one, Plan))
    assert (held_back.error, held_back.calls) == ("no eggs", ())
    assert own.completion.completion_tokens == 0
    assert events[-1].finished


def test_only_the_object_that_is_meant_is_handled(tmp_path):
    mugs = [thing.id for thing in kitchen().objects if thing.type == "Mug"]

    def execute(session):
        attempts = yield from session.do(
            SubTask(instruction="take a mug"), Advice(only={"Mug": mugs[-1]})
        )
        return attempts.finished

    program = "GoToObject(robot, 'Mug')\nPickupObject(robot, 'Mug')\n"
    events, _ = carried_out(tmp_path, [program], execute)
    assert {call.call.objects[0] for call in events if isinstance(call, SkillResult)} == {mugs[-1]}
