"""Count the functions of karma that one instruction enters, and the call depth down to the world.

    python scripts/measure_calls.py ["put the apple in the fridge"]

The agent of the tables (program mode, karma-nano) carries it out in kitchen_1; the hints of
karma-nano come from the plug-in `rules`, whose functions are counted apart. Counted from the call
of `do` to its end; loading, and the first tour of the room, come before it.
"""

import sys
import tempfile
from collections import Counter
from pathlib import Path
from types import CodeType, FrameType
from typing import Annotated, Any

import typer

from karma.agent.karma import KarmaMethod
from karma.loading.models import Models, load_resources
from karma.offline.guard import go_offline
from karma.types.events import Outcome
from karma.types.space import SceneRef
from karma.types.tasks import SubTask
from karma.world.sim import EmbeddedWorld

PACKAGE = str(Path(__file__).resolve().parents[1] / "karma")
STEP = EmbeddedWorld.step.__code__
SCENE = "kitchen_1"


class Calls:
    """Which functions of the package are entered, and how deep `World.step` lies."""

    def __init__(self) -> None:
        self.entered: dict[CodeType, str] = {}
        self.deepest = 0  # frames of the package from `do` to `World.step`, both counted

    def __call__(self, frame: FrameType, event: str, _: Any) -> None:
        """Note a call, as `sys.setprofile` reports it."""
        code = frame.f_code
        if event != "call" or not code.co_filename.startswith(PACKAGE):
            return
        if not code.co_name.startswith("<"):  # comprehensions and lambdas are of their function
            self.entered[code] = Path(code.co_filename).relative_to(PACKAGE).parts[0]
        if code is STEP:
            self.deepest = max(self.deepest, _depth(frame))


def _depth(frame: FrameType) -> int:
    """Return how many functions of the package are under way, from `do` on."""
    count, found = 0, frame
    while found.f_back is not None and found.f_code.co_name != "main":
        code = found.f_code
        count += code.co_filename.startswith(PACKAGE) and not code.co_name.startswith("<")
        found = found.f_back
    return count


def main(instruction: Annotated[str, typer.Argument()] = "put the apple in the fridge") -> None:
    """Carry out one instruction and print the figures."""
    go_offline()
    resources = load_resources(Models(), maps=None, seed=0)
    with tempfile.TemporaryDirectory() as folder:
        world = EmbeddedWorld()
        world.reset(SCENE)
        method = KarmaMethod.build(resources, {})
        agent = method.begin(world, SceneRef.of(SCENE), seed=0, folder=Path(folder))
        calls = Calls()
        events = agent.do(SubTask(instruction=instruction, whole=instruction))
        sys.setprofile(calls)
        done = list(events)
        sys.setprofile(None)
    outcome = done[-1]
    assert isinstance(outcome, Outcome)
    rooms = Counter(calls.entered.values())
    modules = {code.co_filename for code in calls.entered}
    print(f"{instruction!r}: finished {outcome.finished}, {len(done)} events")
    plugins = rooms.pop("plugins", 0)
    print(f"functions entered {rooms.total()} of the core, {plugins} of plug-ins: {dict(rooms)}")
    print(f"modules {len(modules)}")
    print(f"call depth from do to World.step {calls.deepest}")


if __name__ == "__main__":
    typer.run(main)
