"""What an assistant is: it turns a person's text into instructions, and a report into words."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

from karma import registry
from karma.assistant.replies import RequestReply, Understanding
from karma.errors import UnknownNameError
from karma.models.manifest import read_manifest
from karma.types.events import Plan, SkillResult

DIRECT = "direct"  # the assistant of planners that want no other
Moment = Understanding | Plan | SkillResult | RequestReply  # what happens while an agent acts


class Said(Protocol):
    """One request of a text."""

    @property
    def text(self) -> str:
        """Its words, as they are carried out."""


@dataclass(frozen=True, slots=True)
class Resolved:
    """What a typed line asks for, given the conversation before it."""

    text: str  # a request, or a command that begins with a slash; "": nothing
    note: str = ""  # printed before it is carried out


SaidT = TypeVar("SaidT", bound=Said)


class Assistant(Protocol[SaidT]):
    """Made as `kind(agent)`; registered in the entry-point group `karma.assistants`."""

    def requests(self, text: str) -> Iterator[SaidT]:
        """Yield the requests of a text, each when the one before it was carried out."""

    def handle(self, said: SaidT, whole: str) -> Iterator[Moment]:
        """Carry out or answer one request of the text `whole`; yield its reply last."""

    def settled(self, parts: Sequence[RequestReply]) -> Sequence[RequestReply]:
        """Return the replies to a text as they stand after its last request."""

    def resolve(self, typed: str, *, at_terminal: bool) -> Resolved:
        """Return what a line that was typed asks for."""


def wanted_assistant(planner: str) -> str:
    """Return the assistant that a planner's manifest entry names, if it can be loaded."""
    found = (one.assistant for one in read_manifest().models if one.name == planner)
    wanted = next(found, "") or DIRECT
    try:
        registry.load("assistants", wanted)
    except UnknownNameError as error:
        if isinstance(error.__cause__, ModuleNotFoundError | None):  # the plug-in is not installed
            return DIRECT
        raise
    return wanted
