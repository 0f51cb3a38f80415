"""What the planner is told: two profiles, one cut, short names for what is remembered."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.paths import GOLDEN

from karma.agent.planning.full_profile import fixture_names, in_names, short_names, skill_needs
from karma.agent.planning.program import OUR_SKILLS, SKILLS, parse_program
from karma.agent.planning.prompt import PROFILES, render
from karma.household.pieces import base_type
from karma.household.types import object_types
from karma.household.uses import with_wholes
from karma.types.memory import Area, Known, MemoryUnit
from karma.types.observation import SeenObject
from karma.types.planning import FailedProgram, Hint, Meaning, PlanRequest, WorkedExample

AREAS = (
    Area(name="node_1", position_m=(0.0, 0.9, 0.0), contains=("Chair", "CounterTop", "Fridge")),
    Area(name="node_2", position_m=(1.25, 0.9, -0.5), contains=("Floor",)),
)
GRAPH = "{name: node_1, type: Area, contains: [CounterTop, Fridge]}\nnode_1 <-> node_2\n"

each_profile = pytest.mark.parametrize("profile", PROFILES)


def unit(object_id, object_type, **rest):
    return MemoryUnit(
        object_id=object_id, object_type=object_type, position_m=(0.5, 0.9, -1.0), **rest
    )


OLD_APPLE = unit("Apple|1", "Apple", place_id="CounterTop|1")
MUG = unit("Mug|1", "Mug", states=("dirty", "used up"), place_id="Apple|1")
SLICE = unit(
    "Apple|2|AppleSliced_1", "AppleSliced", states=("cleaned", "sliced"),
    place_id="Fridge|1", handled=True,
)  # fmt: skip
FACTS = PlanRequest(
    instruction="Put the clean red fruit\n on the table!", areas=AREAS, graph_text=GRAPH,
    units=(OLD_APPLE, MUG, SLICE), held_id="Bread|1", held_type="BreadSliced",
    error="line 1: Fridge|+00.1|+00.2 is closed",
)  # fmt: skip


def parts(profile, facts):
    rendered = render(profile, facts)
    return rendered.prompt.stable, rendered.prompt.changing, rendered.names


# ----------------------------------------------------------------- both profiles


@each_profile
def test_stable_part_ends_in_a_newline_with_and_without_a_map(profile):
    for facts in (FACTS, PlanRequest(instruction="go")):
        stable, changing, _ = parts(profile, facts)
        assert stable.endswith("\n")
        assert changing.endswith("\n") or profile == "full"


UNITS = st.lists(
    st.builds(
        unit,
        st.integers(0, 30).map("Thing|{}".format),
        st.sampled_from(["Apple", "AppleSliced", "Mug", "EggCracked", "Knife"]),
        states=st.lists(st.sampled_from(["cleaned", "used up"]), unique=True).map(tuple),
        place_id=st.sampled_from([None, "hand", "Fridge|1", "Fridge|2", "Thing|3"]),
        handled=st.booleans(),
    ),
    max_size=10,
    unique_by=lambda one: one.object_id,
)


@each_profile
@given(units=UNITS, instruction=st.text(max_size=30), held=st.booleans(), error=st.text(max_size=9))
def test_stable_part_depends_on_the_map_only(profile, units, instruction, held, error):
    facts = PlanRequest(
        instruction=instruction, areas=AREAS, graph_text=GRAPH, units=units, error=error,
        held_id="Pan|1" if held else None, held_type="Pan" if held else None,
    )  # fmt: skip
    empty = PlanRequest(instruction="", areas=AREAS, graph_text=GRAPH)
    assert parts(profile, facts)[0] == parts(profile, empty)[0]


@each_profile
def test_filled_profile_equals_its_golden_text(profile):
    stable, changing, _ = parts(profile, FACTS)
    golden = (GOLDEN / f"prompt_{profile}.txt").read_text(encoding="utf-8")
    assert f"{stable}----- stable above, changing below\n{changing}" == golden


def test_full_profile_s_examples_are_programs():
    stable, _, _ = parts("full", FACTS)
    examples = stable.partition("# Examples\n")[2].partition("# Names")[0]
    assert len(parse_program(examples)) == 10
    for skill in (*SKILLS, *OUR_SKILLS):
        assert f"\n{skill.name}(robot" in stable


def test_worked_examples_are_turns_of_the_full_prompt():
    example = WorkedExample(instruction="tidy up", program="GoToObject(robot, 'Pen')")
    plain = render("full", FACTS).prompt
    prompt = render("full", replace(FACTS, examples=(example,))).prompt
    asked = "# Instruction: tidy up\n# Program (skill calls only)\n"
    assert prompt == replace(plain, turns=((asked, example.program),))
    assert prompt.before == f"{plain.stable}{asked}{example.program}\n"


# ----------------------------------------------------------------- short names


@given(units=UNITS)
def test_short_names_are_unique_and_reach_every_unit(units):
    names = short_names(units, None)
    ids = list(names.values())
    assert len(ids) == len(set(ids))
    for one in units:
        (name,) = [name for name, object_id in names.items() if object_id == one.object_id]
        assert name.split("_")[0] == base_type(one.object_type)


# ----------------------------------------------------------------- the full profile


def fixture(object_id, x):
    return Known(
        object_id=object_id, object_type=object_id.partition("|")[0], position_m=(x, 1.0, -0.04)
    )


FURNISHED = (
    Area(
        name="node_1", position_m=(0.0, 0.9, 0.0), adjacent=("node_2",),
        contains=("Cabinet", "Faucet", "Floor", "Fridge", "StoveBurner"),
        fixtures=(fixture("Cabinet|1", 1.0), fixture("Cabinet|2", 1.5), fixture("Faucet|1", 0.2),
                  fixture("Floor|1", 0.0), fixture("Fridge|1", -1.0), fixture("StoveBurner|1", 2)),
    ),
    Area(
        name="node_2", position_m=(1.0, 0.9, 0.0), adjacent=("node_1",), contains=("Cabinet",),
        fixtures=(fixture("Cabinet|0", 2.0),),
    ),
)  # fmt: skip


def seen(object_id, place, object_type=""):
    return SeenObject(
        object_id=object_id, object_type=object_type or object_id.partition("|")[0],
        position_m=(0.0, 0.9, 0.0), box_center_m=(0.0, 0.9, 0.0), box_size_m=(0.1, 0.1, 0.1),
        pickupable=True, parent_ids=(place,),
    )  # fmt: skip


def test_map_says_each_thing_once_with_its_place():
    stable, _, names = parts("full", PlanRequest(instruction="go", areas=FURNISHED))
    map_ = stable.partition("# Long-term memory")[2].splitlines()[1:]
    assert map_ == [
        "node_1 (0.0,0.0) node_2: Cabinet_1(1.0,1.0,0.0), Cabinet_2(1.5,1.0,0.0), "
        "Fridge(-1.0,1.0,0.0), Faucet, StoveBurner",
        "node_2 (1.0,0.0) node_1: Cabinet_3(2.0,1.0,0.0)",
    ]
    assert names["Cabinet_3"] == "Cabinet|0"
    assert "Cabinet" not in names  # any of them


@pytest.mark.parametrize(
    ("there", "told"),
    [
        (("Sink", "SinkBasin"), "Sink|1"),
        (("SinkBasin", "StoveKnob"), "SinkBasin|1"),
        (("Floor", "SinkBasin"), "SinkBasin|1"),
    ],
)
def test_basin_is_told_as_a_sink_where_its_sink_is_not(there, told):
    fixtures = tuple(fixture(f"{kind}|1", 1.0) for kind in there)
    contains = tuple(sorted(with_wholes(there)))
    area = Area(name="node_1", position_m=(0, 0, 0), contains=contains, fixtures=fixtures)
    facts = PlanRequest(instruction="go", areas=(area,))
    stable, _, names = parts("full", facts)
    assert stable.endswith("node_1 (0.0,0.0) : Sink(1.0,1.0,0.0)\n")
    assert names["Sink"] == told
    assert parts("compact", facts)[0].endswith("node_1 Sink\n")


def test_things_in_sight_have_names_after_those_of_memory_by_what_they_lie_on():
    facts = PlanRequest(
        instruction="go", areas=FURNISHED, units=(unit("Plate|1", "Plate", place_id="Cabinet|0"),),
        seen=(seen("Plate|1", "Cabinet|0"), seen("Plate|2", "Cabinet|2"), seen("Mug|1", "Fridge|1"),
              seen("Egg|1|EggCracked", "Cabinet|2", "EggCracked"),
              seen("Egg|1|EggCracked_1", "Cabinet|2", "EggCracked")),
    )  # fmt: skip
    _, changing, names = parts("full", facts)
    assert "Plate: Cabinet_3 (0.5,0.9,-1.0)\n" in changing
    assert (
        "# Also seen here, where it was last seen\nCabinet_2: Plate_2, Egg\nFridge: Mug\n"
        in changing
    )
    assert (names["Plate"], names["Plate_2"]) == ("Plate|1", "Plate|2")
    assert parts("compact", facts)[2].keys() == {"Plate", "Cabinet"}


def test_slices_that_lie_elsewhere_than_the_one_in_the_hand_have_names_of_their_own():
    slices = [f"Bread|1|BreadSliced_{n}" for n in range(4)]
    places = ("Plate|1", "Plate|1", "Fridge|1", "Fridge|1")
    facts = PlanRequest(
        instruction="go", areas=FURNISHED, held_id=slices[0], held_type="BreadSliced",
        seen=[seen(one, place, "BreadSliced") for one, place in zip(slices, places, strict=True)],
    )  # fmt: skip
    _, changing, names = parts("full", facts)
    assert "Plate: Bread_2\nFridge: Bread_3\n" in changing
    assert [names[name] for name in ("Bread", "Bread_2", "Bread_3")] == slices[:3]


KINDS = st.sampled_from(["Cabinet", "Drawer", "Fridge", "Sink", "SinkBasin", "Faucet"])


@given(st.lists(st.lists(st.tuples(KINDS, st.booleans()), max_size=5), min_size=1, max_size=4))
def test_furniture_keeps_its_name_while_more_of_it_is_found(found):
    """Map and sight grow; names that were told go on meaning the same things."""
    names, mapped, sighted = {}, [], []
    for number, more in enumerate(found):
        for place, (kind, on_map) in enumerate(more):
            object_id = f"{kind}|{number}|{place}"
            mapped += [fixture(object_id, 1.0)] if on_map else []
            sighted += [] if on_map else [replace(seen(object_id, None, kind), pickupable=False)]
        area = Area(name="node_1", position_m=(0, 0, 0), fixtures=tuple(mapped))
        before, names = names, fixture_names([area], sighted, before=names)
        assert before.items() <= names.items()
        assert len(set(names.values())) == len(names)


@given(units=UNITS, count=st.integers(0, 4), mapped=st.booleans())
def test_names_of_the_full_profile_are_unique_and_reach_all_that_is_told(units, count, mapped):
    things = [seen(f"Mug|{n}", "Fridge|1") for n in range(count)]
    facts = PlanRequest(
        instruction="go", areas=FURNISHED if mapped else (), units=units, seen=things
    )
    _, changing, names = parts("full", facts)
    assert len(set(names.values())) == len(names)
    told = {one.object_id for one in units} | {one.object_id for one in things}
    assert told <= set(names.values())
    assert "|" not in changing


def test_last_program_stands_whole_and_earlier_ones_as_a_line():
    ran = FailedProgram(
        lines=("GoToObject(robot, 'Cabinet|2')", "OpenObject(robot, 'Fridge|1')", "Go(robot)"),
        failed=1, reason="Fridge|1 is stuck", ran=True,
    )  # fmt: skip
    read = FailedProgram(lines=("Sure!", "Go(robot)"), failed=1, reason="there is no skill Go")
    facts = PlanRequest(instruction="go", areas=FURNISHED, failures=(read, read, ran))
    changing = parts("full", facts)[1]
    assert (
        "# Failed before\nGo(robot): there is no skill Go\n# Your last program failed\n"
        "GoToObject(robot, 'Cabinet_2')  # done\n"
        "OpenObject(robot, 'Fridge')  # FAILED: Fridge is stuck\nGo(robot)  # not run\n"
    ) in changing


def test_skills_say_what_the_table_of_types_says():
    put = skill_needs()["PutObject"]
    for kind in object_types().values():
        shut = kind.must_be_open and not kind.can("pickupable")
        only = f"{kind.name} {kind.accepts_only[0]}" in put if kind.accepts_only else False
        assert shut == (kind.name in put.partition("These take")[0]), kind.name
        assert only or not kind.accepts_only or kind.accepts_only[0] in kind.name
    cut = skill_needs()["SliceObject"]
    assert [
        one for one in object_types() if object_types()[one].can("sliceable") and one not in cut
    ] == []


def test_ids_in_a_text_become_names_or_types():
    names = {"Sink|+1.0|+0.9|-2.0": "Sink", "Apple|1|2|3": "Apple_2"}
    text = "Apple|1|2|3: put it into Sink|+1.0|+0.9|-2.0|SinkBasin. Not Mug|4|5|6, 'Apple|9|9|9'"
    assert in_names(text, names) == "Apple_2: put it into Sink. Not Mug, 'Apple'"


# ----------------------------------------------------------------- what words may mean

HINTS = (
    Hint(phrase="beaker", meanings=(
        Meaning(name="Cup", similarity=0.812), Meaning(name="Mug", similarity=0.7))),
    Hint(phrase="nuke", meanings=(Meaning(name="heat", similarity=0.64),)),
)  # fmt: skip


def test_hints_stand_behind_the_task_in_the_compact_profile():
    _, changing, _ = parts("compact", PlanRequest(instruction="Nuke the beaker", hints=HINTS))
    task, words = changing.splitlines()[:2]
    assert (task, words) == ("#task nuke the beaker", "#words beaker: Cup 8 Mug 7; nuke: heat 6")


def test_hints_stand_before_the_instruction_in_the_full_profile():
    _, changing, _ = parts("full", PlanRequest(instruction="Nuke the beaker", hints=HINTS))
    assert changing.splitlines()[-4:-1] == [
        '# "beaker" may mean Cup (0.8), Mug (0.7)',
        '# "nuke" may mean heat (0.6)',
        "# Instruction: Nuke the beaker",
    ]
