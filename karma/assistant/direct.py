"""The assistant `direct`: each text is one instruction, and the agent's report is the reply."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from karma.agent.planning.planner import grounded
from karma.agent.planning.refused import sentence
from karma.assistant.program_words import in_words
from karma.assistant.protocol import Moment, Resolved
from karma.assistant.replies import RequestReply, Understanding
from karma.types.events import Plan
from karma.types.tasks import SubTask

if TYPE_CHECKING:
    from karma.assistant.agent import Agent


@dataclass(frozen=True, slots=True)
class DirectRequest:
    """The whole text."""

    text: str


class DirectAssistant:
    """Passes each text to the agent as it is."""

    def __init__(self, agent: "Agent") -> None:
        self._agent = agent

    def requests(self, text: str) -> Iterator[DirectRequest]:
        """Yield the text."""
        yield DirectRequest(text.strip())

    def handle(self, said: DirectRequest, whole: str) -> Iterator[Moment]:
        """Have the text carried out, and log it."""
        subtask = SubTask(instruction=said.text, whole=whole)

        def described(plan: Plan) -> Understanding:
            return describe(said.text, plan)

        reply = yield from self._agent.carry_out(subtask, described)
        self._agent.log(reply)
        yield reply

    def settled(self, parts: Sequence[RequestReply]) -> Sequence[RequestReply]:
        """Return the replies as they are: a text is one request."""
        return parts

    def resolve(self, typed: str, *, at_terminal: bool) -> Resolved:
        """Return the line itself."""
        return Resolved(typed)


def describe(instruction: str, plan: Plan) -> Understanding:
    """Return what a plan will do, or why the planner refuses."""
    if plan.refused is not None:
        return Understanding(
            instruction=instruction,
            refused=sentence(plan.refused),
            question="What should I do instead?",
        )
    return Understanding(instruction=instruction, deeds=in_words(grounded(plan.calls, plan.names)))
