"""The least that AI2-THOR's client takes for a player: the reference for `scripts/bench_world.py`.

Answers every action at once with one constant frame: all metadata of a scene, no images, no world.

    Controller(local_executable_path="python scripts/echo_player.py METADATA.json", ...)

METADATA.json holds `event.metadata` of one event; the scene in it is the only one "served".
"""

import argparse
import json
import os
import struct
from pathlib import Path
from typing import BinaryIO

import msgspec

_HEADER = struct.Struct("!BI")
_METADATA, _END = 1, 255


def main() -> None:
    """Echo until the client closes its pipe."""
    parser = argparse.ArgumentParser(description=__doc__, add_help=False)
    parser.add_argument("metadata", type=Path)
    options, _ = parser.parse_known_args()
    agent = json.loads(options.metadata.read_text())
    returned = {agent["sceneName"]: 0, "cameraNearPlane": 0.01, "cameraFarPlane": 20.0}
    agent |= {"lastActionSuccess": True, "errorCode": None, "actionReturn": returned}
    message = {"agents": [agent], "thirdPartyCameras": None, "activeAgentId": 0}
    constant = msgspec.msgpack.encode(message)[1:]  # without the head of the map
    with Path(os.environ["AI2THOR_FIFO_SERVER_PIPE_PATH"]).open("wb") as sink:
        sink.write(_frame(0, constant))
        sink.flush()
        with Path(os.environ["AI2THOR_FIFO_CLIENT_PIPE_PATH"]).open("rb") as source:
            while (number := _sequence_id(source)) is not None:
                sink.write(_frame(number, constant))
                sink.flush()


def _frame(number: int, constant: bytes) -> bytes:
    """Return the message for one sequence id."""
    body = b"\x84\xaasequenceId" + msgspec.msgpack.encode(number) + constant
    return _HEADER.pack(_METADATA, len(body)) + body + _HEADER.pack(_END, 0)


def _sequence_id(source: BinaryIO) -> int | None:
    """Read one action and return its number; None at the end."""
    header = source.read(_HEADER.size)
    if not header:
        return None
    action = msgspec.json.decode(source.read(_HEADER.unpack(header)[1]))
    source.read(_HEADER.size)
    return int(action["sequenceId"])


if __name__ == "__main__":
    main()
