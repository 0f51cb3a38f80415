"""Two ways into the same world: in process, and by AI2-THOR's genuine client through the player."""

import contextlib
import os
from importlib.util import find_spec

import pytest

from karma.files import to_json
from karma.world.sim import EmbeddedWorld
from support.household import kitchen

FRONTS = ("embedded", "player")
SIZE = {"width": 300, "height": 300}


@contextlib.contextmanager
def at_home(folder):
    """What the client needs around it: a home of its own, no GPU to ask for."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HOME", str(folder))
        patch.delenv("CUDA_VISIBLE_DEVICES", raising=False)
        patch.delenv("KARMA_SCENES", raising=False)
        yield patch


@contextlib.contextmanager
def controller(path, **arguments):
    """The genuine Controller; whatever happens, its player is gone afterwards."""
    module = pytest.importorskip("ai2thor.controller")
    given = {"x_display": ":0", "server_timeout": 20, "server_start_timeout": 20, **arguments}
    made = module.Controller.__new__(module.Controller)  # known also when it fails to start
    try:
        made.__init__(local_executable_path=path, **given)
        yield made
    finally:
        process = getattr(made.server, "unity_proc", None)
        with contextlib.suppress(BrokenPipeError):
            made.stop()
        if process is not None:
            process.kill()
            process.wait(10)


class Genuine:
    """The front that a user of AI2-THOR has."""

    name = "player"

    def __init__(self, made):
        self.controller = made

    @property
    def last_event(self):
        return self.controller.last_event

    def reset(self, scene="handmade", **settings):
        """Load a scene; nothing that an earlier test set stays."""
        self.controller.initialization_parameters = {}
        return self.controller.reset(scene, **{**SIZE, **settings})

    def step(self, *action, **arguments):
        return self.controller.step(*action, **arguments)


class Embedded:
    """The same in process; `reset` does what the client's does."""

    name = "embedded"

    def __init__(self, folder):
        self.world, self.folder = EmbeddedWorld(), folder

    @property
    def last_event(self):
        return self.world.last_event

    def reset(self, scene="handmade", *, width=300, height=300, **settings):
        own = self.folder / f"{scene}.json"
        self.world.reset(own if own.exists() else scene)
        if (width, height) != (300, 300):
            self.world.step("ChangeResolution", x=width, y=height)
        return self.world.step("Initialize", raise_for_failure=True, **settings)

    def step(self, *action, **arguments):
        return self.world.step(*action, **arguments)


def player_command(scenes):
    """Return the player's command for a folder of scenes; skips where it is not installed."""
    return pytest.importorskip("karma.plugins.thor_tools.player").command(scenes)


def write_scenes(folder):
    """Write the handmade kitchen under a name of ours and one of AI2-THOR's."""
    folder.mkdir(exist_ok=True)
    scene = kitchen()
    (folder / "handmade.json").write_bytes(to_json(scene))
    return folder


def open_fronts(stack, folder):
    """Return name -> front, the player started once; without the client there is only ours."""
    scenes = write_scenes(folder / "scenes of ours")
    found = {"embedded": Embedded(scenes)}
    if find_spec("ai2thor") is not None and find_spec("karma.plugins.thor_tools") is not None:
        stack.enter_context(at_home(folder))
        made = stack.enter_context(controller(player_command(scenes), scene="handmade"))
        found["player"] = Genuine(made)
    return found


def choose(fronts, name):
    """Return one front, or skip the test."""
    if name not in fronts:
        pytest.skip("needs AI2-THOR's own client and the player: karma-offline[thor_tools]")
    return fronts[name]


def environment(server_pipe, client_pipe, **more):
    """What the client puts into the environment of its player."""
    given = {
        "AI2THOR_SERVER_TYPE": "FIFO",
        "AI2THOR_FIFO_SERVER_PIPE_PATH": str(server_pipe),
        "AI2THOR_FIFO_CLIENT_PIPE_PATH": str(client_pipe),
    }
    return {**os.environ, **given, **more}
