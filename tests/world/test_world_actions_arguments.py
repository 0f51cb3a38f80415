"""What may be said with an action: what fits, what is misuse, what is left out; and any junk."""

import inspect
import math
import random
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.household import find, kitchen
from support.paths import ROOT
from support.random_steps import random_step

from karma.world.actions.table import ACTIONS, LEFT_OUT
from karma.world.core.scene import SCENES as SHIPPED
from karma.world.sim import MISUSE, EmbeddedWorld

PAGE = ROOT / "docs" / "world" / "actions.md"
ROOM = kitchen()
IDS = [thing.id for thing in ROOM.objects]
SCENES = sorted(path.stem for path in SHIPPED.glob("*.json"))


@pytest.fixture
def world():
    return EmbeddedWorld(ROOM)


# ----------------------------------------------------------------- what fits


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e39, 10**40])
@pytest.mark.parametrize(
    ("action", "arguments"),
    [
        ("MoveAhead", lambda v: {"moveMagnitude": v}),
        ("LookDown", lambda v: {"degrees": v}),
        ("Teleport", lambda v: {"position": {"x": v, "y": 0.9, "z": 0.0}}),
        ("Teleport", lambda v: {"rotation": v}),
        ("GetInteractablePoses", lambda v: {"objectId": IDS[0], "horizons": [0.0, v]}),
        ("GetInteractablePoses", lambda v: {"objectId": IDS[0], "positions": [{"x": v}]}),
        ("SetRandomSeed", lambda v: {"seed": v}),
        ("Initialize", lambda v: {"gridSize": v}),
        ("AddThirdPartyCamera", lambda v: {"position": {"y": v}, "rotation": {}}),
    ],
)
def test_number_that_is_none_is_misuse_everywhere(world, action, arguments, bad):
    before = world.state
    with pytest.raises(ValueError, match=f"action: {action} has an invalid argument"):
        world.step(action, **arguments(bad))
    assert world.last_event.metadata["errorCode"] == "InvalidArgument"
    assert world.state is before


@pytest.mark.parametrize(
    ("action", "arguments", "wanted"),
    [
        ("MoveAhead", {"moveMagnitude": "far"}, "float"),
        ("MoveAhead", {"moveMagnitude": True}, "float"),
        ("MoveAhead", {"forceAction": 1}, "bool"),
        ("ChangeResolution", {"x": 300.5, "y": 300}, "int"),
        ("ChangeResolution", {"x": 2**31, "y": 300}, "int"),
        ("PickupObject", {"objectId": 3}, "str"),
        ("LookUp", {"degrees": [30]}, "float"),
        ("PickupObject", {"objectId": object()}, "str"),
        ("AddThirdPartyCamera", {"position": {}, "fieldOfView": {"x": 0}, "rotation": {}}, "float"),
    ],
)
def test_number_or_text_of_the_wrong_kind_is_misuse(world, action, arguments, wanted):
    with pytest.raises(ValueError, match=f"Cannot convert to: {wanted}"):
        world.step(action, **arguments)


def _nested(depth):
    return [_nested(depth - 1)] if depth else []


@pytest.mark.parametrize(
    ("junk", "said"),
    [
        (_nested(900), "lists more than 8 deep"),
        (10**5000, "a number of too many digits"),
        ("half a \ud83d", "half a .ud83d"),
        ({"\ud83d": 1}, "ud83d"),
        ({"x": {1, 2}}, "set"),
    ],
    ids=["deep", "long", "half", "half key", "set"],
)
@pytest.mark.parametrize("action", ["PickupObject", "GetInteractablePoses"])
def test_what_no_message_can_hold_is_misuse(world, action, junk, said):
    before = world.state
    with pytest.raises(ValueError, match=f"objectId .==.*{said}"):
        world.step(action, objectId=junk)
    assert world.last_event.metadata["errorCode"] == "InvalidArgument"
    assert world.state is before


@pytest.mark.parametrize("agent", [1, 7, -1, "robot2", "0", True, 0.5])
def test_action_of_an_agent_that_is_not_there_is_misuse(world, agent):
    before = world.state
    with pytest.raises(ValueError, match=f"agentId {agent!r}: this world has one agent, 0"):
        world.step("MoveAhead", agentId=agent)
    assert world.state is before


@pytest.mark.parametrize("agent", [0, None])
def test_the_one_agent_may_be_named(world, agent):
    assert world.step("RotateRight", agentId=agent)


def test_step_without_an_action_is_misuse(world):
    with pytest.raises(ValueError, match="Invalid action: None"):
        world.step({"objectId": IDS[0]})


@pytest.mark.parametrize(
    ("action", "arguments"),
    [
        ("Teleport", {"position": 3}),
        ("AddThirdPartyCamera", {"position": 5, "rotation": {}}),
        ("Teleport", {"position": {"x": "north"}}),
        ("SetObjectFilter", {"objectIds": "Apple"}),
        ("SetObjectFilter", {"objectIds": [3]}),
        ("GetInteractablePoses", {"objectId": IDS[0], "standings": [1]}),
    ],
)
def test_vector_or_list_of_the_wrong_form_fails(world, action, arguments):
    before = world.state
    event = world.step(action, **arguments)
    assert event.code == "UnhandledException"
    assert event.message.startswith("JsonSerializationException")
    assert world.state is before


def test_numbers_of_numpy_are_numbers(world):
    assert world.step("MoveAhead", moveMagnitude=np.float32(0.25))
    assert world.step("Teleport", x=np.float64(0.5), rotation=np.int64(90))
    assert world.step("Teleport", position={"x": np.float32(0.0), "z": np.float64(0.25)})
    poses = world.step(
        "GetInteractablePoses", objectId=find(world, "Apple"), rotations=np.array([0, 90])
    )
    assert {pose["rotation"] for pose in poses.metadata["actionReturn"]} <= {0.0, 90.0}


def test_whole_float_is_an_int_and_an_int_a_float(world):
    assert world.step("ChangeResolution", x=400.0, y=300)
    assert world.step("RotateRight", degrees=90)


def test_argument_that_is_none_counts_as_left_out(world):
    assert world.step("MoveAhead", moveMagnitude=None)
    with pytest.raises(ValueError, match="missing the following arguments: seed"):
        world.step("SetRandomSeed", seed=None)


# ----------------------------------------------------------------- what is left out


@pytest.mark.parametrize("name", sorted(LEFT_OUT))
def test_absent_action_is_refused_by_name_whatever_is_said(world, name):
    before = world.state
    event = world.step(name, objectId="x", position={"x": 1})
    assert event.message == f"{name} is not part of the embedded world: {LEFT_OUT[name]}."
    assert event.code not in MISUSE
    assert world.state is before


# ----------------------------------------------------------------- the page


def written(parameter):
    if parameter.default is inspect.Parameter.empty:
        return f"**{parameter.name}**"
    return parameter.name if parameter.default is None else f"{parameter.name}={parameter.default}"


def test_page_lists_every_action_once_with_its_arguments():
    line = r"^\* (`\w+`(?:, `\w+`)*)(?: \(([^)]*)\))?(?::|$)"
    rows = re.findall(line, PAGE.read_text(), flags=re.MULTILINE)
    told = [(name, given) for names, given in rows for name in re.findall(r"`(\w+)`", names)]
    assert sorted(name for name, _ in told) == sorted(ACTIONS.keys() - LEFT_OUT.keys())
    for name, arguments in told:
        parameters = list(inspect.signature(ACTIONS[name].handler).parameters.values())[1:]
        assert arguments == ", ".join(map(written, parameters)), name


def test_page_lists_every_refused_action_once_with_its_reason():
    refused = PAGE.read_text().partition("## Refused by name")[2]
    rows = re.findall(r"^\| (\w.*?) \| (`.*`) \|$", refused, flags=re.MULTILINE)
    told = [(name, why) for why, names in rows for name in re.findall(r"`(\w+)`", names)]
    assert sorted(told) == sorted(LEFT_OUT.items())


# ----------------------------------------------------------------- any junk


def floats(value):
    if isinstance(value, float):
        yield value
    elif isinstance(value, dict):
        for inner in value.values():
            yield from floats(inner)
    elif isinstance(value, list | tuple):
        for inner in value:
            yield from floats(inner)


def assert_sound(event):
    metadata = event.metadata
    assert all(len(thing) == 42 for thing in metadata["objects"])
    assert all(math.isfinite(number) for number in floats(dict(metadata)))
    objects = event.state.objects
    held = [thing.id for thing in objects.values() if thing.is_picked_up]
    assert held == ([] if event.state.held is None else [event.state.held])
    for thing in objects.values():
        assert all(parent in objects for parent in thing.parents)
        assert thing.id not in objects.containment.around(thing.id)
    assert len({thing.name for thing in objects.values()}) == len(objects)


def assert_fair(world, action):
    """The step does nothing but what is documented: an event, or ValueError for misuse."""
    before = world.state
    try:
        event = world.step(action)
    except ValueError as error:
        event = world.last_event
        assert event.code in MISUSE, action
        assert str(error) == event.message
    assert event.success == (event.message == "")
    assert len(event.metadata) == 37
    if not event.success:
        assert event.state is before


@settings(max_examples=80)
@given(st.sampled_from([ROOM, ROOM, ROOM, *SCENES[::5]]), st.integers(0, 2**32))
def test_any_junk_raises_nothing_but_misuse_and_leaves_a_sound_world(room, seed):
    world, draw = EmbeddedWorld(room), random.Random(seed)
    for _ in range(30):
        assert_fair(world, random_step(draw, world.state.objects))
        assert_sound(world.last_event)
