"""Agents that are told what to say, in a kitchen made by hand."""

from itertools import count

import numpy as np

from karma.assistant.agent import Agent
from karma.files import to_json
from karma.memory.recall import CosineRecall
from karma.models.scripted import MetadataVision, ScriptedModel
from karma.types.completion import Decoding
from karma.types.roles import Resources
from support.household import kitchen

_numbers = count()  # of runs in kept homes
TAKE = "GoToObject(robot, 'Apple')\nPickupObject(robot, 'Apple')\n"
AWAY = (
    "OpenObject(robot, 'Fridge')\nPutObject(robot, 'Apple', 'Fridge')\n"
    "CloseObject(robot, 'Fridge')\n"
)
STORE = TAKE + AWAY
WASH = "PutObject(robot, 'Apple', 'Sink')\nToggleOn(robot, 'Faucet')\nToggleOff(robot, 'Faucet')\n"


def resources(answers, model=None, maps=None, embedder=None):
    """What an agent is built from that says those programs; it may refuse."""
    return Resources(
        model=model or ScriptedModel(answers),
        profile="compact",
        decoding=Decoding(attempts=1, refusing=True),
        recall=CosineRecall(_Alike(), text="sentence"),
        vision=MetadataVision(),
        embedder=embedder,
        maps=maps,
        learn=maps is not None,
    )


def agent_saying(
    folder, answers, listen=None, assistant="rules", home=None, later_s=0.0, people=None, **given
):
    """An agent in the kitchen made by hand, with its run and its maps in a folder."""
    folder.mkdir(exist_ok=True)
    scene = folder / "handmade.json"
    if not scene.exists():
        scene.write_bytes(to_json(kitchen()))
    maps = folder / "maps"
    loaded = resources(answers, maps=maps, **given)
    return Agent(
        str(scene), resources=loaded, folder=folder / ("run" if home is None else _run(folder)),
        maps=maps, listen=listen, assistant=assistant, home=home, later_s=later_s,
        people=people,
    )  # fmt: skip


def _run(folder):
    return f"run-{next(_numbers)}"


class _Alike:
    """An embedder to which all texts are the same."""

    name, dimension = "alike", 2

    def embed(self, texts):
        rows = np.zeros((len(texts), 2), dtype=np.float32)
        rows[:, 0] = 1.0
        return rows
