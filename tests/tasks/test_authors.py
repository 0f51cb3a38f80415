"""The loader for the authors' loose form, on tasks of our own making and on the authors'."""

import gzip
import json

import pytest

from karma.agent.prompt import render
from karma.contracts import PlanRequest
from karma.errors import FileError
from karma.household.types import object_types
from karma.tasks.authors import load_authors_tasks, read_goals, resolve
from karma.tasks.clauses import clauses_of
from karma.tasks.goals import object_names, parse_goal
from karma.tasks.loose_names import key_of, tiers_of
from karma.tasks.splitting import assign

KITCHEN = [
    "Apple", "Bread", "ButterKnife", "Cabinet", "CounterTop", "Cup", "Drawer", "Egg", "Faucet",
    "Fork", "Fridge", "GarbageCan", "Knife", "Lettuce", "Microwave", "Mug", "Pan", "Plate", "Pot",
    "Potato", "Shelf", "Sink", "SinkBasin", "StoveBurner", "StoveKnob", "Tomato",
]  # fmt: skip
LIVING = [
    "Book", "CellPhone", "Cloth", "CoffeeTable", "DeskLamp", "FloorLamp", "Laptop", "SideTable",
    "SoapBar", "Sofa",
]  # fmt: skip


def load(tmp_path, conditions, instruction, *, title="ComplexTasks"):
    row = {"FloorPlan": 7, "ID": 2, "Goal Condition": conditions, "Instruction": instruction}
    path = tmp_path / "tasks.json"
    path.write_text(json.dumps({title: [row]}))
    (task,) = load_authors_tasks([path])
    return task


def due(task):
    return [[str(goal).removesuffix(": 1") for goal in sub.goals] for sub in task.subtasks]


# ----------------------------------------------------------------- clauses


def test_every_clause_knows_the_whole_request_with_its_commas(tmp_path):
    said = "Rinse a cup,  then put it on the table;\nbring me a fork, please."
    task = resolve(load(tmp_path, "STATE(cup, clean), HOLDON(robot, fork)", said), KITCHEN)
    assert [sub.instruction for sub in task.subtasks] == [
        "Rinse a cup", "put it on the table", "bring me a fork",
    ]  # fmt: skip
    assert {sub.whole for sub in task.subtasks} == {
        "Rinse a cup, then put it on the table; bring me a fork, please."
    }


@pytest.mark.shared
def test_every_clause_of_the_authors_has_the_whole_request_in_its_prompt(shared):
    tasks = load_authors_tasks(sorted((shared / "data" / "alfred_l").glob("*.json")))
    subtasks = [sub for task in tasks for sub in task.subtasks]
    assert len(subtasks) > 80
    for sub in subtasks:
        request = PlanRequest(instruction=sub.instruction, whole=sub.whole)
        asked = render("full", request).prompt.changing
        assert f"# The user's whole request: {sub.whole}\n" in asked
        assert sub.instruction.split(",")[0] in sub.whole


@pytest.mark.parametrize(
    ("text", "clauses"),
    [
        ("Rinse a cup, yodel.", ["Rinse a cup, yodel"]),  # "yodel" is no verb it knows
        ("Rinse a cup, yodel the fork", ["Rinse a cup", "yodel the fork"]),  # now a verb
        ("Put the remote, watch and book on the sofa",
         ["Put the remote, watch and book on the sofa"]),  # "watch" is a thing here
        ("1. Rinse a cup\n2. Light the candle", ["Rinse a cup", "Light the candle"]),
        ("rinse a cup, and then fill it.", ["rinse a cup", "fill it"]),
        ("Take a fork, a spoon and a mug, put them in the sink. Then open the fridge!",
         ["Take a fork, a spoon and a mug", "put them in the sink", "open the fridge"]),
        ("In the kitchen, wash a pear", ["In the kitchen, wash a pear"]),
        ("Turn on the tap → turn the tap off", ["Turn on the tap", "turn the tap off"]),
        ("Hello there", ["Hello there"]),
    ],
)  # fmt: skip
def test_clauses_of_a_task_are_cut_where_a_verb_begins(text, clauses):
    assert list(clauses_of(text)) == clauses


def assigned(texts, clauses):
    return [[str(g)[:-3] for g in sub.goals] for sub in assign([*map(parse_goal, texts)], clauses)]


def test_assign_gives_washing_goals_to_the_clause_that_washes():
    wash = ["INSIDE(egg, sink)", "TOGGLEON(faucet)", "STATE(egg, cleaned)"]
    clauses = ["rinse an egg", "put the clean egg into the fridge"]
    assert assigned([*wash, "INSIDE(egg, fridge)"], clauses) == [wash, ["INSIDE(egg, fridge)"]]


def test_assign_keeps_repeated_goals_with_their_own_clauses():
    texts = ["STATE(cup, cleaned)", "TOGGLEON(faucet)", "STATE(fork, cleaned)", "TOGGLEON(faucet)"]
    assert assigned(texts, ["wash a cup", "wash a fork"]) == [texts[:2], texts[2:]]


def test_goals_that_no_words_ask_for_are_apart_by_name(tmp_path):
    said = "Put the mug in the cabinet, wash the apple"
    task = resolve(load(tmp_path, "INSIDE(mug, fridge), STATE(apple, clean)", said), KITCHEN)
    assert due(task) == [[], ["STATE(Apple, clean)"]]
    assert task.notes == ("unasked INSIDE(mug, fridge): no words ask for it",)


def test_assign_puts_two_places_of_one_thing_into_two_clauses():
    texts = ["ON(mug, table)", "INSIDE(mug, cupboard)"]
    assert assigned(texts, ["set the mug on the table", "return it"]) == [texts[:1], texts[1:]]
    both = ("set the mug on the table and put it in the cupboard",)
    assert assigned(texts, both) == [texts[:1], texts[1:]]


def test_assign_gives_a_goal_that_fits_nowhere_to_the_last_clause():
    assert assigned(["TOGGLEON(tv)"], ["wash a cup", "slice an egg"]) == [[], ["TOGGLEON(tv)"]]


def test_assign_prefers_the_clause_that_names_the_place():
    texts = ["INSIDE(bread, fridge)", "INSIDE(bread, trash)", "INSIDE(pot, fridge)"]
    clauses = [
        "store the bread in the fridge",
        "throw the food in the bin",
        "move the container to the fridge",
    ]
    assert assigned(texts, clauses) == [[text] for text in texts]


def test_names_are_known_in_singular_and_plural_and_split_words():
    assert key_of("Tomatoes") == key_of("tomato") and key_of("knives") == key_of("knife")
    assert tiers_of("counter top") == tiers_of("CounterTops") == (("CounterTop",),)
    assert tiers_of("spaceship") == ()


# ----------------------------------------------------------------- loading and resolving


def test_task_keeps_kind_id_and_scene(tmp_path):
    task = load(tmp_path, "ON(cup, shelf): 1", "Put a cup on the shelf", title="SimpleTasks")
    assert (task.id, task.kind, task.scene.name) == ("simple-2", "simple", "FloorPlan7")


def test_read_goals_notes_what_is_no_goal():
    goals, notes = read_goals("ON(a, b): 1, wash it, FEED(a, b): 1, STATE(a): 1, OPEN(c)")
    assert [str(goal) for goal in goals] == ["ON(a, b): 1", "OPEN(c): 1"]
    assert notes == (
        "unresolved FEED(a, b): unknown predicate",
        "unresolved STATE(a): STATE takes 2 argument(s)",
        "unresolved wash it: not a goal",
    )


def test_resolve_turns_loose_names_into_types(tmp_path):
    task = load(
        tmp_path,
        "INSIDE(bread slices, refrigerator): 1, INSIDE(eggs, trash), switchon(tap): 1, "
        "ON(knife, counter): 1, HOLDON(robot, frying pan): 1",
        "put the bread slices in the refrigerator, throw the eggs in the trash, turn on the tap, "
        "lay a knife on the counter, get a frying pan",
    )
    done = resolve(task, KITCHEN)
    assert due(done) == [
        ["2*INSIDE(BreadSliced, Fridge)"],
        ["INSIDE(Egg, GarbageCan)"],
        ["TOGGLEON(Faucet)"],
        ["ON(Knife/ButterKnife, CounterTop)"],
        ["HOLDON(robot, Pan)"],
    ]
    assert done.notes == (
        "read INSIDE(bread slices, refrigerator) as 2*INSIDE(BreadSliced, Fridge)",
        "read INSIDE(eggs, trash) as INSIDE(Egg, GarbageCan)",
    )


def test_resolve_narrows_to_what_the_scene_holds(tmp_path):
    task = load(tmp_path, "TOGGLEON(lamp), ON(book, table)", "turn on the lamp, lay down the book")
    assert due(resolve(task, LIVING)) == [
        ["TOGGLEON(DeskLamp/FloorLamp)"],
        ["ON(Book, SideTable/CoffeeTable)"],
    ]
    only = resolve(task, ["FloorLamp", "Book", "CounterTop"])
    assert due(only) == [["TOGGLEON(FloorLamp)"], ["ON(Book, CounterTop)"]]
    assert only.notes == ("read ON(book, table) as ON(Book, CounterTop)",)


@pytest.mark.parametrize(
    ("condition", "read"),
    [
        ("STATE(book, sofa)", "ON(Book, Sofa)"),
        ("ON(lamp, phone)", "HOLDON(robot, CellPhone)"),
        ("ON(soap, cloth)", "ON(SoapBar, Cloth)"),
        ("ON(phone,(1.5, -0.25,2))", "ON(CellPhone, (1.5, -0.25, 2))"),
        ("STATE(phone, off)", "STATE(CellPhone, off)"),
    ],
)
def test_resolve_reads_odd_goals_in_their_likely_sense(tmp_path, condition, read):
    task = resolve(load(tmp_path, condition, "do something with it"), LIVING)
    assert due(task) == [[read]]


def test_resolve_reads_cooking_what_cannot_be_cooked_as_heating(tmp_path):
    done = resolve(load(tmp_path, "STATE(apple, cooked)", "cook an apple"), KITCHEN)
    assert due(done) == [["STATE(Apple, heated)"]]
    assert done.notes == ("read STATE(apple, cooked) as STATE(Apple, heated)",)
    assert due(resolve(load(tmp_path, "STATE(bread, cooked)", "toast it"), KITCHEN)) == [
        ["STATE(Bread, cooked)"]
    ]


@pytest.mark.parametrize(
    ("condition", "reason"),
    [
        ("ON(unicorn, sofa)", "no object type is called 'unicorn'"),
        ("ON(vase, sofa)", "the scene has no Vase"),
        ("ON(sofa, table)", "Sofa is not pickupable"),
        ("STATE(sofa, clean)", "Sofa is never clean"),
        ("STATE(book, hot and sticky)", "is neither a state nor an object"),
        ("STATE(sofa, sliced)", "Sofa is not sliceable"),
        ("STATE(book, mauve)", "'mauve' is neither a state nor an object"),
        ("INSIDE(soap, sofa)", "AI2-THOR lets no SoapBar into Sofa"),
        ("ON(phone, (1, 2))", "is no position"),
    ],
)
def test_resolve_names_what_it_cannot_resolve_and_why(tmp_path, condition, reason):
    done = resolve(load(tmp_path, condition, "do it"), LIVING)
    assert due(done) == [[]]
    assert done.notes[0].startswith(f"unresolved {condition}: ") and reason in done.notes[0]


def test_resolve_keeps_two_places_that_one_clause_asks_for_in_turn(tmp_path):
    task = load(tmp_path, "ON(book, sofa), ON(book, table)", "Tidy up the book")
    done = resolve(task, LIVING)
    assert due(done) == [["ON(Book, Sofa)", "ON(Book, SideTable/CoffeeTable)"]]
    assert [str(goal) for goal in done.subtasks[0].passing] == ["ON(Book, Sofa): 1"]
    assert done.notes == ()


@pytest.mark.parametrize(
    ("condition", "read"),
    [
        ("ON(laptop, lamp)", "ON(Laptop, DeskLamp/FloorLamp)"),  # beside it
        ("INSIDE(cup, tap)", "INSIDE(Cup, Sink)"),
        ("INSIDE(bread, toaster)", "INSIDE(Bread, Toaster)"),  # its slices
        ("ON(egg, stove)", "ON(Egg, StoveBurner)"),  # in a pan
        ("STATE(egg, fried)", "STATE(Egg, cooked)"),
        ("SLICED(apple)", "STATE(Apple, sliced)"),
        ("HOLD(mug)", "HOLDON(robot, Mug)"),
        ("STATE(bottle, filled)", "STATE(WineBottle, filled)"),
        ("INSIDE(soap, sink)", "INSIDE(SoapBottle, Sink)"),
        ("ON(salad, plate)", "ON(Lettuce, Plate)"),
        ("ON(dirty red apple, stove_burner)", "ON(Apple, StoveBurner)"),
        ("INSIDE(cup of tea, left cabinet 2)", "INSIDE(Cup, Cabinet)"),
    ],
)
def test_resolve_keeps_what_can_be_done(tmp_path, condition, read):
    here = [*KITCHEN, "DeskLamp", "FloorLamp", "Laptop", "Toaster", "WineBottle", "SoapBottle"]
    assert due(resolve(load(tmp_path, condition, "do it"), here)) == [[read]]


@pytest.mark.parametrize(
    ("condition", "instruction", "read"),
    [
        ("INSIDE(two apples, sink)", "rinse the apples", "2*INSIDE(Apple, Sink)"),
        ("STATE(apples, sliced)", "Slice three apples", "3*STATE(Apple, sliced)"),
        ("ON(apples, plate)", "Get two apples, put the apples on a plate", "2*ON(Apple, Plate)"),
        ("ON(apples, plate)", "Put the apples on a plate", "2*ON(Apple, Plate)"),
        ("ON(apple, plate)", "Put one of the two apples on a plate", "ON(Apple, Plate)"),
        ("STATE(eggs, sliced)", "Slice four eggs", "STATE(Egg, sliced)"),  # there is one
        ("2*ON(bread slices, plate)", "Put bread on a plate", "2*ON(BreadSliced, Plate)"),
        ("HOLDON(robot, apples)", "Get two apples", "HOLDON(robot, Apple)"),
    ],
)
def test_resolve_counts_what_is_spoken_of_as_several(tmp_path, condition, instruction, read):
    task = resolve(load(tmp_path, condition, instruction), [*KITCHEN, "Apple", "Apple"])
    assert [text for texts in due(task) for text in texts] == [read]


def test_load_authors_tasks_of_another_form_is_refused(tmp_path):
    with pytest.raises(FileError, match="EasyTasks"):
        load(tmp_path, "ON(a, b)", "put a on b", title="EasyTasks")
    (tmp_path / "tasks.json").write_text('{"SimpleTasks": [{"ID": 1}]}')
    with pytest.raises(FileError, match="FloorPlan"):
        load_authors_tasks([tmp_path / "tasks.json"])


@pytest.mark.shared
def test_every_goal_of_the_authors_is_resolved_or_named(shared):
    present = {}
    with gzip.open(shared / "data" / "thor5" / "scenes.jsonl.gz", "rt") as lines:
        for room in map(json.loads, lines):
            present[room["scene"]] = [thing["objectType"] for thing in room["objects"]]
    total = resolved = 0
    for task in load_authors_tasks(sorted((shared / "data" / "alfred_l").glob("*.json"))):
        if task.scene.name not in present:
            continue
        done = resolve(task, present[task.scene.name])
        goals = [goal for sub in task.subtasks for goal in sub.goals]
        kept = [goal for sub in done.subtasks for goal in sub.goals]
        named = [note for note in done.notes if note.startswith(("unresolved ", "unasked "))]
        assert len(kept) + len(named) == len(goals) + len(task.notes), task.id
        types = {part for g in kept for name in object_names(g) for part in name.split("/")}
        assert types <= set(object_types())
        total, resolved = total + len(goals), resolved + len(kept)
    assert resolved >= 0.85 * total > 0
