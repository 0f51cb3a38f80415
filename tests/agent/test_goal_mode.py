"""Goal mode: what a small model answers is read, its objects are found, and it is brought about."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.experiences import begun
from support.household import kitchen, on

from karma.agent.goal_mode.language import GRAMMAR, parse_goals
from karma.agent.goal_mode.names import types_named
from karma.agent.goal_mode.prompt import EXAMPLES
from karma.errors import KarmaError, ProgramError
from karma.goals.goals import GoalTracker, parse_goal
from karma.models.constraint import admits
from karma.models.scripted import ScriptedModel
from karma.types.events import Outcome
from karma.types.planning import End
from karma.types.tasks import SubTask

# ----------------------------------------------------------------- the language


@pytest.mark.parametrize(
    "text",
    [
        "put(Apple, Fridge)",
        "clean(2 Mug)\nput(2 Mug, Cabinet)",
        "avoid(Book in Bed)\nput(all Book, Shelf)",
        "if(Egg in Fridge)\ncook(Egg)",
        "hold(Mug not dirty in Sink)",
        "on(Lamp not on)",
    ],
)
def test_answers_are_read_and_written_alike(text):
    answer = parse_goals(text)
    lines = [f"avoid({one})" for one in answer.avoided]
    lines += [f"if({one})" for one, wanted in answer.conditions if wanted]
    assert "\n".join([*lines, *map(str, answer.wishes)]) == text


def test_on_a_place_is_where_and_on_alone_is_a_state():
    lamp, book = (wish.what for wish in parse_goals("off(Lamp on)\nhold(Book on Desk)").wishes)
    assert (lamp.states, lamp.places) == ((("on", True),), ())
    assert (book.states, book.places) == ((), (("Desk", True),))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("move(Apple)", "there is no move"),
        ("put(Apple)", "write put(Apple, Fridge)"),
        ("clean()", "write clean(Apple)"),
        ("put(Apple in, Fridge)", "after a name come states"),
        ("The apple.", "write one wish a line"),
        ("if(Egg)", "no wish in this answer"),
    ],
)
def test_line_outside_the_language_is_refused_with_the_right_form(text, reason):
    with pytest.raises(ProgramError, match=reason.replace("(", r"\(").replace(")", r"\)")):
        parse_goals(text)


def test_examples_of_the_prompt_are_of_the_language():
    for _, _, answer in EXAMPLES:
        assert admits(GRAMMAR.grammar, answer)
        parse_goals(answer)


@pytest.mark.parametrize("text", ["move(Apple)", "put(Apple)", "The apple.", "clean(Mug in)"])
def test_grammar_holds_models_to_the_language(text):
    assert not admits(GRAMMAR.grammar, text)


@given(st.text(max_size=300) | st.lists(st.sampled_from(["put(", "all ", "Mug", ")", ", ", "\n"])))
def test_any_text_is_read_or_refused(text):
    try:
        answer = parse_goals("".join(text))
    except ProgramError:
        return
    assert answer.wishes or answer.told or answer.end


@pytest.mark.parametrize(
    ("name", "types"),
    [
        ("Mug", ("Mug",)),
        ("mugs", ("Mug",)),
        ("knives", ("Knife",)),
        ("coffee table", ("CoffeeTable",)),
        ("Keys", ("KeyChain",)),
        ("Lamp", ("DeskLamp", "FloorLamp")),
        ("Spaceship", ()),
    ],
)
def test_names_that_people_use_mean_types(name, types):
    assert types_named(name) == types


# ----------------------------------------------------------------- the loop


def two_mugs():
    """The kitchen with a second mug, dirty, on the table, and a second apple in the fridge."""
    scene = kitchen()
    table = next(one for one in scene.objects if one.type == "DiningTable")
    fridge = next(one for one in scene.objects if one.type == "Fridge")
    return kitchen([
        on(table, "Mug", 1.9, -0.9, size=(0.1, 0.1, 0.1), is_dirty=True),
        on(fridge, "Apple", -1.6, -0.3, level=0.7, size=(0.1, 0.1, 0.1)),
    ])  # fmt: skip


@pytest.fixture
def talk(tmp_path):
    """A function that has requests carried out by scripted answers, and judges the last one."""

    def carried_out(answers, *requests, goals=(), **options):
        model = ScriptedModel(answers)
        agent, world = begun(
            tmp_path, model, room=two_mugs(), profile="goals", **{"seen_kept": 2, **options}
        )
        tracker = GoalTracker()
        tracker.start(world.last_event)
        step = world.step

        def watched(action, **given):
            event = step(action, **given)
            tracker.update(event)
            return event

        world.step = watched
        for words in requests:
            events = list(agent.do(SubTask(instruction=words)))
        assert isinstance(events[-1], Outcome)
        unmet = tracker.unmet([parse_goal(goal) for goal in goals], world.last_event)
        return events[-1], [str(goal) for goal in unmet], model, world

    return carried_out


@pytest.mark.parametrize(
    ("answer", "goals"),
    [
        ("put(Apple, Fridge)", ["ON(Apple, Fridge)"]),
        ("put(Egg, CounterTop)", ["ON(Egg, CounterTop)"]),
        ("clean(Plate)", ["STATE(Plate, cleaned)"]),
        ("slice(Bread)\nput(Bread, Plate)", ["STATE(Bread, sliced)", "ON(Bread, Plate)"]),
        ("heat(Potato)\nput(Potato, DiningTable)",
         ["STATE(Potato, heated)", "ON(Potato, DiningTable)"]),
        ("put(2 Mug, Cabinet)", ["2*ON(Mug, Cabinet)"]),
        ("put(all Apple, CounterTop)", ["2*ON(Apple, CounterTop)"]),
        ("trash(Tomato)", ["INSIDE(Tomato, GarbageCan)"]),
        ("coffee(Mug not dirty)", ["STATE(Mug, filled)", "TOGGLEON(CoffeeMachine)"]),
        ("open(Fridge)", ["OPEN(Fridge)"]),
        ("off(LightSwitch)", ["TOGGLEOFF(LightSwitch)"]),
        ("hold(Spoon)", ["HOLDON(robot, Spoon)"]),
    ],
)  # fmt: skip
def test_wishes_are_brought_about(talk, answer, goals):
    outcome, unmet, _, _ = talk([answer], "do as I say", goals=goals)
    assert unmet == []
    assert outcome.finished


def mugs(world):
    return [one for one in world.last_event.metadata["objects"] if one["objectType"] == "Mug"]


def place(one):
    return [parent.partition("|")[0] for parent in one["parentReceptacles"]]


def test_avoided_objects_are_left_alone(talk):
    _, _, _, world = talk(["avoid(Mug dirty)\nput(Mug, Cabinet)"], "a mug, not the dirty one")
    assert {one["isDirty"]: place(one) for one in mugs(world)} == {
        True: ["DiningTable"], False: ["Cabinet"]
    }  # fmt: skip


def test_descriptions_choose_among_objects_of_a_type(talk):
    _, _, _, world = talk(["put(Mug in DiningTable, Cabinet)"], "the mug on the table")
    assert {one["isDirty"]: place(one) for one in mugs(world)} == {
        True: ["Cabinet"], False: ["CounterTop"]
    }  # fmt: skip


@pytest.mark.parametrize(
    ("condition", "unmet"), [("Egg in Fridge", []), ("Egg in Cabinet", ["OPEN(Drawer): 1"]),
                             ("not Egg in Fridge", ["OPEN(Drawer): 1"])],
)  # fmt: skip
def test_conditions_are_looked_at_first(talk, condition, unmet):
    outcome, missing, _, _ = talk([f"if({condition})\nopen(Drawer)"], "if", goals=["OPEN(Drawer)"])
    assert missing == unmet
    assert outcome.end.kind == ("tell" if unmet else "done")


@pytest.mark.parametrize(
    ("question", "words"),
    [
        ("tell(all Apple)", ["2", "dining table", "fridge"]),
        ("tell(Fridge)", ["egg", "apple"]),
        ("tell(Spoon)", ["spoon", "drawer"]),
        ("tell(LightSwitch)", ["on"]),
        ("tell(Fork)", ["no fork"]),
    ],
)
def test_questions_are_answered_from_what_was_observed(talk, question, words):
    outcome, _, _, world = talk([question], "?")
    assert outcome.end.kind == "tell"
    assert [word for word in words if word not in outcome.end.text] == []
    fridge = next(o for o in world.last_event.metadata["objects"] if o["objectType"] == "Fridge")
    assert not fridge["isOpen"]


def test_names_that_mean_nothing_here_are_asked_about(talk):
    outcome, _, model, _ = talk(["put(Printer, Fridge)"] * 3, "put the printer in the fridge")
    assert outcome.end.kind == "ask"
    assert "Printer" in outcome.end.text
    assert "there is no Printer here" in model.prompts[1].changing


def test_missing_object_is_reported_not_replaced(talk):
    outcome, _unmet, _, _ = talk(["put(Fork, Fridge)"], "the fork", goals=["ON(Fork, Fridge)"])
    assert not outcome.finished
    assert outcome.end == End(kind="refuse", text="I found no fork.")


@pytest.mark.parametrize(
    ("answer", "fact"),
    [
        ("put(DiningTable, Fridge)", "a DiningTable cannot be picked up"),
        ("slice(Mug)", "a Mug cannot be sliced"),
        ("open(Apple)", "an Apple cannot be opened or closed"),
        ("clean(Apple on)", "an Apple is never on"),
    ],
)
def test_what_no_such_object_can_do_is_quoted_back_then_refused(talk, answer, fact):
    outcome, _, model, _ = talk([answer] * 3, "?")
    assert fact in model.prompts[1].changing
    assert outcome.end.kind == "refuse"
    assert fact[2:] in outcome.end.text


def test_users_words_and_memory_stand_in_the_prompt_and_examples_are_turns(talk):
    _, _, model, _ = talk(
        ["put(Apple, Fridge)", 'note("Fine.")'], "the apple: fridge!", "thank you so much"
    )
    assert "Request: the apple: fridge!" in model.prompts[0].changing
    assert "Apple" in model.prompts[1].changing.partition("Used last:")[2]
    assert model.prompts[0].turns == model.prompts[1].turns != ()
    assert model.prompts[0].stable == model.prompts[1].stable


def test_agent_in_goal_mode_writes_no_programs_for_a_plug_in(tmp_path):
    agent, _ = begun(tmp_path, ScriptedModel([]), profile="goals")
    with pytest.raises(KarmaError, match="--mode full"):
        list(agent.execute(SubTask(instruction="x"), lambda s: s.do(SubTask(instruction="x"))))
