"""The method `rules`: the core's agent behind a parser of English, for small models."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Self

from karma import registry
from karma.agent.karma import KarmaMethod
from karma.agent.loop import KarmaAgent
from karma.agent.settings import KarmaSettings
from karma.plugins.rules.language.clauses import context_left_out
from karma.plugins.rules.language.lexicon import Lexicon
from karma.plugins.rules.language.request import RequestReader, asked_last
from karma.plugins.rules.object_finder import Earlier, Progress
from karma.plugins.rules.request_executor import RequestExecutor, not_to_open
from karma.plugins.rules.types import Mention, Parser, Request, SaidDeed
from karma.types.events import AgentEvent
from karma.types.roles import Embedder, Resources, World
from karma.types.space import SceneRef
from karma.types.tasks import SubTask


@cache
def _parser() -> Parser:
    parser: Parser = registry.load("parsers", "spacy")()
    return parser


def reader_of(embedder: Embedder | None) -> RequestReader:
    """Return a reader of requests; the parser is loaded once a process."""
    return RequestReader(_parser(), Lexicon(embedder))


def joined(requests: Sequence[Request]) -> Request | None:
    """Join the sentences of an instruction to a request, or return None for an empty text."""
    if not requests:
        return None
    requests = context_left_out(requests)
    errands = [one for one in requests if one.form == "errand"]
    if not errands or any(one.form in ("question", "incomplete") for one in requests):
        return next((one for one in requests if one.form != "errand"), requests[0])
    first = errands[0]
    return replace(
        first,
        errand=". ".join(one.errand for one in errands),
        deeds=tuple(deed for one in errands for deed in one.deeds),
        forbidden=tuple(deed for one in errands for deed in one.forbidden),
        exclusions=tuple(thing for one in errands for thing in one.exclusions),
        times=tuple(time for one in errands for time in one.times),
        conditions=tuple(one for errand in errands for one in errand.conditions),
        unread=tuple(word for one in errands for word in one.unread),
    )


@dataclass(frozen=True, eq=False)
class RulesMethod:
    """KARMA with a parser and a checker of English requests."""

    settings_kind: ClassVar[type] = KarmaSettings
    karma: KarmaMethod
    reader: RequestReader

    @property
    def name(self) -> str:
        """The row's name, by the memories that it lacks."""
        return self.karma.name

    @classmethod
    def build(cls, resources: Resources, options: Mapping[str, Any]) -> Self:
        """Make a row from its options, the fields of `KarmaSettings`."""
        return cls(KarmaMethod.build(resources, options), reader_of(resources.embedder))

    def begin(self, world: World, scene: SceneRef, *, seed: int, folder: Path) -> "RulesEpisode":
        """Start an episode: short-term memory empty, long-term memory loaded or explored."""
        agent = self.karma.begin(world, scene, seed=seed, folder=folder)
        return RulesEpisode(agent, self.reader)


class RulesEpisode:
    """An agent whose instructions are parsed before it carries them out."""

    def __init__(self, agent: KarmaAgent, reader: RequestReader) -> None:
        self.agent, self._reader = agent, reader
        self._mentioned: tuple[Mention, ...] = ()  # in the last instruction that was parsed
        self._deeds: tuple[SaidDeed, ...] = ()  # likewise
        self._earlier = Earlier()

    def enter(self, scene: SceneRef) -> None:
        """Be in a room; its first visit explores it."""
        self.agent.enter(scene)

    def do(self, subtask: SubTask) -> Iterator[AgentEvent]:
        """Parse an instruction and carry it out; yield answers, results and the report."""
        self._earlier.decided.clear()
        asked = joined(self._reader.read(subtask.instruction, self._mentioned, self._deeds))
        if asked is None:
            yield from self.agent.do(subtask)
            return
        self._mentioned = tuple(one for one in asked.mentions if one.types) or self._mentioned
        self._deeds = asked_last(asked, self._deeds)
        yield from self.agent.execute(
            subtask,
            lambda session: RequestExecutor(
                session, asked, self._earlier, Progress(), subtask
            ).carry_out(),
            keep_shut=not_to_open(asked),
        )
