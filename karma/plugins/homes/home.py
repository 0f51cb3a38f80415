"""A home that is kept between sessions: what was done in it, line by line, and its map.

A line is on the disk before anything is said of it. Opened again, the actions are done again in
the world, which ends as it was left, and memory learns again what each line left in it.
"""

import os
import shutil
from collections.abc import Iterable, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from time import time
from typing import Any
from weakref import finalize

import msgspec

from karma.agent.journal.owned_folder import locked, read_lines
from karma.agent.journal.steps import Action
from karma.agent.seeing.perceive import digest_of
from karma.contracts import Event, MemoryChange, World
from karma.errors import FileError, KarmaError, UnwritableError
from karma.files import LARGEST_LOG, append_line, read_bytes, read_json, to_json, write_atomic
from karma.plugins.rules.language.clock import HOUR_S

HOMES = Path("runs/homes")
SCENE = "kitchen_1"  # where none is said
BEGINS_S = 8 * HOUR_S  # on the first day, a Monday: when a home's clock is at 0
PLACE_TOLD, STATE_TOLD = "told", "told how it is"  # how what a person only tells is kept
RULE, RULE_ENDED = "told never to", "told that it may"
TOLD = (PLACE_TOLD, STATE_TOLD, RULE, RULE_ENDED)
ACTION_S = 1.0  # that an action takes by the home's clock
_CARD, _LOG = "home.json", "log.jsonl"


class HomeCard(msgspec.Struct, frozen=True, kw_only=True):
    """What stands at the door."""

    scene: str  # what the world is reset to: a name, or a file wherever one stands
    people: int = 0  # who live there while the agent is away
    seed: int = 0  # of their days


class PastDeed(msgspec.Struct, frozen=True, kw_only=True):
    """Something that was asked for or done, by the types that it was about."""

    deed: str  # of `karma/plugins/rules/language/request_words.toml`, or a verb
    things: tuple[str, ...] = ()
    places: tuple[str, ...] = ()
    done: bool = False  # by a skill, or with all that was asked


class PastErrand(msgspec.Struct, frozen=True, kw_only=True):
    """One request that was carried out or tried, and all that it changed."""

    said: str
    status: str
    at_s: float  # when it ended, by the home's clock
    room: str  # SHA-256 of how the world was then
    actions: tuple[tuple[str, dict[str, Any]], ...] = ()
    changes: tuple[MemoryChange, ...] = ()
    plain: str = ""  # the same where "it" and "them" were said, with what they stood for
    deeds: tuple[PastDeed, ...] = ()
    undone: int = 0  # so many errands before it never happened; it is none itself
    waited_s: float = 0.0  # it is none itself: so much time has passed, and people did the actions


def home_folder(name: str | Path) -> Path:
    """Return where a home lies: a name's place among all homes, or a folder as it is given."""
    path = Path(name)
    return path if path.is_absolute() or len(path.parts) > 1 else HOMES / path


def left_s(folder: Path) -> float:
    """Return the seconds by the clock since a home was left; 0 where there is none."""
    try:
        return max(time() - (folder / _LOG).stat().st_mtime, 0.0)
    except OSError:
        return 0.0


def homes() -> list[Path]:
    """Return all homes that go by a name, in the order of their names."""
    return sorted(one.parent for one in HOMES.glob(f"*/{_CARD}"))


class HomeStory:
    """All that happened in a home, errands and the times between them."""

    def __init__(self, card: HomeCard, story: list[PastErrand]) -> None:
        self.card, self._story = card, story
        self.past = [one for one in story if not one.waited_s]
        self.clock_s = sum(one.waited_s or len(one.actions) * ACTION_S for one in story)


def read_home(folder: Path) -> HomeStory:
    """Return what a home's log says; nothing there is changed, and it may be in use.

    Raises:
        FileError: it is damaged.
    """
    return HomeStory(_read_card(folder), _read(folder / _LOG))


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


def new_home(folder: Path, scene: str, world: World, *, people: int = 0) -> "KeptHome":
    """Begin a home where there is none; the world is to see that the scene is one.

    Raises:
        KarmaError: there is a home already, or no such scene.
    """
    if (folder / _CARD).exists():
        raise KarmaError(f"{folder}: there is a home already\n  To fix: karma home show {folder}")
    home = KeptHome(folder, scene, people=people)
    world.reset(home.scene)
    home.restore(world)
    return home


class KeptHome(HomeStory):
    """A home that one agent has for itself, as long as it lives.

    Args:
        folder: made where it is not there; None: nothing of it lasts.
        scene: what the world is reset to; of a home that is there it must be the same, "" for its
            own.
        people: who live there; None: as many as always, in a new home nobody.
        seed: of their days, where the home is new.

    Raises:
        FileError: it cannot be made, or a file in it is damaged: names the line.
        KarmaError: somebody is in it, or it is of another scene or of other people.
    """

    def __init__(
        self, folder: Path | None, scene: str = "", *, people: int | None = None, seed: int = 0
    ) -> None:
        self.folder, held = folder, ExitStack()
        self.leave = finalize(self, held.close)
        card, story = HomeCard(scene=scene or SCENE, people=people or 0, seed=seed), []
        if folder is not None:
            fix = "end what is at work there, or name another --home; karma chat --fresh needs none"
            held.enter_context(locked(folder, fix=fix))
            try:
                card = _card_of(folder, scene, people, card)
                _drop_torn(folder / _LOG)
                story = _read(folder / _LOG)
            except BaseException:
                self.leave()
                raise
        super().__init__(card, story)

    @property
    def scene(self) -> str:
        """What the world is reset to."""
        return self.card.scene

    def wait(self, seconds: float, done: Iterable[tuple[str, dict[str, Any]]] = ()) -> None:
        """Let time pass; what people did meanwhile is kept."""
        if seconds > 0:
            line = PastErrand(
                said="", status="", at_s=0.0, room="", waited_s=seconds, actions=tuple(done)
            )
            self._write(line)
            self._story.append(line)
            self.clock_s += seconds

    def restore(self, world: World) -> None:
        """Do again what was done, in a world that was just reset to the scene.

        It is a home from then on: a scene that there is not makes none.

        Raises:
            KarmaError: it ends otherwise than it was left.
        """
        if self.folder is not None and not (self.folder / _CARD).exists():
            write_atomic(self.folder / _CARD, to_json(self.card))
        last, same = self.past[-1] if self.past else None, True
        for errand in self._story:
            for action, arguments in errand.actions:
                world.step(action, **arguments)
            if errand is last:
                same = digest_of(world.last_event) == errand.room
        if not same:
            raise KarmaError(
                f"{self.folder}: the home cannot be made again as it was left: its scene was "
                f"edited, or other code kept it\n  To fix: karma home forget {self.folder}"
            )

    def add(
        self,
        said: str,
        status: str,
        actions: Sequence[Action],
        changes: Sequence[MemoryChange],
        event: Event,
        *,
        plain: str = "",
        deeds: Sequence[PastDeed] = (),
    ) -> None:
        """Keep an errand; it is on the disk when this returns."""
        errand = PastErrand(
            said=said,
            status=status,
            at_s=self.clock_s + len(actions) * ACTION_S,
            room=digest_of(event),
            actions=tuple((one.action, one.arguments) for one in actions),
            changes=tuple(changes),
            plain=plain,
            deeds=tuple(deeds),
        )
        self._write(errand)
        self.clock_s = errand.at_s
        self.past.append(errand)
        self._story.append(errand)

    def go_back(self, count: int) -> None:
        """Keep only the first so many errands."""
        if undone := len(self.past) - count:
            self._write(PastErrand(said="", status="", at_s=0.0, room="", undone=undone))
            self.clock_s -= sum(len(one.actions) for one in self.past[count:]) * ACTION_S
            del self.past[count:], self._story[-undone:]

    def _write(self, errand: PastErrand) -> None:
        """Write a line whole, or leave the log as it was.

        Raises:
            UnwritableError: it cannot be written.
        """
        if self.folder is None:
            return
        path = self.folder / _LOG
        size = path.stat().st_size if path.exists() else 0
        try:
            append_line(path, to_json(errand))
        except UnwritableError:
            with suppress(OSError):
                os.truncate(path, size)  # or the next line would go on from the torn one
            raise


def _read_card(folder: Path) -> HomeCard:
    return read_json(folder / _CARD, HomeCard, fix=f"karma home forget {folder}")


def _card_of(folder: Path, scene: str, people: int | None, new: HomeCard) -> HomeCard:
    if Path(scene).is_file():
        scene = str(Path(scene).resolve())
    if not (folder / _CARD).exists():
        return msgspec.structs.replace(new, scene=scene or SCENE)
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


def _read(path: Path) -> list[PastErrand]:
    """Return what happened and was not undone; a torn last line is passed over: nobody heard of it.

    Raises:
        FileError: another line is damaged.
    """
    try:
        lines = read_lines(path, PastErrand)
    except FileError as error:
        fix = f"karma home forget {path.parent}"
        raise FileError(path, error.reason, fix=fix) from error
    found: list[PastErrand] = []
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
