"""Put the embedded world behind AI2-THOR's own process protocol: the genuine client drives it.

`ai2thor.controller.Controller(local_executable_path=command())` starts it; see `command`.
"""

from karma.world.player.launch import command

__all__ = ["command"]
