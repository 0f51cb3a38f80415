"""One episode of the benchmark: its actions, its limits, its score."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from karma.plugins.alfred.eb_world.actions import (
    EB_ALFRED,
    ActionTypes,
    NumberedAction,
    RoomProtocol,
    Thing,
    actions_in,
    names_in,
    skills_of,
)
from karma.plugins.alfred.eb_world.body import Body
from karma.plugins.alfred.replay.facts import RoomFacts
from karma.plugins.alfred.replay.goal import Conditions, conditions
from karma.plugins.alfred.replay.replay import FOV_DEG, REACH_M, fitted
from karma.plugins.alfred.replay.trial import Trial
from karma.types.space import Frame
from karma.world.sim import EmbeddedWorld

UNKNOWN = -1  # number of what is no action
_PICTURE_PX = 500
_LONGEST_NAME = 200  # characters of what is no action, that are kept
End = Literal["", "goal met", "steps", "invalid actions", "empty plan", "plan over", "done"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One action that was done."""

    number: int  # in the list; -1: it is not there
    name: str
    ok: bool
    feedback: str


class Environment:
    """The room of a trial, with the benchmark's actions.

    Args:
        strict: follow the source where it is odd.
        puts: counts of puts; given when they are to outlive episodes, as in the source.

    Raises:
        KarmaError: there is no such room.
    """

    def __init__(
        self,
        trial: Trial,
        facts: RoomFacts,
        types: ActionTypes,
        *,
        protocol: RoomProtocol = EB_ALFRED,
        strict: bool = False,
        puts: dict[str, int] | None = None,
    ) -> None:
        self.trial, self.protocol, self.strict = trial, protocol, strict
        self.world = EmbeddedWorld(
            fitted(trial, facts),
            visibilityDistance=REACH_M,
            fieldOfView=FOV_DEG,
            width=_PICTURE_PX,
            height=_PICTURE_PX,
        )
        self.actions: Sequence[NumberedAction] = (
            actions_in(types, self.things) if protocol.numbered else skills_of(types)
        )
        self.body = Body(
            world=self.world,
            names=names_in(self.actions),
            protocol=protocol,
            strict=strict,
            puts={} if puts is None else puts,
        )
        self.steps: list[Step] = []
        self._seen = [self.world.last_event]
        self.invalid = 0
        self.end: End = ""

    @property
    def things(self) -> Sequence[Thing]:
        """All objects as they are, for scripted players."""
        return self.world.last_event.objects

    @property
    def held(self) -> str | None:
        """Id of what is in the hand."""
        return self.world.state.held

    @property
    def conditions(self) -> Conditions:
        """How many of the goal's conditions are met now."""
        return conditions(self.trial, self.world.last_event.metadata, self.body.deeds)

    @property
    def goal_met(self) -> bool:
        """Whether all of them are."""
        return self.conditions.all_met

    def pictures(self, number: int) -> tuple[Frame, ...]:
        """Return what the robot saw after its last actions, now last; drawn when asked for."""
        return tuple(event.frame for event in self._seen[-number:] if number > 0)

    def step(self, choice: int | str) -> Step:
        """Do one action by its number; what is no action counts as one that failed.

        Raises:
            IndexError: there is no action of the number.
            ValueError: the episode has ended.
        """
        if self.end:
            raise ValueError(f"the episode has ended: {self.end}")
        if isinstance(choice, str):
            return self._taken(UNKNOWN, choice[:_LONGEST_NAME], "there is no such action")
        if not 0 <= choice < len(self.actions):
            raise IndexError(f"there is no action {choice}")
        action = self.actions[choice]
        message = "" if action.verb == "done" else self.body.act(action)
        step = self._taken(choice, str(action), message)
        if action.verb == "done":
            self.end = "done"
        elif self.protocol.stops_at_goal and self.goal_met:
            self.end = "goal met"
        return step

    def count_unusable(self) -> None:
        """Count an answer without a usable plan: an invalid action, but no step."""
        self.invalid += 1
        self._see_invalid()

    def give_up(self) -> None:
        """End the episode: there is nothing more to do."""
        self.end = "plan over" if self.steps and self.protocol.goes_on else "empty plan"

    def _taken(self, number: int, name: str, message: str) -> Step:
        feedback = f"Invalid: {message}." if message else "Done."
        step = Step(number=number, name=name, ok=not message, feedback=feedback)
        self.steps.append(step)
        self._seen.append(self.world.last_event)
        self.invalid += bool(message)
        if len(self.steps) >= self.protocol.most_steps:
            self.end = "steps"
        else:
            self._see_invalid()
        return step

    def _see_invalid(self) -> None:
        most = self.protocol.most_invalid
        if most is not None and self.invalid >= most:
            self.end = "invalid actions"
