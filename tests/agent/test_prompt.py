"""What the planner is told: two profiles, one cut, short names for what is remembered."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.paths import GOLDEN

from karma.agent.program import EMPTY_OBJECT, SKILLS, parse_program
from karma.agent.prompt import PROFILES, render
from karma.agent.short_names import short_names
from karma.contracts import Area, MemoryUnit, PlanRequest
from karma.errors import UnknownNameError
from karma.household.pieces import base_type
from karma.household.places import landmark_types

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


@each_profile
def test_prompt_says_states_places_hand_and_error(profile):
    _, changing, names = parts(profile, FACTS)
    for word in ("Apple_2", "Mug", "Fridge", "cleaned", "sliced", "Bread", "is closed"):
        assert word in changing
    assert names["Bread"] == "Bread|1"


def test_compact_profile_leaves_out_what_no_program_names():
    stable, changing, _ = parts("compact", FACTS)
    assert stable == "#areas\nnode_1 CounterTop Fridge\nnode_2\n"
    assert "#task put the clean red fruit on the table\n" in changing
    assert "|" not in changing  # ids cost many tokens and mean nothing


def test_compact_profile_without_map_says_unknown():
    assert parts("compact", PlanRequest(instruction="go"))[0] == "#areas\nunknown\n"


def test_full_profile_s_examples_are_programs():
    stable, _, _ = parts("full", FACTS)
    examples = stable.partition("# Examples\n")[2].partition("# Names")[0]
    assert len(parse_program(examples)) == 10
    for skill in (*SKILLS, EMPTY_OBJECT):
        assert f"def {skill.name}(robot" in stable


def test_render_of_an_unknown_profile_names_the_known_ones():
    with pytest.raises(UnknownNameError, match=r"'terse'.*compact.*full"):
        render("terse", FACTS)


# ----------------------------------------------------------------- short names


def test_short_names_give_the_newest_the_bare_type():
    names = short_names((OLD_APPLE, MUG, SLICE), None)
    assert names["Apple"] == "Apple|2|AppleSliced_1"
    assert names["Apple_2"] == "Apple|1"
    assert names["Mug"] == "Mug|1"


def test_short_names_cover_places_once_and_never_the_hand():
    names = short_names((OLD_APPLE, MUG, SLICE), None)
    assert names["Fridge"] == "Fridge|1"
    assert names["CounterTop"] == "CounterTop|1"
    assert list(names.values()).count("Apple|1") == 1  # a thing, and the mug's place
    assert "hand" not in short_names((unit("Mug|1", "Mug", place_id="hand"),), None).values()


def test_short_names_of_two_places_follow_the_last_use():
    units = (
        unit("Mug|1", "Mug", place_id="Cabinet|1"),
        unit("Cup|1", "Cup", place_id="Cabinet|2"),
    )
    names = short_names(units, None)
    assert (names["Cabinet"], names["Cabinet_2"]) == ("Cabinet|2", "Cabinet|1")


def test_short_names_give_what_is_held_the_bare_type():
    names = short_names((OLD_APPLE, SLICE), ("Apple|1", "Apple"))
    assert names["Apple"] == "Apple|1"
    assert names["Apple_2"] == "Apple|2|AppleSliced_1"


def test_short_names_of_a_part_s_place_name_the_part():
    sink = "Sink|+00.1|+00.9|+01.1|SinkBasin"
    names = short_names((unit("Mug|1", "Mug", place_id=sink),), None)
    assert names["SinkBasin"] == sink


@given(units=UNITS)
def test_short_names_are_unique_and_reach_every_unit(units):
    names = short_names(units, None)
    ids = list(names.values())
    assert len(ids) == len(set(ids))
    for one in units:
        (name,) = [name for name, object_id in names.items() if object_id == one.object_id]
        assert name.split("_")[0] == base_type(one.object_type)


def test_landmarks_cannot_be_carried_and_skip_the_floor():
    assert {"Fridge", "CounterTop", "LightSwitch"} <= landmark_types()
    assert not {"Floor", "Chair", "Plate", "Apple"} & landmark_types()
