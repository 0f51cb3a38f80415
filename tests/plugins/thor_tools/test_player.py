"""The player: its pipe format, its answers, and the genuine client that drives it.

Covered: messages in pieces and torn ones, malformed actions, scenes by name, what the client sees
against what the embedded world says, and that no process stays behind.
"""

import contextlib
import io
import json
import os
import shlex
import signal
import subprocess
import sys

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.fronts import at_home, choose, controller, environment, open_fronts, write_scenes
from support.household import kitchen

from karma.errors import FileError
from karma.files import to_json
from karma.plugins.thor_tools.player import command
from karma.plugins.thor_tools.player.fifo import Field, FieldType, WireError, encode, read_message
from karma.plugins.thor_tools.player.player import (
    MalformedError,
    Player,
    catalogue,
    read_action,
)

KINDS = st.sampled_from([kind for kind in FieldType if kind is not FieldType.END])
FIELDS = st.lists(st.builds(Field, KINDS, st.binary(max_size=40)), max_size=5)


class Pieces(io.RawIOBase):
    """A pipe that gives what was written in pieces of its own choice."""

    def __init__(self, data, sizes):
        self.data, self.sizes = data, sizes

    def readable(self):
        return True

    def readinto(self, buffer):
        size = min(next(self.sizes, 1 << 20), len(buffer), len(self.data))
        buffer[:size], self.data = self.data[:size], self.data[size:]
        return size


# ----------------------------------------------------------------- the pipe format


@given(messages=st.lists(FIELDS, max_size=3), sizes=st.lists(st.integers(1, 7), max_size=60))
def test_messages_read_in_any_pieces_are_those_written(messages, sizes):
    data = b"".join(encode(fields) for fields in messages)
    for source in (Pieces(data, iter(sizes)), io.BufferedReader(Pieces(data, iter(sizes)))):
        assert [read_message(source) for _ in messages] == messages
        assert read_message(source) is None


@given(data=st.binary(max_size=64))
def test_any_bytes_are_read_or_refused(data):
    source = io.BytesIO(data)
    with contextlib.suppress(WireError):
        while (fields := read_message(source)) is not None:
            assert encode(fields) == data[source.tell() - len(encode(fields)) : source.tell()]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"\x63\0\0\0\0", "field 1: no field type has the number 99"),
        (b"\xff\0\0\0\x05", "an end mark has no body, this one has 5 bytes"),
        (b"\x02\xff\xff\xff\xff", r"field 1 \(ACTION\): 4294967295 bytes are more than"),
        (b"\x02\0\0\0\x01{\x02\0\0\0\x02{", r"field 2 \(ACTION\): the pipe ended after 1 of 2"),
        (b"\x02\0\0\0\x01{", "field 2, header: the pipe ended"),
        (b"\x02\0\0\0\x01", r"field 1 \(ACTION\): the pipe ended before its 1 bytes"),
    ],
)
def test_damaged_message_is_refused_by_field_and_reason(data, message):
    with pytest.raises(WireError, match=message):
        read_message(io.BytesIO(data))


# ----------------------------------------------------------------- answers, in process


def said(data):
    """The answer as the client takes it apart: its first field's type, metadata, pictures."""
    fields = read_message(io.BytesIO(data))
    assert fields is not None
    return fields[0].kind, msgspec.msgpack.decode(fields[0].body), fields[1:]


def ask(player, **action):
    return said(player.answer([Field(FieldType.ACTION, json.dumps(action).encode())]))


@pytest.fixture
def player(tmp_path):
    made = Player(catalogue([write_scenes(tmp_path / "scenes")]), images=False)
    made.hello()
    ask(made, action="Reset", sceneName="handmade", sequenceId=0)
    return made


def test_player_speaks_first_with_number_0_and_all_fields(tmp_path):
    kind, message, pictures = said(Player(catalogue()).hello())
    assert (kind, message["sequenceId"], pictures) == (FieldType.METADATA, 0, [])
    assert len(message["agents"][0]) == 37
    assert message["agents"][0]["thirdPartyCameras"] is None


MALFORMED = [
    (b"", "the action is not JSON"),
    (b"{", "the action is not JSON"),
    (b"\xff\xfe", "the action is not JSON"),
    (b"[" * 100_000, "the action is not JSON"),
    (b"[]", "an action is a JSON object, this is a list"),
    (b"null", "an action is a JSON object, this is a NoneType"),
    (b"{}", "the action has no name"),
    (b'{"action": null}', "the action has no name"),
    (b'{"action": 3}', "the action has no name"),
    (b'{"action": "\\ud800"}', "the action has no name"),
    (b'{"action": "Pass", "sequenceId": "x"}', "sequenceId must be a whole number"),
    (b'{"action": "Pass", "sequenceId": 1.5}', "sequenceId must be a whole number"),
    (b'{"action": "Pass", "sequenceId": 1e400}', "sequenceId must be a whole number"),
    (b'{"action": "Pass", "sequenceId": 99999999999999999999}', "sequenceId must be"),
]


@pytest.mark.parametrize(("body", "reason"), MALFORMED)
def test_malformed_action_is_answered_and_costs_nothing(player, body, reason):
    _, before, _ = ask(player, action="RotateRight", sequenceId=7)
    kind, message, _ = said(player.answer([Field(FieldType.ACTION, body)]))
    agent = message["agents"][0]
    assert (kind, message["sequenceId"]) == (FieldType.METADATA, 8)
    assert not agent["lastActionSuccess"]
    assert agent["errorCode"] == "InvalidAction"
    assert reason in agent["errorMessage"]
    assert agent["objects"] == before["agents"][0]["objects"]
    _, message, _ = ask(player, action="RotateRight", sequenceId=9)
    assert message["agents"][0]["lastActionSuccess"]


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3)
    ),
    max_leaves=8,
)


@given(body=st.binary(max_size=30) | st.builds(lambda value: json.dumps(value).encode(), JSON))
def test_any_body_is_an_action_or_refused(body):
    with contextlib.suppress(MalformedError):
        assert isinstance(read_action([Field(FieldType.ACTION, body)])["action"], str)


NAMES = ["MoveAhead", "Teleport", "PickupObject", "OpenObject", "Reset", "Initialize", "Fly"]
WORDS = ["x", "y", "objectId", "position", "rotation", "sceneName", "renderImage", "action"]


@given(name=st.sampled_from(NAMES), arguments=st.dictionaries(st.sampled_from(WORDS), JSON))
def test_any_arguments_are_answered(name, arguments):
    player = Player(catalogue(), images=False)
    player.hello()
    ask(player, action="Reset", sceneName="bathroom_1", sequenceId=0)
    _, message, _ = ask(player, **{**arguments, "action": name, "sequenceId": 5})
    agents = message.get("agents", [message])  # a question's answer is a patch
    assert agents[0]["lastAction"] == name


def test_fault_of_our_own_is_answered_and_the_player_lives_on(caplog):
    player = Player({**catalogue(), "broken": 5}, images=False)  # 5 is no path
    player.hello()
    _, message, _ = ask(player, action="Reset", sceneName="broken", sequenceId=0)
    agent = message["agents"][0]
    assert (agent["lastActionSuccess"], agent["errorCode"]) == (False, "UnhandledException")
    assert agent["errorMessage"].startswith("TypeError: ")
    assert "Traceback" in caplog.text
    _, message, _ = ask(player, action="Reset", sceneName="kitchen_1", sequenceId=0)
    assert message["agents"][0]["lastActionSuccess"]


@pytest.mark.parametrize("name", ["Procedural", "FloorPlan1_physics", None, 3, {}])
def test_reset_to_a_scene_that_is_not_there_refuses_all_until_the_next(player, name):
    _, message, _ = ask(player, action="Reset", sceneName=name, sequenceId=0)
    agent = message["agents"][0]
    assert not agent["lastActionSuccess"]
    assert repr(name) in agent["errorMessage"]
    assert agent["objects"] == []
    for action in ("Initialize", "CreateHouse", "MoveAhead"):
        _, message, _ = ask(player, action=action, sequenceId=1)
        assert message["agents"][0]["errorMessage"] == agent["errorMessage"]
    _, message, _ = ask(player, action="Reset", sceneName="handmade", sequenceId=0)
    assert message["agents"][0]["lastActionSuccess"]
    assert len(message["agents"][0]["objects"]) == len(kitchen().objects)


def test_question_is_answered_by_a_patch_only_when_the_rest_is_known(player):
    question = {"action": "GetReachablePositions"}
    assert ask(player, **question)[0] is FieldType.METADATA_PATCH
    assert ask(player, **question, renderImage=True)[0] is FieldType.METADATA
    assert ask(player, **question)[0] is FieldType.METADATA  # the client now has pictures
    assert ask(player, **question)[0] is FieldType.METADATA_PATCH
    ask(player, action="RotateRight")
    assert ask(player, **question)[0] is FieldType.METADATA_PATCH
    assert ask(player, action="MoveAhead", moveMagnitude=9.0)[0] is FieldType.METADATA


# ----------------------------------------------------------------- scenes


def test_scenes_are_ours_and_those_of_folders_under_the_clients_names(tmp_path):
    (tmp_path / "FloorPlan7.json").write_bytes(to_json(kitchen()))
    (tmp_path / "kitchen_1.json").write_bytes(to_json(kitchen()))
    found = catalogue([tmp_path])
    assert found["FloorPlan7_physics"] == tmp_path / "FloorPlan7.json"
    assert found["kitchen_1"] == tmp_path / "kitchen_1.json"
    assert set(catalogue()) < set(found)


def test_scene_folder_that_is_missing_or_empty_is_refused(tmp_path):
    with pytest.raises(FileError, match="no such folder"):
        catalogue([tmp_path / "nowhere"])
    with pytest.raises(FileError, match="holds no scene file"):
        catalogue([tmp_path])


def test_command_is_split_by_the_client_as_it_was_meant(tmp_path):
    folder = tmp_path / "my 'own' rooms"
    words = shlex.split(command([folder, tmp_path]) + " -screen-width 300")
    assert words[0] == sys.executable
    assert words[-6:-2] == ["--scenes", str(folder), "--scenes", str(tmp_path)]


# ----------------------------------------------------------------- the genuine client


@pytest.fixture(scope="module")
def fronts(tmp_path_factory):
    with contextlib.ExitStack() as stack:
        found = open_fronts(stack, tmp_path_factory.mktemp("player"))
        choose(found, "player")
        yield found


SCRIPT = [
    {"action": "Pass"},
    {"action": "MoveAhead"},
    {"action": "RotateRight", "degrees": 90.0},
    {"action": "LookDown"},
    {"action": "GetReachablePositions"},
    {"action": "MoveAhead", "moveMagnitude": 9.0},
    {"action": "OpenObject", "objectId": "Fridge", "forceAction": True},
    {"action": "PickupObject", "objectId": "Apple", "forceAction": True},
    {"action": "RotateLeft", "renderImage": False},
    {"action": "GetInteractablePoses", "objectId": "Sofa|1|2|3"},
    {"action": "PutObject", "objectId": "Fridge", "forceAction": True},
    {"action": "SliceObject", "objectId": "Bread", "forceAction": True},
    {"action": "ToggleObjectOn", "objectId": "StoveKnob", "forceAction": True},
    {"action": "AddThirdPartyCamera", "position": {"x": 0.0, "y": 2.0, "z": -1.0},
     "rotation": {"x": 40.0, "y": 0.0, "z": 0.0}},
    {"action": "MoveRight", "renderInstanceSegmentation": True, "renderDepthImage": True},
    {"action": "ChangeResolution", "x": 320, "y": 200},
    {"action": "Done", "renderSemanticSegmentation": True, "renderNormalsImage": True},
]  # fmt: skip
FRAMES = [
    "frame", "depth_frame", "normals_frame", "instance_segmentation_frame",
    "semantic_segmentation_frame",
]  # fmt: skip
LISTS = [
    "third_party_camera_frames", "third_party_depth_frames", "third_party_normals_frames",
    "third_party_instance_segmentation_frames", "third_party_semantic_segmentation_frames",
]  # fmt: skip


def play(front, script):
    """Yield the event after every action; types stand for the first object of the type."""
    yield front.reset()
    for action in script:
        action = dict(action)
        kind = action.get("objectId", "|")
        if "|" not in kind:
            objects = front.last_event.metadata["objects"]
            action["objectId"] = next(o["objectId"] for o in objects if o["objectType"] == kind)
        yield front.step(action)


def test_client_sees_what_the_embedded_world_says(fronts):
    both = (play(fronts["embedded"], SCRIPT), play(fronts["player"], SCRIPT))
    for inside, outside in zip(*both, strict=True):
        assert dict(outside.metadata) == json.loads(json.dumps(inside.metadata))
        assert list(outside.metadata) == list(inside.metadata)
        assert bool(outside) == bool(inside)
        assert outside.pose == inside.pose
        for name in FRAMES:
            assert_same_picture(getattr(outside, name), getattr(inside, name), name)
        for name in LISTS:
            pairs = zip(getattr(outside, name), getattr(inside, name), strict=True)
            for one, other in pairs:
                assert_same_picture(one, other, name)
        assert sorted(outside.instance_masks) == sorted(inside.instance_masks)
        assert outside.color_to_object_id == inside.color_to_object_id


def assert_same_picture(one, other, name):
    assert (one is None) == (other is None), name
    if one is not None:
        assert (one.shape, one.dtype) == (other.shape, other.dtype), name
        assert np.array_equal(one, other), name


def test_client_loads_our_rooms_by_name_and_refuses_others(fronts):
    front = fronts["player"]
    names = front.step("GetScenesInBuild").metadata["actionReturn"]
    assert {"handmade", "kitchen_1", "bathroom_4"} <= set(names)
    for name in ("kitchen_1", "bathroom_4"):
        assert front.reset(name).metadata["sceneName"] == name
    with pytest.raises(ValueError, match="not contained in build"):
        front.controller.reset("FloorPlan9")
    with pytest.raises(RuntimeError, match="procedural houses"):
        front.controller.reset({"rooms": []})
    front.reset()


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ("--scenes nowhere", "nowhere: no such folder"),
        ("--scene kitchen_1", "unknown option --scene"),
        ("-screen-width wide", "invalid int value: 'wide'"),
    ],
)
def test_client_raises_with_our_reason_when_the_player_cannot_start(tmp_path, options, reason):
    told = pytest.raises(ValueError, match=reason)
    with at_home(tmp_path), told, controller(f"{command()} {options}", headless=True):
        pass


# ----------------------------------------------------------------- processes


@contextlib.contextmanager
def started(tmp_path):
    """A player that was told of two pipes, which nobody has opened yet."""
    pipes = tmp_path / "server.pipe", tmp_path / "client.pipe"
    for pipe in pipes:
        os.mkfifo(pipe)
    process = subprocess.Popen(
        shlex.split(command()), env=environment(*pipes), stderr=subprocess.PIPE
    )
    try:
        yield process, *pipes
    finally:
        process.kill()
        process.wait(10)
        process.stderr.close()


@contextlib.contextmanager
def talking(tmp_path):
    """A player that has said hello."""
    with (
        started(tmp_path) as (process, server_pipe, client_pipe),
        server_pipe.open("rb") as source,
        client_pipe.open("wb") as sink,
    ):
        assert read_message(source)
        yield process, source, sink


def ask_for_scenes(source, sink):
    sink.write(encode([Field(FieldType.ACTION, b'{"action": "GetScenesInBuild"}')]))
    sink.flush()
    assert read_message(source)


def test_player_ends_cleanly_when_the_client_closes_its_pipe(tmp_path):
    with talking(tmp_path) as (process, source, sink):
        ask_for_scenes(source, sink)
        sink.close()
        assert process.wait(10) == 0
        assert process.stderr.read() == b""


def test_player_ends_when_the_client_dies_before_it_ever_wrote(tmp_path):
    with started(tmp_path) as (process, server_pipe, _):
        with server_pipe.open("rb") as source:
            assert read_message(source)
        assert process.wait(10) == 0


def test_player_is_not_ended_by_the_clients_ctrl_c(tmp_path):
    with talking(tmp_path) as (process, source, sink):
        for _ in range(2):
            ask_for_scenes(source, sink)
            process.send_signal(signal.SIGINT)


def run(words, **more):
    return subprocess.run(words, capture_output=True, text=True, timeout=20, check=False, **more)


def test_player_without_a_client_says_how_it_is_started():
    for arguments, reason in (
        ([], "Controller starts this program"),
        (["--scene", "x"], "unknown option --scene"),
    ):
        words = [*shlex.split(command()), *arguments]
        bare = {k: v for k, v in os.environ.items() if not k.startswith("AI2THOR_")}
        done = run(words, env=bare)
        assert done.returncode == 2
        assert reason in done.stderr


def test_player_loads_neither_models_nor_drawing_before_it_must():
    code = (
        "import sys, karma.plugins.thor_tools.player.main, karma.plugins.thor_tools.player.player;"
        "print([m for m in ('torch', 'matplotlib', 'trimesh', 'transformers', 'typer', 'scipy',"
        " 'networkx', 'ai2thor.controller') if m in sys.modules])"
    )
    done = run([sys.executable, "-c", code])
    assert done.stdout.strip() == "[]", done.stderr
