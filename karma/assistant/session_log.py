"""The log of a session: each request, what it did to the room, and what memory learned from it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from karma.agent.seeing.perceive import digest_of
from karma.errors import KarmaError
from karma.journal.entries import Action
from karma.types.memory import MemoryChange
from karma.types.observation import SeenObject
from karma.types.roles import Event, World
from karma.world.sim import EmbeddedWorld

DEFAULT_SCENE = "kitchen_1"
CLOCK_START_S = 8 * 3600.0  # 8 a.m. on the first day, a Monday: when the clock of a log is at 0
ACTION_S = 1.0  # duration of an action on that clock
PLACE_TOLD, STATE_TOLD = "told", "told how it is"  # statuses of what a person only states
TOLD = (PLACE_TOLD, STATE_TOLD)


class PastAction(msgspec.Struct, frozen=True, kw_only=True):
    """An action that was requested or executed, by the object types it concerned."""

    deed: str  # the name of the action, or the verb of the request
    things: tuple[str, ...] = ()
    places: tuple[str, ...] = ()
    done: bool = False  # by a skill, or because the whole request succeeded


class PastRequest(msgspec.Struct, frozen=True, kw_only=True):
    """One request that was carried out or attempted, and all that it changed."""

    said: str
    status: str
    at_s: float  # when it ended, by the clock of the log
    room: str  # SHA-256 of the room's state at that time
    actions: tuple[tuple[str, dict[str, Any]], ...] = ()
    changes: tuple[MemoryChange, ...] = ()
    plain: str = ""  # the request without pronouns
    deeds: tuple[PastAction, ...] = ()
    undone: int = 0  # not a request: the n requests before it were undone
    waited_s: float = 0.0  # not a request: time passed, and residents did the actions


class SessionLog:
    """The requests of one session in a scene, in memory only.

    Args:
        scene: what the world is reset to; "": the default scene.
        story: requests and waiting times of earlier sessions, in order.
    """

    folder: Path | None = None  # where the log is kept on disk
    people = 0  # residents of the scene

    def __init__(self, scene: str = "", story: Sequence[PastRequest] = ()) -> None:
        self.scene = scene or DEFAULT_SCENE
        self._story = list(story)
        self.past = [one for one in story if not one.waited_s]
        self.clock_s = sum(one.waited_s or len(one.actions) * ACTION_S for one in story)

    def greeting(self) -> list[str]:
        """Return what is printed when a conversation begins."""
        return []

    def restore(self, world: World, simulator: EmbeddedWorld) -> None:
        """Repeat the logged actions in a world that was just reset.

        `simulator` is the world behind `world`, without its step log.

        Raises:
            KarmaError: the room ends in another state than the one that was logged.
        """
        del simulator
        for request in self._story:
            for action, arguments in request.actions:
                world.step(action, **arguments)
            is_last = bool(self.past) and request is self.past[-1]
            if is_last and digest_of(world.last_event) != request.room:
                raise KarmaError(self._cannot_restore())

    def _cannot_restore(self) -> str:
        return "the room cannot be restored as it was left"

    def add(
        self,
        said: str,
        status: str,
        actions: Sequence[Action],
        changes: Sequence[MemoryChange],
        event: Event,
        *,
        plain: str = "",
        deeds: Sequence[PastAction] = (),
    ) -> None:
        """Log a request."""
        request = PastRequest(
            said=said,
            status=status,
            at_s=self.clock_s + len(actions) * ACTION_S,
            room=digest_of(event),
            actions=tuple((one.action, one.arguments) for one in actions),
            changes=tuple(changes),
            plain=plain,
            deeds=tuple(deeds),
        )
        self._write(request)
        self.clock_s = request.at_s
        self.past.append(request)
        self._story.append(request)

    def wait(self, seconds: float, actions: Sequence[tuple[str, dict[str, Any]]] = ()) -> None:
        """Let time pass, in which residents did the actions."""
        if seconds > 0:
            line = PastRequest(
                said="", status="", at_s=0.0, room="", waited_s=seconds, actions=tuple(actions)
            )
            self._write(line)
            self._story.append(line)
            self.clock_s += seconds

    def go_back(self, count: int) -> None:
        """Keep only the first `count` requests."""
        if undone := len(self.past) - count:
            self._write(PastRequest(said="", status="", at_s=0.0, room="", undone=undone))
            self.clock_s -= sum(len(one.actions) for one in self.past[count:]) * ACTION_S
            del self.past[count:], self._story[-undone:]

    def chance_in_place(self, sight: SeenObject, seen_s: float) -> float | None:
        """Return the chance that an object is still where it was seen; None if nobody moves it."""
        del sight, seen_s
        return None

    def leave(self) -> None:
        """Release what the log holds on disk."""

    def _write(self, line: PastRequest) -> None:
        """Keep a line on disk; a log in memory does nothing."""
