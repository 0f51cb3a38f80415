"""A home that is kept between sessions: what was done in it, line by line, and its map.

A line is on the disk before anything is said of it. Opened again, the actions are done again in
the world, which ends as it was left, and memory learns again what each line left in it.
"""

import os
import shutil
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from time import time
from typing import Any
from weakref import finalize

import msgspec

from karma.assistant.session_log import CLOCK_START_S, DEFAULT_SCENE, PastRequest, SessionLog
from karma.errors import FileError, KarmaError, UnwritableError
from karma.files import LARGEST_LOG, append_line, read_bytes, read_json, to_json, write_atomic
from karma.journal.folder import locked, read_lines
from karma.journal.formats import plural
from karma.plugins.homes.habits import check_people
from karma.plugins.homes.memory.sighting_age import chance_in_place
from karma.plugins.homes.types import HomeCard
from karma.plugins.rules.language.clock import time_of_day
from karma.plugins.rules.talk.remembering import age
from karma.types.observation import SeenObject
from karma.types.roles import World
from karma.world.sim import EmbeddedWorld

HOMES = Path("runs/homes")
_CARD, _LOG = "home.json", "log.jsonl"


def home_folder(name: str | Path) -> Path:
    """Return where a home lies: a name's place among all homes, or a folder as it is given."""
    path = Path(name)
    return path if path.is_absolute() or len(path.parts) > 1 else HOMES / path


def seconds_away(name: str) -> float:
    """Return the wall-clock seconds since a home was left; 0 if it does not exist."""
    try:
        return max(time() - (home_folder(name) / _LOG).stat().st_mtime, 0.0)
    except OSError:
        return 0.0


def homes() -> list[Path]:
    """Return all homes that go by a name, in the order of their names."""
    return sorted(one.parent for one in HOMES.glob(f"*/{_CARD}"))


def forget_home(folder: Path) -> None:
    """Remove a home and all that was remembered there.

    Raises:
        KarmaError: it is no home, or somebody is in it.
    """
    opened(folder).leave()
    shutil.rmtree(folder)


def opened(name: str | Path) -> "KeptHome":
    """Return a home that is there.

    Raises:
        KarmaError: there is none of this name, or somebody is in it.
    """
    folder = home_folder(name)
    if not (folder / _CARD).is_file():
        raise KarmaError(f"{folder}: there is no home\n  To fix: karma home list")
    return KeptHome(folder)


def new_home(folder: Path, scene: str, world: EmbeddedWorld, *, people: int = 0) -> "KeptHome":
    """Begin a home where there is none; the world is to see that the scene is one.

    Raises:
        KarmaError: there is a home already, or no such scene.
    """
    if (folder / _CARD).exists():
        raise KarmaError(f"{folder}: there is a home already\n  To fix: karma home show {folder}")
    check_people(people)
    home = KeptHome(folder, scene, people=people)
    world.reset(home.scene)
    home.restore(world, world)
    return home


class KeptHome(SessionLog):
    """A home whose log lasts, which one agent has for itself until it leaves.

    Args:
        folder: made if it does not exist.
        scene: what the world is reset to; of an existing home it must be the same, "" for its own.
        people: who live there; None: as many as always, in a new home nobody.
        seed: of their days, if the home is new.
        later_s: seconds that have passed there since it was left.

    Raises:
        FileError: it cannot be made, or a file in it is damaged: names the line.
        KarmaError: somebody is in it, or it is of another scene or of other people.
    """

    folder: Path

    def __init__(
        self,
        folder: Path,
        scene: str = "",
        *,
        people: int | None = None,
        seed: int = 0,
        later_s: float = 0.0,
    ) -> None:
        self.folder, held = folder, ExitStack()
        self._leave = finalize(self, held.close)
        new = HomeCard(scene=scene or DEFAULT_SCENE, people=people or 0, seed=seed)
        fix = "end what is at work there, or name another --home; karma chat --fresh needs none"
        held.enter_context(locked(folder, fix=fix))
        try:
            self.card = _card_of(folder, scene, people, new)
            _drop_torn(folder / _LOG)
            story = _read(folder / _LOG)
        except BaseException:
            self.leave()
            raise
        self._later_s = later_s
        super().__init__(self.card.scene, story)

    def greeting(self) -> list[str]:
        """Return where the home is, who lives there, the time, and the last request."""
        people = self.card.people
        who = f"{people} {'person lives' if people == 1 else 'people live'}"
        live = f", where {who}" if people else ""
        if not self.past:
            return [f"a new home, kept in {self.folder}{live}"]
        last, now = self.past[-1], time_of_day(self.clock_s + CLOCK_START_S)
        some, when = plural(len(self.past), "request"), age(self.clock_s - last.at_s)
        return [f"home: {self.folder}{live}, {now}; {some} so far; the last, {when}: {last.said}"]

    def restore(self, world: World, simulator: EmbeddedWorld) -> None:
        """Repeat what was done in a world that was just reset, then let the time pass.

        The home exists on disk from then on: an unknown scene makes none.
        """
        if not (self.folder / _CARD).exists():
            write_atomic(self.folder / _CARD, to_json(self.card))
        super().restore(world, simulator)
        done: Sequence[tuple[str, dict[str, Any]]] = ()
        if self.card.people and self._later_s > 0:
            from karma.plugins.homes.people import live  # loads the residents, who are rarely used

            done = [
                *live(world, simulator, self.card, (self.clock_s, self.clock_s + self._later_s))
            ]
        self.wait(self._later_s, done)

    def _cannot_restore(self) -> str:
        return (
            f"{self.folder}: the home cannot be made again as it was left: its scene was "
            f"edited, or other code kept it\n  To fix: karma home forget {self.folder}"
        )

    def chance_in_place(self, sight: SeenObject, seen_s: float) -> float | None:
        """Return the chance that an object was not moved since; None if nobody lives here."""
        return chance_in_place(self.past, sight, seen_s, self.clock_s) if self.card.people else None

    def leave(self) -> None:
        """Let another agent have the home."""
        self._leave()

    def _write(self, line: PastRequest) -> None:
        """Write a line whole, or leave the log as it was.

        Raises:
            UnwritableError: it cannot be written.
        """
        path = self.folder / _LOG
        size = path.stat().st_size if path.exists() else 0
        try:
            append_line(path, to_json(line))
        except UnwritableError:
            with suppress(OSError):
                os.truncate(path, size)  # or the next line would go on from the torn one
            raise


def open_home(
    name: str | Path,
    scene: str = "",
    *,
    people: int | None = None,
    seed: int = 0,
    later_s: float = 0.0,
) -> KeptHome:
    """Open a home by name or folder, or begin a new one.

    Raises:
        KarmaError: as `KeptHome`, or there are not so many people.
    """
    check_people(people or 0)
    return KeptHome(home_folder(name), scene, people=people, seed=seed, later_s=later_s)


def _read_card(folder: Path) -> HomeCard:
    return read_json(folder / _CARD, HomeCard, fix=f"karma home forget {folder}")


def _card_of(folder: Path, scene: str, people: int | None, new: HomeCard) -> HomeCard:
    if Path(scene).is_file():
        scene = str(Path(scene).resolve())
    if not (folder / _CARD).exists():
        return msgspec.structs.replace(new, scene=scene or DEFAULT_SCENE)
    found = _read_card(folder)
    if scene and scene != found.scene:
        raise KarmaError(
            f"{folder} is a home in {found.scene}, not in {scene}\n"
            f"  To fix: --scene {found.scene}, or another --home"
        )
    if people is not None and people != found.people:
        raise KarmaError(
            f"{folder} is a home of {found.people} people, not of {people}\n"
            f"  To fix: --people {found.people}, or another --home"
        )
    return found


def _read(path: Path) -> list[PastRequest]:
    """Return what happened and was not undone; a torn last line is passed over: nobody heard of it.

    Raises:
        FileError: another line is damaged.
    """
    try:
        lines = read_lines(path, PastRequest)
    except FileError as error:
        fix = f"karma home forget {path.parent}"
        raise FileError(path, error.reason, fix=fix) from error
    found: list[PastRequest] = []
    for one in lines:
        if one.undone:
            errands = [at for at, past in enumerate(found) if not past.waited_s]
            for at in reversed(errands[-one.undone :]):
                del found[at]
        else:
            found.append(one)
    return found


def _drop_torn(path: Path) -> None:
    """Take a torn last line away, or the next one would go on from it."""
    data = read_bytes(path, most=LARGEST_LOG) if path.exists() else b""
    whole, newline, torn = data.rpartition(b"\n")
    if torn:
        write_atomic(path, whole + newline)
