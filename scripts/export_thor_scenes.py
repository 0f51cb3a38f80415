"""Write down what the real AI2-THOR reports, in the form that this project imports.

python scripts/export_thor_scenes.py runs/thor                          every scene at reset
python scripts/export_thor_scenes.py runs/thor --only FloorPlan1 'FloorPlan2*'
python scripts/export_thor_scenes.py runs/thor --record actions.json    what actions do

Needs a Unity build: --executable, $KARMA_THOR_BUILD, or AI2-THOR's cache; `karma doctor thor`
tells. In the folder come to lie

  scenes.jsonl         one line a scene: scene, objects (metadata at reset), agent, bounds,
                       reachable; `karma world import runs/thor/scenes.jsonl` reads it
  layouts.json         {scene: {"reachable": [[x, z], ...]}}; its option --layouts reads it
  events/NAME.jsonl    one line an action: action, metadata; `karma world replay-events` reads it

An action script is JSON: {"scene": "FloorPlan1", "initialize": {"gridSize": 0.25}, "actions":
[{"action": "PickupObject", "objectId": "Apple|..."}, ...]}; several can be given. A run that was
cut off goes on where it was: scenes and recordings that are there are not done again.
"""

import argparse
import json
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from karma.errors import FileError, KarmaError
from karma.files import append_line, read_bytes, read_json, to_json, write_atomic
from karma.offline.guard import go_offline
from karma.world.thor.backend import ThorWorld
from karma.world.thor.builds import PLATFORMS

OTHER_ROBOTS = re.compile(r"FloorPlan_(Train|Val|Test|test)|Procedural|Empty|ArchitecTHOR")
GIVE_UP = 3  # scenes or scripts in a row that fail

Json = dict[str, Any]


class ActionScript(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What is to be recorded."""

    scene: str
    actions: list[Json]
    initialize: Json = {}


class Failures:
    """Counts what went wrong; a few in a row end the run."""

    def __init__(self) -> None:
        self.said: list[str] = []
        self._in_a_row = 0

    @contextmanager
    def noted(self, what: str) -> Iterator[None]:
        """Do something that may fail.

        Raises:
            KarmaError: too much has failed in a row.
        """
        try:
            yield
            self._in_a_row = 0
        except (KarmaError, RuntimeError, ValueError) as error:
            self.said.append(f"{what}: {error}")
            self._in_a_row += 1
            if self._in_a_row == GIVE_UP:
                reason = f"{GIVE_UP} failures in a row, the last: {self.said[-1]}"
                raise KarmaError(reason) from error


# ----------------------------------------------------------------- scenes


def plain(name: str) -> str:
    """Return a scene's name as dumps give it."""
    return name.removesuffix("_physics")


def chosen(names: Sequence[str], only: Sequence[str] | None) -> list[str]:
    """Return the scenes to dump, in the order of rooms.

    Raises:
        KarmaError: a pattern that fits none.
    """
    if not only:
        return sorted((name for name in names if not OTHER_ROBOTS.search(name)), key=_by_number)
    for pattern in only:
        if not any(fnmatchcase(plain(name), plain(pattern)) for name in names):
            raise KarmaError(f"--only {pattern}: the build has no such scene, of {len(names)}")
    fits = {n for n in names for pattern in only if fnmatchcase(plain(n), plain(pattern))}
    return sorted(fits, key=_by_number)


def _by_number(name: str) -> tuple[str, int, str]:
    found = re.search(r"\d+", name)
    return (re.split(r"\d", name)[0], int(found[0]) if found else 0, name)


def dumped(path: Path) -> dict[str, Json]:
    """Return the rows that are there; a torn last line is taken off the file.

    Raises:
        FileError: a line that is none of ours.
    """
    if not path.exists():
        return {}
    data = read_bytes(path)
    whole = data[: data.rfind(b"\n") + 1]
    if whole != data:
        write_atomic(path, whole)
    rows: dict[str, Json] = {}
    for number, line in enumerate(whole.splitlines(), 1):
        try:
            row = json.loads(line)
            rows[row["scene"]] = row
        except (ValueError, KeyError, TypeError) as error:
            fix = "choose another folder, or move the file away"
            raise FileError(path, f"line {number}: not a scene: {error}", fix=fix) from error
    return rows


def dump(world: ThorWorld, name: str) -> Json:
    """Return one scene as it is at reset."""
    first = world.reset(name).metadata
    cells = world.step("GetReachablePositions").metadata["actionReturn"] or []
    return {
        "scene": plain(name),
        "objects": first["objects"],
        "agent": first["agent"],
        "bounds": first["sceneBounds"],
        "reachable": cells,
    }


def layouts(rows: dict[str, Json]) -> bytes:
    """Return the reachable cells of all scenes as the importer reads them."""
    cells = {
        name: {"reachable": sorted([cell["x"], cell["z"]] for cell in row["reachable"])}
        for name, row in rows.items()
        if row["reachable"]
    }
    return to_json(cells)


def export_scenes(
    world: ThorWorld, folder: Path, only: Sequence[str] | None, failures: Failures
) -> Iterator[tuple[int, str]]:
    """Dump what is not there yet; each line is on the disk before the next scene begins.

    Yields:
        How many scenes there are in all, and the next one's name.
    """
    path = folder / "scenes.jsonl"
    done = dumped(path)
    names = chosen(world.scenes, only)
    for name in names:
        yield len(names), plain(name)
        if plain(name) not in done:
            row = None
            with failures.noted(name):
                row = dump(world, name)
            if row is not None:
                append_line(path, to_json(row))
                done[plain(name)] = row
    write_atomic(folder / "layouts.json", layouts(done))


# ----------------------------------------------------------------- recordings


def record(world: ThorWorld, script: ActionScript) -> Iterator[Json]:
    """Do a script; yield the rows as recordings have them, Initialize first."""
    event = world.reset(script.scene)
    action = {"action": "Initialize", **script.initialize}
    for number in range(1, len(script.actions) + 2):
        yield {"action": {**action, "sequenceId": number}, "metadata": dict(event.metadata)}
        if number <= len(script.actions):
            action = script.actions[number - 1]
            with suppress(ValueError):  # misuse is an event too
                world.step(action)
            event = world.last_event


def export_recording(path: Path, folder: Path, make: Callable[..., ThorWorld]) -> Path | None:
    """Record one script; None when that is done already.

    The folder takes events/NAME.jsonl; `make` returns a world for the script's `initialize`.

    Raises:
        FileError: the script cannot be read.
        KarmaError: the simulator is lost, or has no such scene.
    """
    target = folder / "events" / f"{path.stem}.jsonl"
    if target.exists():
        return None
    script = read_json(path, ActionScript)
    for number, action in enumerate(script.actions, 1):
        if not isinstance(action.get("action"), str):
            raise FileError(path, f"action {number}: `action` is missing")
    world = make(**script.initialize)
    try:
        write_atomic(target, b"".join(to_json(row) for row in record(world, script)))
    finally:
        world.stop()
    return target


# ----------------------------------------------------------------- the command


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
