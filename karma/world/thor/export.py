"""Scenes and recordings of the real AI2-THOR, written down as this project imports them.

A run that was cut off goes on where it was: what is there is not done again.
"""

import json
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import msgspec

from karma.errors import FileError, KarmaError
from karma.files import append_line, read_bytes, read_json, to_json, write_atomic
from karma.world.thor.backend import ThorWorld

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
