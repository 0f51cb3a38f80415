"""From facts to a program: constrained language, bounded retries, ids for short names."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from karma.agent.planning.expert import ExpertView, NamedThing, solve
from karma.agent.planning.planner import Planner, grounded, program_spec
from karma.agent.planning.program import parse_program
from karma.agent.planning.prompt import compact
from karma.goals.goals import parse_goal
from karma.household.places import landmark_types
from karma.models.constraint import admits, begins
from karma.models.scripted import ScriptedModel
from karma.types.completion import Certainty, Decoding
from karma.types.memory import Area, MemoryUnit
from karma.types.planning import (
    REFUSAL_KINDS,
    Hint,
    Meaning,
    PlanRequest,
    RefusedRequest,
    SkillCall,
)

GOOD = "GoToObject(robot, 'Apple')\nPickupObject(robot, 'Apple')\n"
BAD = "FlyToObject(robot, 'Apple')\n"
AREAS = (
    Area(name="node_1", position_m=(0.0, 0.9, 0.0), contains=("CounterTop", "Fridge", "Sink")),
    Area(name="node_2", position_m=(1.0, 0.9, 0.0), contains=("DiningTable", "Microwave")),
)
UNITS = (
    MemoryUnit(object_id="Apple|1", object_type="Apple", position_m=(0, 0, 0)),
    MemoryUnit(object_id="Mug|1", object_type="Mug", position_m=(0, 0, 0), place_id="Fridge|1"),
    MemoryUnit(object_id="Apple|2", object_type="AppleSliced", position_m=(0, 0, 0)),
)
FACTS = PlanRequest(instruction="Fetch the apple", areas=AREAS, units=UNITS)


def plans(answers, facts=FACTS, profile="compact", **decoding):
    model = ScriptedModel(answers)
    return model, list(Planner(model, profile, Decoding(**decoding)).plan(facts))


# ----------------------------------------------------------------- asking


@pytest.mark.parametrize("profile", ["compact", "full"])
def test_plan_of_a_good_answer_holds_calls_names_and_what_was_recalled(profile):
    model, (plan,) = plans([GOOD], profile=profile)
    assert [str(call) for call in plan.calls] == GOOD.splitlines()
    assert (plan.error, plan.units, plan.completion.text) == ("", UNITS, GOOD)
    assert plan.names["Apple"] == "Apple|2"
    assert model.prompts == [plan.prompt]


class Reader:
    """A reader that finds these objects, and a hint."""

    def __init__(self, *objects):
        self.found, self.asked = objects, []

    def hints(self, instruction):
        self.asked.append(instruction)
        return (Hint(phrase="pome", meanings=(Meaning(name="Apple", similarity=0.71),)),)

    def objects(self, instruction):
        return dict.fromkeys(self.found, ())


def test_planner_that_reads_hints_is_told_them_at_every_attempt():
    model, reader = ScriptedModel([BAD, GOOD]), Reader()
    list(Planner(model, "compact", Decoding(), reader).plan(FACTS))
    assert reader.asked == [FACTS.instruction]
    assert all("#words pome: Apple 7\n" in prompt.changing for prompt in model.prompts)
    assert len(model.prompts) == 2


def test_plan_after_a_bad_answer_quotes_the_error_and_asks_again():
    model, (first, second) = plans([BAD, GOOD])
    assert first.calls == ()
    assert "there is no skill FlyToObject" in first.error
    assert (second.error, len(second.calls)) == ("", 2)
    assert "#error" not in model.prompts[0].changing
    assert "there is no skill FlyToObject. Did you mean GoToObject?" in model.prompts[1].changing
    assert model.prompts[0].stable == model.prompts[1].stable


@pytest.mark.parametrize("attempts", [1, 2, 5])
def test_plan_gives_up_after_the_attempts_it_has(attempts):
    model, found = plans([BAD] * 9, attempts=attempts)
    assert len(found) == len(model.prompts) == attempts
    assert all(plan.error and not plan.calls for plan in found)


@pytest.mark.parametrize("profile", ["compact", "full"])
def test_refusal_ends_the_asking_and_has_no_calls_and_no_error(profile):
    asked = replace(FACTS, instruction="Fetch the hammer")
    model, (plan,) = plans(["refuse('thing')\n", GOOD], asked, profile=profile, refusing=True)
    assert plan.refused == RefusedRequest(kind="thing")
    assert (plan.calls, plan.error, plan.failure) == ((), "", None)
    assert len(model.prompts) == 1


class Certain(ScriptedModel):
    """Says its script, and with which chance it refuses."""

    chance = 0.5

    def complete(self, prompt, **options):
        told = Certainty(mean_logprob=-0.1, least_logprob=-0.5, refusing=self.chance)
        return replace(super().complete(prompt, **options), certainty=told)


@pytest.mark.parametrize(("chance", "stands"), [(0.5, False), (0.59, False), (0.6, True)])
def test_refusal_that_is_hardly_likelier_than_a_program_is_asked_again(chance, stands):
    model = Certain(["refuse('impossible')\n", GOOD])
    model.chance = chance
    first, *later = Planner(model, "compact", Decoding(refusing=True)).plan(FACTS)
    assert first.refused is not None
    assert bool(later) is not stands
    assert all(plan.calls and plan.refused is None for plan in later)


@pytest.mark.parametrize("kind", ["thing", "place"])
def test_refusal_for_what_is_known_is_asked_again_and_may_not_come_again(kind):
    model = ScriptedModel([f"refuse('{kind}')\n", GOOD])
    planner = Planner(model, "compact", Decoding(refusing=True), Reader("apple", "microwave"))
    first, second = planner.plan(FACTS)
    assert first.refused is None and "known, so the request is not refused" in first.error
    assert second.calls
    assert model.specs[0].refusals and not model.specs[1].refusals


@pytest.mark.parametrize(
    ("objects", "kind"),
    [
        (("hammer", "apple"), "thing"), (("sofa",), "place"), (("safe", "fridge"), "thing"),
        (("apple",), "deed"), ((), "thing"), (("apple",), "impossible"),
    ],
)  # fmt: skip
def test_refusals_that_can_be_stand(objects, kind):
    model = ScriptedModel([f"refuse('{kind}')\n"])
    (plan,) = Planner(model, "compact", Decoding(refusing=True), Reader(*objects)).plan(FACTS)
    assert plan.refused is not None and plan.refused.kind == kind


def test_full_profile_tells_of_refusals_where_they_are_allowed_and_compact_never_does():
    told = {
        (profile, refusing): plans([GOOD], profile=profile, refusing=refusing)[0].prompts[0].stable
        for profile in ("compact", "full")
        for refusing in (False, True)
    }
    assert all(f"refuse('{kind}')" in told["full", True] for kind in REFUSAL_KINDS)
    assert "refuse" not in told["full", False]
    assert told["compact", False] == told["compact", True]


@pytest.mark.parametrize(
    ("answer", "line", "reason"),
    [
        (GOOD + BAD, 2, "there is no skill FlyToObject. Did you mean GoToObject?"),
        (GOOD + "PutObject(robot, 'Apple', 'Sofa')\n", 3, "Apple cannot be placed in Sofa; of"),
        ("# nothing to do\n", None, "the answer holds no skill call"),
    ],
)
def test_refused_answer_is_kept_with_its_line_and_shown_with_earlier_ones(answer, line, reason):
    model, (first, second) = plans([answer, GOOD], profile="full", attempts=2)
    assert (first.failure.failed, first.failure.ran, second.failure) == (line, False, None)
    assert first.failure.reason.startswith(reason)
    told = model.prompts[1].changing
    assert reason in told
    assert (f"{first.failure.lines[line]}  # FAILED: " in told) if line else True
    _, (*_, third) = plans([answer, BAD, GOOD], profile="full")
    assert "# Failed before\n" in third.prompt.changing


# ----------------------------------------------------------------- the language


def test_spec_has_no_furniture_that_the_map_does_not_show():
    area = Area(name="node_1", position_m=(0, 0, 0), contains=("Sofa",))
    mapped = program_spec(PlanRequest(instruction="go", areas=(area,)), {}).objects
    assert "Sofa" in mapped and "ArmChair" not in mapped
    assert {"LightSwitch", "Apple", "Chair"} <= set(mapped)  # may be overlooked, or carried
    assert "ArmChair" in program_spec(PlanRequest(instruction="go"), {}).objects


GOALS = (
    "INSIDE(Apple, Fridge)", "ON(Mug, DiningTable)", "STATE(Apple, clean)", "STATE(Mug, filled)",
    "STATE(Apple_2, sliced)", "HOLDON(robot, Book)", "STATE(Potato, cooked)", "ON(Tomato, Plate)",
    "TOGGLEON(Television)", "STATE(Bread, cooked)", "STATE(Egg, cooked)", "OPEN(Fridge)",
)  # fmt: skip


def test_what_was_searched_for_in_vain_is_not_offered_again_unless_memory_has_it():
    facts = PlanRequest(instruction="go", missing=("Laptop", "Mug"))
    objects = program_spec(facts, {"Mug": "Mug|+00.10|+01.00|+00.20"}).objects
    assert "Laptop" not in objects
    assert "Mug" in objects


@given(
    texts=st.lists(st.sampled_from(GOALS), min_size=1, max_size=3, unique=True),
    units=st.lists(st.sampled_from(UNITS), unique=True),
    mapped=st.booleans(),
)
def test_spec_admits_every_program_of_the_expert(texts, units, mapped):
    home = Area(name="home", position_m=(0, 0, 0), contains=tuple(sorted(landmark_types())))
    facts = PlanRequest(instruction="go", areas=(*AREAS, home) if mapped else (), units=units)
    names = compact(facts).names
    name_of = {object_id: name for name, object_id in names.items()}
    things = [
        NamedThing(
            name=name_of[unit.object_id],
            object_type=unit.object_type,
            place=name_of.get(unit.place_id),
            place_type="Fridge" if unit.place_id else None,
        )
        for unit in reversed(units)
    ]
    goals = [parse_goal(text) for text in texts if "_2" not in text or "Apple_2" in names]
    calls = solve(goals, ExpertView(things=tuple(things), areas=facts.areas))
    text = "".join(f"{call}\n" for call in calls)
    grammar = program_spec(facts, names).grammar
    assert begins(grammar, text) and (not calls or admits(grammar, text)), text


# ----------------------------------------------------------------- grounding


def test_grounded_puts_ids_for_short_names_and_keeps_types():
    calls = parse_program("PutObject(robot, 'Apple', 'Fridge')\nPutObject(robot, 'Cup', 'Shelf')")
    first, second = grounded(calls, {"Apple": "Apple|2", "Fridge": "Fridge|1"})
    assert first.objects == ("Apple|2", "Fridge|1")
    assert second.objects == ("Cup", "Shelf")


def test_grounded_keeps_areas_points_and_lines_and_grounds_furniture_to_search_from():
    places = ("node_1", (1.0, 0.9, 2.0), "Cabinet_2")
    call = SkillCall(skill="Explore", objects=("Mug",), positions=places, line=3)
    (found,) = grounded((call,), {"Mug": "Mug|1", "Cabinet_2": "Cabinet|2"})
    assert found.objects == ("Mug|1",)
    assert found.positions == ("node_1", (1.0, 0.9, 2.0), "Cabinet|2")
    assert found.line == 3
