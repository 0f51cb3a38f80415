"""The embedded world's events: AI2-THOR's class, made lazily, shared while nothing changes.

The stand-in for that class is held against the genuine one on random pictures.
"""

import gc
import warnings
import weakref

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.household import kitchen

from karma.world import event_base
from karma.world.event import rgba_bytes
from karma.world.sim import EmbeddedWorld

NAMES = [
    "Apple|+00.10|+00.90|-01.00", "Apple|+00.40|+00.90|-01.00",
    "Sink|+00.00|+01.00|+00.00|SinkBasin", "Apple", "Sink", "Wall",
]  # fmt: skip
COLORS = [(10 * n + 1, 250 - n, 7 * n) for n in range(len(NAMES))]


@pytest.fixture
def world():
    return EmbeddedWorld(kitchen(), renderDepthImage=True, renderInstanceSegmentation=True)


# ----------------------------------------------------------------- the genuine class


def test_events_are_ai2thors_where_it_is_installed(world):
    server = pytest.importorskip("ai2thor.server")
    assert isinstance(world.last_event, server.Event)
    assert isinstance(world.last_event.metadata, server.MetadataWrapper)
    assert world.last_event.objects_by_type("Apple")[0]["objectType"] == "Apple"
    assert "lastActionSuccess" in repr(world.last_event)


def test_every_attribute_of_the_genuine_event_is_there(world):
    server = pytest.importorskip("ai2thor.server")
    genuine = server.Event(dict(world.last_event.metadata))
    for name in vars(genuine):
        assert hasattr(world.last_event, name), name


def picture(codes):
    frame = np.zeros((*np.shape(codes), 3), dtype=np.uint8)
    for number, color in enumerate(COLORS):
        frame[np.asarray(codes) == number] = color
    return frame  # code len(COLORS) stays black: no name


def read(base, frame):
    """Return an event of a class that has read a segmentation frame."""
    height, width, _ = frame.shape
    colors = [{"name": n, "color": list(c)} for n, c in zip(NAMES, COLORS, strict=True)]
    event = base.__new__(base)
    event.metadata = {"colors": colors, "screenWidth": width, "screenHeight": height}
    event.screen_width, event.screen_height = width, height
    event.process_colors_ids(rgba_bytes(frame))
    return event


@given(
    st.integers(2, 7).flatmap(
        lambda width: st.lists(
            st.lists(st.integers(0, len(COLORS)), min_size=width, max_size=width),
            min_size=2,
            max_size=7,
        )
    )
)
def test_stand_in_reads_pictures_as_the_genuine_class_does(codes):
    server = pytest.importorskip("ai2thor.server")
    bases = (server.Event, event_base.SegmentedEvent)
    genuine, ours = (read(base, picture(codes)) for base in bases)
    for name in ("instance_masks", "class_masks"):
        theirs, mine = getattr(genuine, name), getattr(ours, name)
        assert set(theirs) == set(mine)
        assert all(np.array_equal(theirs[key], mine[key]) for key in theirs)
    for name in ("instance_detections2D", "class_detections2D"):
        theirs, mine = getattr(genuine, name), getattr(ours, name)
        assert {key: tuple(theirs[key]) for key in theirs} == dict(mine)


def test_stand_in_gives_metadata_its_two_aliases(world):
    server = pytest.importorskip("ai2thor.server")
    for action in ("Pass", "GetReachablePositions"):
        metadata = dict(world.step(action).metadata)
        for kind in (event_base.MetadataWrapper, server.MetadataWrapper):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                wrapped = kind(metadata)
                assert wrapped["hand"] == metadata["heldObjectPose"]
                if action == "Pass":
                    with pytest.raises(IndexError):
                        wrapped["reachablePositions"]
                else:
                    assert wrapped["reachablePositions"] == metadata["actionReturn"]


# ----------------------------------------------------------------- what is shared and kept


def test_questions_and_refusals_share_the_objects_of_the_event_before(world):
    first = world.step("Pass")
    for action in ("GetReachablePositions", "DropHeldObject", "GetScenesInBuild"):
        event = world.step(action)
        assert event.metadata["objects"] is first.metadata["objects"]
        assert event.metadata["lastAction"] == action


def test_refusals_do_not_keep_one_another_alive(world):
    world.step("Pass")
    refused = weakref.ref(world.step("DropHeldObject"))
    world.step("DropHeldObject")
    world.step("DropHeldObject")
    gc.collect()
    assert refused() is None


def test_a_listed_object_may_be_changed_without_changing_the_world(world):
    before = world.step("Pass").metadata["objects"][3]
    before["isBroken"] = before["visible"] = "changed by the reader"
    after = world.step("Pass").metadata["objects"][3]
    assert isinstance(after["isBroken"], bool)
    assert isinstance(after["visible"], bool)


# ----------------------------------------------------------------- pictures


def test_an_unknown_render_flag_is_refused():
    with pytest.raises(TypeError, match="renderSmell"):
        EmbeddedWorld(renderSmell=True)
