"""Write down what the real AI2-THOR reports, in the form that this project imports.

python scripts/export_thor_scenes.py runs/thor                          every scene at reset
python scripts/export_thor_scenes.py runs/thor --only FloorPlan1 'FloorPlan2*'
python scripts/export_thor_scenes.py runs/thor --record actions.json    what actions do

Needs a Unity build: --executable, $KARMA_THOR_BUILD, or AI2-THOR's cache; `karma doctor thor`
tells. In the folder come to lie

  scenes.jsonl         one line a scene: scene, objects (metadata at reset), agent, bounds,
                       reachable; `karma world import runs/thor/scenes.jsonl` reads it
  layouts.json         {scene: {"reachable": [[x, z], ...]}}; its option --layouts reads it
  events/NAME.jsonl    one line an action: action, metadata; `karma world replay --events` reads it

An action script is JSON: {"scene": "FloorPlan1", "initialize": {"gridSize": 0.25}, "actions":
[{"action": "PickupObject", "objectId": "Apple|..."}, ...]}; several can be given. A run that was
cut off goes on where it was: scenes and recordings that are there are not done again.
"""

import argparse
import sys
from functools import partial
from pathlib import Path

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from karma.errors import KarmaError
from karma.offline.guard import go_offline
from karma.world.thor.backend import ThorWorld
from karma.world.thor.builds import PLATFORMS
from karma.world.thor.export import Failures, dumped, export_recording, export_scenes


def export_events(options: argparse.Namespace, make: partial[ThorWorld], bar: Progress) -> Failures:
    """Record the scripts that are given."""
    failures = Failures()
    for path in bar.track(options.record, description="recordings"):
        with failures.noted(str(path)):
            target = export_recording(path, options.out, make)
            bar.print(f"{target or path.stem + ': is there already'}", soft_wrap=True)
    return failures


def export(options: argparse.Namespace, make: partial[ThorWorld], bar: Progress) -> Failures:
    """Dump the scenes that are chosen."""
    failures = Failures()
    world = make()
    try:
        task = bar.add_task("scenes", total=None)
        found = export_scenes(world, options.out, options.only, failures)
        for number, (total, name) in enumerate(found):
            bar.update(task, total=total, completed=number + 1, description=name)
    finally:
        world.stop()
    path = options.out / "scenes.jsonl"
    bar.print(f"{path}: {len(dumped(path))} scenes", soft_wrap=True)
    return failures


def main() -> None:
    """Export, and say what could not be."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path, nargs="?", default=Path("runs/thor"), help="folder")
    parser.add_argument("--executable", help="Unity build: file, folder or command")
    parser.add_argument("--platform", choices=PLATFORMS, help="default: by the build's name")
    parser.add_argument("--display", help="X display")
    parser.add_argument("--headless", action="store_true", help="no graphics card, no pictures")
    parser.add_argument("--only", nargs="+", help="names or patterns of scenes")
    parser.add_argument("--record", nargs="+", type=Path, help="action scripts to record instead")
    options = parser.parse_args()
    make = partial(
        ThorWorld,
        options.executable,
        platform=options.platform,
        display=options.display,
        headless=options.headless,
    )  # pictures are not needed
    columns = (
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    )  # fmt: skip
    try:
        with Progress(*columns) as bar:
            failures = (export_events if options.record else export)(options, make, bar)
    except KarmaError as error:
        sys.exit(f"error: {error}")
    if failures.said:
        sys.exit("error: failed:\n" + "\n".join(failures.said))


if __name__ == "__main__":
    go_offline()
    main()
