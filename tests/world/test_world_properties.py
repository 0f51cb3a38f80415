"""What holds after any sequence of actions, in the handmade kitchen and in every scene we ship."""

import contextlib
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.household import kitchen

from karma.world.actions.table import ACTIONS
from karma.world.core import scene
from karma.world.core.hiding import blocking, hidden_rows, inert_rows
from karma.world.core.metadata import records
from karma.world.core.objects import Objects
from karma.world.core.thing import is_inert
from karma.world.core.view import sight
from karma.world.sim import EmbeddedWorld

ROOM = kitchen()
IDS = [thing.id for thing in ROOM.objects]
ON_OBJECTS = sorted(name for name, action in ACTIONS.items() if "objectId" in action.kinds)
ALONE = [
    "MoveAhead", "MoveBack", "MoveLeft", "MoveRight", "RotateLeft", "RotateRight", "LookUp",
    "LookDown", "Crouch", "Stand", "Pass", "DropHeldObject",
]  # fmt: skip

alone = st.builds(lambda name: {"action": name}, st.sampled_from(ALONE))
handling = st.builds(
    lambda name, index, force: {"action": name, "index": index, "forceAction": force},
    st.sampled_from(ON_OBJECTS),
    st.integers(0, len(IDS) + 10),
    st.sampled_from([True, True, False]),
)
throwing = st.builds(
    lambda force: {"action": "ThrowObject", "moveMagnitude": force}, st.floats(0, 500)
)
ACTS = st.lists(st.one_of(alone, handling, handling, throwing), max_size=30)


def do(world, action):
    """Do one action; `index` chooses among the ids there are."""
    action = dict(action)
    if "index" in action:
        ids = list(world.state.objects)
        action["objectId"] = ids[action.pop("index") % len(ids)]
        if "forceAction" not in ACTIONS[action["action"]].kinds:
            del action["forceAction"]
    return world.step(**action)


def assert_acyclic(objects):
    for object_id in objects:
        assert object_id not in objects.containment.around(object_id)


def assert_places(state):
    """Nothing is in two places: held things lie nowhere, inert ones too."""
    held = [thing.id for thing in state.objects.values() if thing.is_picked_up]
    assert held == ([] if state.held is None else [state.held])
    for thing in state.objects.values():
        assert all(parent in state.objects for parent in thing.parents)
        assert not thing.parents or not (thing.is_picked_up or is_inert(thing))
    for object_id in state.in_hand - {state.held}:
        assert set(state.objects[object_id].parents) <= state.in_hand


def assert_states(before, after):
    for object_id, thing in after.items():
        assert (thing.liquid is None) or thing.is_filled
        assert 0.0 <= thing.openness <= 1.0
        if object_id in before:  # one-way states
            assert thing.is_cooked >= before[object_id].is_cooked
            assert thing.is_sliced >= before[object_id].is_sliced
            assert thing.is_broken >= before[object_id].is_broken
        if thing.type == "Microwave":
            assert not (thing.is_toggled and thing.openness > 0)


def assert_pose(pose):
    assert (pose.position_m[0], pose.position_m[2]) in ROOM.reachable
    assert -30.0 <= pose.horizon_deg <= 60.0
    assert 0.0 <= pose.yaw_deg < 360.0


@given(actions=ACTS)
def test_any_actions_keep_ids_containment_places_states_and_the_agent_on_a_cell(actions):
    world = EmbeddedWorld(ROOM)
    for action in actions:
        before = world.state
        event = do(world, action)
        after = event.state
        assert list(after.objects)[: len(before.objects)] == list(before.objects)
        assert_acyclic(after.objects)
        assert_places(after)
        assert_states(before.objects, after.objects)
        assert_pose(after.pose)
        assert after.time_s >= before.time_s
        if not event:
            assert after is before


@settings(max_examples=30)
@given(actions=ACTS)
def test_any_actions_replayed_give_equal_metadata(actions):
    def run():
        world = EmbeddedWorld(ROOM)
        return [json.dumps(do(world, action).metadata) for action in actions]

    assert run() == run()


@settings(max_examples=50)
@given(actions=ACTS)
def test_any_actions_make_events_whose_snapshots_never_change(actions):
    world = EmbeddedWorld(ROOM)
    events = [world.last_event]
    written = [json.dumps(world.last_event.metadata)]
    for action in actions:
        events.append(do(world, action))
        written.append(json.dumps(events[-1].metadata))
    assert [json.dumps(event.metadata) for event in events] == written


# ----------------------------------------------------------------- scenes we ship


@pytest.fixture(scope="module", params=sorted(path.stem for path in scene.SCENES.glob("*.json")))
def shipped(request):
    return EmbeddedWorld(request.param)


def test_shipped_scene_starts_settled(shipped):
    before = shipped.state.objects
    assert dict(shipped.step("Pass").state.objects) == dict(before)
    assert_acyclic(before)
    assert_places(shipped.state)


def test_shipped_scene_lets_nearly_everything_open_be_reached(shipped):
    state = shipped.reset(shipped.state.room.name).state
    shown = [i for i, row in state.objects.rows.items() if not hidden_rows(state.objects)[row]]
    reached = [
        i for i in shown if shipped.step("GetInteractablePoses", objectId=i, maxPoses=1).value
    ]
    assert len(reached) >= 0.95 * len(shown), sorted(set(shown) - set(reached))


def test_shipped_scene_has_room_on_every_surface(shipped):
    name = shipped.state.room.name
    state = shipped.reset(name).state
    small = next(
        thing
        for thing in state.objects.values()
        if max(thing.size) < 0.25 and "pickupable" in thing.capabilities
    )
    for kind in ("CounterTop", "DiningTable", "CoffeeTable", "Desk", "Bed", "Sofa", "Dresser"):
        for place in state.objects.by_type.get(kind, ()):
            shipped.reset(name)
            shipped.step("PickupObject", objectId=small.id, forceAction=True)
            event = shipped.step("PutObject", objectId=place, forceAction=True)
            assert event, (place, event.message)


@settings(max_examples=40)
@given(ACTS)
def test_what_is_remembered_of_the_world_is_what_a_fresh_look_finds(acts):
    world = EmbeddedWorld(ROOM)
    for action in acts:
        with contextlib.suppress(ValueError):
            do(world, action)
        state = world.state
        fresh = Objects(dict(state.objects))
        again = sight(fresh, state.pose, held=state.in_hand)
        assert again.visible == state.sight.visible
        assert again.interactable == state.sight.interactable
        for name in ("center", "half", "low", "high", "origin"):
            known = getattr(state.objects.boxes, name)
            assert np.array_equal(getattr(fresh.boxes, name), known), name
        for rows in (inert_rows, hidden_rows):
            assert np.array_equal(rows(fresh), rows(state.objects)), rows
        assert records(fresh) == records(state.objects)
        assert fresh.containment.children == state.objects.containment.children
        assert world.state.in_hand or np.array_equal(
            blocking(fresh, range(len(fresh))), blocking(state.objects, range(len(fresh)))
        )
