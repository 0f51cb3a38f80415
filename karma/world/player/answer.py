"""Write events of the embedded world as messages of AI2-THOR's player."""

from collections.abc import Iterator
from typing import Any

import msgspec
import numpy as np

from karma.world.event import WorldEvent, rgba_bytes
from karma.world.player.fifo import Field, FieldType, encode


def _plain(value: Any) -> Any:
    """Return what msgpack knows for what it does not."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    raise TypeError(f"cannot send a {type(value).__name__}")


class Writer:
    """Turns events into messages; what a moment's objects come to is worked out once."""

    def __init__(self) -> None:
        self._encoder = msgspec.msgpack.Encoder(enc_hook=_plain)
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
