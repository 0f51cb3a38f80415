"""A player that answers as AI2-THOR's does, as little as its client needs, with faults on demand.

    python fake_player.py [--fault NAME] [--once FILE] [--pid FILE] ...

With --once the fault happens only while FILE does not exist; it is made when the player starts.
The client's own options that follow are ignored.
"""

import argparse
import json
import os
import shlex
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import msgpack

SCENES = ["FloorPlan1_physics", "FloorPlan2_physics"]
HEADER = struct.Struct("!BI")


def things():
    ids = ("Blinds|+00.00|+01.00|+00.00", "Mug|+01.00|+01.00|+00.00")
    return [{"objectId": i, "objectType": i.split("|")[0], "visible": True} for i in ids]


def metadata(action, *, value=None, scene="", size=(300, 300)):
    return {
        "objects": things(), "lastAction": action, "lastActionSuccess": True, "errorMessage": "",
        "errorCode": None, "actionReturn": value, "sceneName": scene, "screenWidth": size[0],
        "screenHeight": size[1], "thirdPartyCameras": [], "colors": None, "agentId": 0,
        "depthFormat": "Meters", "agent": {}, "sceneBounds": {},
    }  # fmt: skip


def field(kind, body):
    return HEADER.pack(kind, len(body)) + body


def read(pipe, size):
    data = pipe.read(size)
    if len(data) < size:
        sys.exit(0)
    return data


class Player:
    def __init__(self, fault):
        self.fault = fault
        self.scene, self.size = "", (300, 300)

    def run(self):
        self.at("open")
        path = Path(os.environ["AI2THOR_FIFO_SERVER_PIPE_PATH"])
        self.answers = path.open("wb", buffering=0)
        self.at("first frame")
        self.answer("", 0)
        path = Path(os.environ["AI2THOR_FIFO_CLIENT_PIPE_PATH"])
        self.actions = path.open("rb")
        while True:
            action = self.receive()
            name = action["action"]
            self.at(name)
            if name == "Reset":
                self.scene = action["sceneName"]
            if name == "ChangeResolution":
                self.size = (action["x"], action["y"])
            self.answer(name, action["sequenceId"], value=self.value(action))
            self.at(f"after {name}")

    def value(self, action):
        match action["action"]:
            case "GetScenesInBuild":
                return SCENES
            case "GetObjectInFrame":
                return things()[0 if action["x"] < 0.5 else 1]["objectId"]
            case "GetReachablePositions":
                return [{"x": 0.0, "y": 0.9, "z": 0.0}]
            case "Environment":
                return dict(os.environ)
            case "Echo":
                return {k: v for k, v in action.items() if k not in ("action", "sequenceId")}
            case "Initialize":
                return {"cameraNearPlane": 0.01, "cameraFarPlane": 20.0, **action}
        return None

    def receive(self):
        kind, length = HEADER.unpack(read(self.actions, HEADER.size))
        assert kind == 2
        body = read(self.actions, length)
        assert read(self.actions, HEADER.size) == HEADER.pack(255, 0)
        return json.loads(body)

    def message(self, name, sequence, value=None):
        width, height = self.size
        data = metadata(name, value=value, scene=self.scene, size=self.size)
        if name == "Bad":
            data |= {"lastActionSuccess": False, "errorCode": "InvalidAction", "errorMessage": "no"}
        if self.fault == f"refuse@{name}":
            data |= {"lastActionSuccess": False, "errorMessage": "not like this"}
        whole = {"agents": [data], "thirdPartyCameras": [], "activeAgentId": 0}
        body = msgpack.packb({**whole, "sequenceId": sequence})
        picture = bytes(range(256)) * (width * height * 3 // 256 + 1)
        rgb = picture[: width * height * 3]
        return field(1, body) + field(4, rgb) + field(255, b"")

    def answer(self, name, sequence, value=None):
        data = memoryview(self.message(name, sequence, value))
        while data:
            data = data[self.answers.write(data) :]

    def at(self, moment):
        """Do what the fault asks for at this moment, e.g. "die@MoveAhead"."""
        what, _, when = self.fault.partition("@")
        if when != moment:
            return
        match what:
            case "die":
                sys.exit(3)
            case "segv":
                os.kill(os.getpid(), signal.SIGSEGV)
            case "hang":
                time.sleep(3600)
            case "close":
                self.answers.close()
                time.sleep(3600)
            case "garbage":
                self.answers.write(b"Segmentation fault (core dumped)\n")
            case "huge":
                self.answers.write(HEADER.pack(1, 1 << 30) + b"x" * 100)
            case "half":
                whole = self.message(moment, 0)
                self.answers.write(whole[: len(whole) // 2])
                time.sleep(3600)
            case "half-die":
                whole = self.message(moment, 0)
                self.answers.write(whole[: len(whole) // 2])
                sys.exit(4)
            case "nonsense":
                self.answers.write(field(1, b"\xc1\xc1") + field(255, b""))
            case "empty":
                self.answers.write(field(255, b""))
            case "wrong-id":
                self.answer(moment, 999)


def command(fault="", **files):
    """Return the text that starts this player; `files` are once, pid, child."""
    words = [sys.executable, __file__, "--fault", fault]
    for name, path in files.items():
        words += [f"--{name}", str(path)]
    return shlex.join(words)


def main():
    parser = argparse.ArgumentParser(allow_abbrev=False)
    parser.add_argument("--fault", default="")
    parser.add_argument("--once", type=Path)
    parser.add_argument("--pid", type=Path)
    parser.add_argument("--child", type=Path, help="start a child that stays; its pid goes here")
    given, _ = parser.parse_known_args()
    fault = given.fault
    if given.once is not None:
        fault = "" if given.once.exists() else fault
        given.once.touch()
    if given.pid is not None:
        given.pid.write_text(str(os.getpid()))
    if given.child is not None:
        given.child.write_text(str(subprocess.Popen(["sleep", "600"]).pid))
    Player(fault).run()


if __name__ == "__main__":
    main()
