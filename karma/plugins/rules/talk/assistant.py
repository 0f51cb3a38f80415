"""The assistant `rules`: parses what a person says, answers from memory, checks what is planned."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.util import find_spec

from karma.agent.session import Executor
from karma.assistant.agent import Agent
from karma.assistant.protocol import Moment, Resolved
from karma.assistant.replies import AgentReply, MemoryAnswer, RequestReply, Understanding
from karma.household.pieces import base_type
from karma.plugins.rules.language.clauses import clauses_of, completed, context_left_out
from karma.plugins.rules.language.lexicon import Lexicon
from karma.plugins.rules.language.request import asked_last, check_length
from karma.plugins.rules.method import reader_of
from karma.plugins.rules.object_finder import Earlier, Progress
from karma.plugins.rules.request_executor import RequestExecutor, not_to_open
from karma.plugins.rules.talk import history, undone
from karma.plugins.rules.talk.offers import (
    corrected,
    is_no,
    is_yes,
    offered,
    pending,
    with_offer,
)
from karma.plugins.rules.talk.questions import answered, of_another
from karma.plugins.rules.talk.remembering import Remembering
from karma.plugins.rules.talk.telling import told_of
from karma.plugins.rules.types import Mention, Request, SaidDeed
from karma.plugins.rules.understanding import misspelt, understood
from karma.types.events import Plan
from karma.types.tasks import SubTask

if find_spec("spacy") is None:  # it is imported with the first sentence: far too late to say so
    raise ModuleNotFoundError("No module named 'spacy'", name="spacy")

MAX_ANTECEDENTS = 4  # mentions before the last one that "both" may refer to
EARLIER_REQUESTS = 3  # requests of earlier sessions that "it" may refer to
_COMMANDS = {
    "/why": ("why", "why not", "how come", "why did you do that"),
    "/undo": ("undo", "undo that", "undo it", "undo this", "take that back", "undo what you did"),
    "/look": ("/look", "go and see", "go and look", "look for it", "yes, look"),
}


@dataclass(frozen=True, slots=True)
class ParsedRequest:
    """One request or question of a text."""

    text: str
    asked: Request | None = None
    means: Mapping[str, str] = field(default_factory=dict)  # type -> id, by what it says of the log


class RulesAssistant:
    """Talks by rules of English; for small planners."""

    def __init__(self, agent: Agent) -> None:
        self._agent = agent
        self._lexicon = Lexicon(agent.embedder)
        self._reader = reader_of(agent.embedder)
        self._settled = Earlier()
        self._earlier = tuple(one.said for one in agent.home.past[-EARLIER_REQUESTS:])
        self._question = ""  # the last text if it was a question
        self._instruction = ""  # the last text if it was an instruction

    # ----------------------------------------------------------------- requests of a text

    def requests(self, text: str) -> Iterator[ParsedRequest]:
        """Yield the requests of a text; one that refers to the log after the rest is logged."""
        check_length(text)
        self._settled.decided.clear()
        *first, last = history.in_turn(text)
        for number, piece in enumerate(first):
            if not history.only_needs(piece, self._reader):  # "I still need it, put it back"
                yield from self._parsed(piece, first[:number])
        yield from self._parsed(last, first)

    def _parsed(self, text: str, ahead: Sequence[str]) -> list[ParsedRequest]:
        text = of_another(text, self._question, self._reader)
        text = corrected(text, self._instruction, self._reader)
        past = self._agent.home.past
        plain = history.in_plain_words(text, past, self._reader)
        read = self._reader.read(plain.text, *self._antecedents(ahead))
        usual = history.habits(past, self._reader)
        found: list[ParsedRequest] = []
        for request in context_left_out(read):
            unknown = (word for word in plain.unknown if word in request.text)
            unread = replace(request, unread=(*request.unread, *unknown))
            for clause, asked in clauses_of(unread):
                put = history.with_habits(asked, usual)
                words = clause if put is asked else put.errand
                found.append(ParsedRequest(words, put, plain.means))
        return found or [ParsedRequest(plain.text)]

    def _antecedents(
        self, ahead: Sequence[str]
    ) -> tuple[tuple[Mention, ...], tuple[SaidDeed, ...], tuple[Mention, ...]]:
        """Return the last mentions, the last deeds, and the mentions before the last."""
        last: tuple[Mention, ...] = ()
        older: tuple[Mention, ...] = ()
        deeds: tuple[SaidDeed, ...] = ()
        for text in (*self._earlier, *(reply.said for reply in self._agent.replies), *ahead):
            said = self._reader.read(text, last, deeds, older)
            named = (one for request in said for one in (*request.alone, *request.mentions))
            known = tuple(one for one in named if one.types)
            older = (*older, *last)[-MAX_ANTECEDENTS:] if known else older
            last = known or last
            for one in said:
                deeds = asked_last(one, deeds)
        return last, deeds, older

    # ----------------------------------------------------------------- one request

    def handle(self, said: ParsedRequest, whole: str) -> Iterator[Moment]:
        """Carry out one request, or answer it."""
        clause, asked, agent = said.text, said.asked, self._agent
        if asked and (answer := self._answer(clause, asked)) is not None:
            yield RequestReply(instruction=clause, answer=answer)
            return
        self._instruction = clause if asked is not None and asked.form == "errand" else ""
        subtask = SubTask(instruction=clause, whole=clause if asked else whole)
        reply = yield from agent.carry_out(
            subtask,
            lambda plan: self._described(clause, plan, asked),
            self._executor(subtask, asked, said.means) if asked is not None else None,
            keep_shut=not_to_open(asked) if asked is not None else (),
        )
        reply = replace(reply, requested=_requested(asked), about=_about(asked))
        done = reply.status == "done"
        deeds = tuple(history.deeds_of(asked, reply.results, done=done))
        if agent.log(reply, plain=history.in_plain(asked), deeds=deeds):
            reply = replace(reply, elsewhere=history.found_elsewhere(agent.home.past))
        yield reply

    def _executor(self, subtask: SubTask, asked: Request, means: Mapping[str, str]) -> Executor:
        reported = self._remembering().told()
        settled = replace(self._settled, owned=means, reported=reported)
        return lambda session: RequestExecutor(
            session, asked, settled, Progress(), subtask, is_clause=True
        ).carry_out()

    def _answer(self, clause: str, asked: Request) -> MemoryAnswer | None:
        """Answer a question, or learn what is stated; None if it is neither."""
        self._question = clause if asked.form == "question" else ""
        if asked.form == "question":
            return answered(asked, self._remembering(), self._reader)
        if asked.form not in ("statement", "teaching") and not history.is_taught(clause):
            return None
        told = told_of(asked, self._remembering(), self._agent.scene.name, self._reader)
        if told is None:
            return None
        if told.change is not None:
            self._agent.learn(clause, told.about, told.change)
        return told.answer

    def _remembering(self) -> Remembering:
        agent, room = self._agent, self._agent.known.room
        return Remembering(
            sights={name: (one, room.seen_s.get(name, 0.0)) for name, one in room.seen.items()},
            units={unit.object_id: unit for unit in agent.memory},
            furniture=agent.map.types(),
            past=agent.home.past,
            now_s=agent.home.clock_s,
            chance_in_place=agent.home.chance_in_place,
        )

    def _described(self, clause: str, plan: Plan, asked: Request | None) -> Understanding:
        agent = self._agent
        here = sorted({*agent.map.types(), *(unit.object_type for unit in agent.memory)})
        taken = understood(clause, plan, agent.where, self._lexicon, here)
        if asked is None:
            return taken
        if plan.refused is not None:
            slip = misspelt(plan.refused, self._lexicon, here)
            return with_offer(taken, clause, plan.refused, asked, slip)
        verbs = [deed.verb for deed in asked.forbidden]
        unused = (f"use the {one.text}" for one in asked.exclusions)
        return replace(taken, forbidden=(*verbs, *unused))

    # ----------------------------------------------------------------- the conversation

    def settled(self, parts: Sequence[RequestReply]) -> Sequence[RequestReply]:
        """Return replies whose checks take into account what a later request undid."""
        return undone.settled(parts)

    def resolve(self, typed: str, *, at_terminal: bool) -> Resolved:
        """Return what a line asks for: at a terminal it may answer what was asked back."""
        words, replies = typed.lower().rstrip(".!? "), self._agent.replies
        typed = next((name for name, those in _COMMANDS.items() if words in those), typed)
        if typed == "/look":
            answers = (part.answer for reply in replies[-1:] for part in reply.parts)
            typed = next((one.look for one in answers if one is not None and one.look), typed)
        return self._answer_to(typed, replies[-1]) if at_terminal and replies else Resolved(typed)

    def _answer_to(self, typed: str, last: AgentReply) -> Resolved:
        """Return the pending request, completed with what was typed if that answers it."""
        asked, offer = pending(last), offered(last)
        if is_no(typed) and (offer or asked):
            return Resolved("", "all right, I do nothing")
        if is_yes(typed) and offer:
            return Resolved(offer, f"so: {offer}")
        if asked is None or typed.startswith("/"):
            return Resolved(typed)
        if is_yes(typed):
            return Resolved("", asked.question)
        if any(one.form == "errand" for one in self._reader.read(typed)):
            return Resolved(typed, f"that in place of: {asked.text}")
        whole = completed(asked.text, typed, asked.about)
        return Resolved(whole, f"so: {whole}")


def _requested(asked: Request | None) -> frozenset[tuple[str, str]]:
    """Return the deeds that a request asks for, each with the types it is done to."""
    return frozenset(
        (deed.deed, base_type(kind))
        for deed in (asked.deeds if asked is not None else ())
        for thing in deed.things
        for kind in thing.types
    )


def _about(asked: Request | None) -> str:
    """Return the words of the first object of a request."""
    things = asked.deeds[0].things if asked is not None and asked.deeds else ()
    return things[0].text if things else ""
