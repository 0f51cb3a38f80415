"""Serve the embedded world as AI2-THOR's player: a message in, a message out.

Covered: what the client asks of a player itself (scenes, Reset), per-step pictures, fast emit,
answers to malformed messages and to faults of our own, which the player outlives. Everything else
is an action of the embedded world.
"""

import json
import logging
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import msgspec
import numpy as np

from karma.errors import FileError, KarmaError
from karma.plugins.thor_tools.player.fifo import Field, FieldType, encode, read_message
from karma.world.core.scene import SCENES, AgentPose, Scene
from karma.world.core.state import Images, scene_name
from karma.world.event import WorldEvent, rgba_bytes
from karma.world.sim import EmbeddedWorld

log = logging.getLogger(__name__)

VARIABLE = "KARMA_SCENES"  # folders of scene files, separated as in PATH
_LARGEST_ID = 2**62  # msgpack ends at 2**63
_NO_IMAGES = Images(rgb=False)
_OLD_NAMES = ("renderClassImage", "renderObjectImage")  # the client sends the new ones beside them
_NOWHERE = Scene(  # where the player is until the first Reset
    name="nowhere",
    room="Kitchen",
    source="karma/plugins/thor_tools/player/player.py",
    agent=AgentPose(position=(0.0, 0.9, 0.0)),
    reachable=((0.0, 0.0),),
    bounds_center=(0.0, 1.25, 0.0),
    bounds_size=(1.0, 2.5, 1.0),
    objects=(),
)


def _nowhere(width: int, height: int) -> EmbeddedWorld:
    return EmbeddedWorld(_NOWHERE, width=width, height=height, renderImage=False)


class MalformedError(KarmaError):
    """A message that is whole, but not an action."""


class Player:
    """One client's world, with the scene files of `catalogue` and pictures of a size in pixels.

    Without `images` there are none until an action asks for them.
    """

    def __init__(
        self,
        scenes: Mapping[str, Path],
        *,
        width: int = 300,
        height: int = 300,
        images: bool = True,
    ) -> None:
        self._scenes = scenes
        self._images = images
        self._world = _nowhere(width, height)
        self._trouble = ""  # why the last Reset failed; nothing else can be done until one succeeds
        self._sequence_id = 0
        self._writer = Writer()
        self._sent: WorldEvent | None = None  # the last event that went out in full

    def hello(self) -> bytes:
        """Return the message that the player sends unasked."""
        return self._send(self._world.last_event)

    def serve(self, source: BinaryIO, sink: BinaryIO) -> None:
        """Answer message after message until the client closes its pipe.

        Raises:
            WireError: what came is not a message.
            BrokenPipeError: the client reads no more.
        """
        while (message := read_message(source)) is not None:
            sink.write(self.answer(message))
            sink.flush()

    def answer(self, message: Sequence[Field]) -> bytes:
        """Return the answer to a message; whatever happens, there is one."""
        self._sequence_id += 1  # what it should be, if the message does not tell
        name = ""
        try:
            action = read_action(message)
            self._sequence_id = action.pop("sequenceId", self._sequence_id)
            name = action["action"]
            return self._send(self._do(name, action))
        except MalformedError as error:
            return self._fail(name, str(error), "InvalidAction")
        except Exception as error:  # a fault of ours must not cost the episode
            log.exception("action %r", name)
            return self._fail(name, f"{type(error).__name__}: {error}", "UnhandledException")

    def _do(self, name: str, action: dict[str, Any]) -> WorldEvent:
        if name == "Reset":
            return self._reset(action)
        if name == "GetScenesInBuild":
            last = self._world.last_event
            return WorldEvent(
                state=last.state, action=name, value=sorted(self._scenes), before=last
            )
        if self._trouble:
            return self._refuse(name, self._trouble, "Undefined")
        before = self._world.last_event
        try:
            event = self._world.step({k: v for k, v in action.items() if k not in _OLD_NAMES})
        except (ValueError, RuntimeError):  # misuse, which the client raises
            event = self._world.last_event
            if event is before or event.success:
                raise
        return event

    def _reset(self, action: Mapping[str, Any]) -> WorldEvent:
        settings = self._world.state.settings
        width, height = settings.width, settings.height
        name = action.get("sceneName")
        self._trouble, self._world = "", _nowhere(width, height)
        path = self._scenes.get(name) if isinstance(name, str) else None
        try:
            if path is None:
                raise KarmaError(f"no scene named {name!r}; procedural houses are not supported")
            self._world = EmbeddedWorld(path, width=width, height=height, renderImage=self._images)
        except KarmaError as error:
            self._trouble = f"Reset: {error}"
            return self._refuse("Reset", self._trouble, "Undefined")
        return self._world.last_event

    def _refuse(self, name: str, message: str, code: str) -> WorldEvent:
        """Return the event of an action that never reached the world."""
        last = self._world.last_event
        return WorldEvent(
            state=last.state, action=name, success=False, message=message, code=code,
            images=_NO_IMAGES, before=last,
        )  # fmt: skip

    def _fail(self, name: str, message: str, code: str) -> bytes:
        """Return the message of a failure, whatever state the world is in."""
        try:
            return self._send(self._refuse(name, message, code))
        except Exception:  # the fault is in the world's metadata itself
            log.exception("the answer to %r", name)
            settings = self._world.state.settings
            self._trouble, self._world = message, _nowhere(settings.width, settings.height)
            return self._send(self._refuse(name, message, code))

    def _send(self, event: WorldEvent) -> bytes:
        if self._known(event):
            return self._writer.patch(event)
        message = self._writer.full(event, self._sequence_id)
        self._sent = event
        return message

    def _known(self, event: WorldEvent) -> bool:
        """Return whether the client has all but the answer: fast emit of a question."""
        sent, root = self._sent, event.before
        if sent is None or root is None or not event.success:
            return False
        same_moment = root is sent or root is sent.before
        return same_moment and event.images == sent.images and event.state.settings.fast_emit


def read_action(message: Sequence[Field]) -> dict[str, Any]:
    """Return the action that a message is, its name under "action".

    Raises:
        MalformedError: it is none; says why.
    """
    if [field.kind for field in message] != [FieldType.ACTION]:
        kinds = ", ".join(field.kind.name for field in message) or "nothing"
        raise MalformedError(f"expected one ACTION field, got {kinds}")
    action = _decoded(message[0].body)
    if not isinstance(action, dict):
        raise MalformedError(f"an action is a JSON object, this is a {type(action).__name__}")
    if not _is_text(action.get("action")):
        raise MalformedError('the action has no name: "action" must be a string')
    number = action.get("sequenceId", 0)
    if not isinstance(number, int) or abs(number) > _LARGEST_ID:
        raise MalformedError(f"sequenceId must be a whole number, not {number!r}")
    return action


def _is_text(value: Any) -> bool:
    """Return whether this is a string that can be sent back: without halves of characters."""
    return isinstance(value, str) and not any("\ud800" <= letter <= "\udfff" for letter in value)


def _decoded(body: bytes) -> Any:
    try:
        return msgspec.json.decode(body)
    except (msgspec.DecodeError, RecursionError):
        pass
    try:
        return json.loads(body)  # which knows NaN and Infinity, as the client does
    except (ValueError, RecursionError) as error:
        raise MalformedError(f"the action is not JSON: {error}") from None


# ----------------------------------------------------------------- answers


def _as_builtin(value: Any) -> Any:
    """Return what msgpack knows for what it does not."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    raise TypeError(f"cannot send a {type(value).__name__}")


class Writer:
    """Turns events into messages; what a moment's objects come to is worked out once."""

    def __init__(self) -> None:
        self._encoder = msgspec.msgpack.Encoder(enc_hook=_as_builtin)
        self._objects: object = None
        self._packed = msgspec.Raw()

    def full(self, event: WorldEvent, sequence_id: int) -> bytes:
        """Return the message with all metadata and the event's pictures."""
        fields = [Field(FieldType.METADATA, self.metadata(event, sequence_id))]
        if event.images.rgb:
            fields += pictures(event)
        return encode(fields)

    def metadata(self, event: WorldEvent, sequence_id: int) -> bytes:
        """Return the metadata of a message: the one agent's, and whose turn it is."""
        metadata = event.metadata
        if event.objects is not self._objects:
            self._packed = msgspec.Raw(self._encoder.encode(event.objects))
            self._objects = event.objects
        message = {
            "agents": [{**metadata, "objects": self._packed}],
            "thirdPartyCameras": metadata["thirdPartyCameras"],
            "activeAgentId": 0,
            "sequenceId": sequence_id,
        }
        return self._encoder.encode(message)

    def patch(self, event: WorldEvent) -> bytes:
        """Return the message for a moment that the client knows: how the action went, no more."""
        fields = {
            "agentId": 0,
            "lastAction": event.action,
            "lastActionSuccess": event.success,
            "errorMessage": event.message,
            "errorCode": event.code,
            "actionReturn": event.value,
        }
        return encode([Field(FieldType.METADATA_PATCH, self._encoder.encode(fields))])


def pictures(event: WorldEvent) -> Iterator[Field]:
    """Yield an event's pictures, those of the third-party cameras first."""
    for kind, frames in (
        (FieldType.THIRD_PARTY_RGB, event.third_party_camera_frames),
        (FieldType.THIRD_PARTY_DEPTH, event.third_party_depth_frames),
        (FieldType.THIRD_PARTY_IDS, event.third_party_instance_segmentation_frames),
        (FieldType.THIRD_PARTY_CLASSES, event.third_party_semantic_segmentation_frames),
        (FieldType.THIRD_PARTY_NORMALS, event.third_party_normals_frames),
        (FieldType.RGB, [event.frame]),
        (FieldType.DEPTH, [event.depth_frame]),
        (FieldType.IDS, [event.instance_segmentation_frame]),
        (FieldType.CLASSES, [event.semantic_segmentation_frame]),
        (FieldType.NORMALS, [event.normals_frame]),
    ):
        for frame in frames:
            if frame is not None:
                yield Field(kind, _pixels(kind, frame))


def _pixels(kind: FieldType, frame: np.ndarray) -> bytes:
    """Return a picture's bytes, the bottom row first."""
    if kind in (FieldType.IDS, FieldType.THIRD_PARTY_IDS):
        return rgba_bytes(frame)
    return frame[::-1].tobytes()


# ----------------------------------------------------------------- scenes


def folders(given: Sequence[str | Path], environment: Mapping[str, str]) -> list[Path]:
    """Return the folders of scene files: those given, else those of $KARMA_SCENES."""
    if given:
        return [Path(folder) for folder in given]
    value = environment.get(VARIABLE, "")
    return [Path(folder) for folder in value.split(os.pathsep) if folder]


def catalogue(more: Sequence[Path] = ()) -> dict[str, Path]:
    """Return name -> scene file: ours, then those in further folders, which may replace ours.

    A file's name is the scene's; the client itself appends `_physics` to `FloorPlan1`, so that is
    how such a scene is listed.

    Raises:
        FileError: a folder is missing or holds no scene file.
    """
    found: dict[str, Path] = {}
    for folder in (SCENES, *more):
        files = sorted(folder.glob("*.json"))
        if not files:
            reason = "holds no scene file (*.json)" if folder.is_dir() else "no such folder"
            raise FileError(folder, reason, fix=f"karma world import --out {folder}")
        found.update((scene_name(path.stem), path) for path in files)
    return found
