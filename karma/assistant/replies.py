"""Replies of an agent to a request: before it acts, while it acts, and afterwards.

A reply consists of lines, each with a mark for its kind: the terminal colours them, Python prints
them.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from textwrap import wrap
from typing import Literal

from karma.journal.records import SubTaskRecord, Turn
from karma.models.session import Spent
from karma.types.events import Check, Found, Plan, SkillResult
from karma.types.memory import MemoryChange
from karma.types.planning import End, EndKind

Status = Literal["done", "answered", "partly", "unfinished", "refused", "asked"]
Mark = Literal["said", "meant", "sure", "asked", "did", "failed", "seen", "not seen"]
_MARKS: Mapping[Found, Mark] = {
    "seen": "seen", "done": "seen", "otherwise": "not seen", "unseen": "not seen",
}  # fmt: skip
_STATUS_OF_END: Mapping[EndKind, Status] = {
    "tell": "answered", "ask": "asked", "refuse": "refused"
}  # fmt: skip
_WIDTH = 76  # columns of the announced actions, which may take several rows


@dataclass(frozen=True, slots=True)
class Line:
    """One line of an answer."""

    mark: Mark
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Meant:
    """A phrase of a request, and the objects it stands for in the room."""

    phrase: str
    things: tuple[str, ...] = ()  # "Apple on the counter top"; () where nothing is done with it

    def __str__(self) -> str:
        """Return it as people are told."""
        return f"{self.phrase} → {', '.join(self.things) or 'nothing that I would use'}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Understanding:
    """A request as the agent took it, printed before anything is done."""

    instruction: str
    meant: tuple[Meant, ...] = ()
    unnamed: tuple[str, ...] = ()  # what the program uses besides
    deeds: tuple[str, ...] = ()  # in their order
    forbidden: tuple[str, ...] = ()  # deeds that the request says not to do
    sure: str = ""
    refused: str = ""  # why it is not carried out
    question: str = ""  # that may help then
    offer: str = ""  # what "yes" asks for, where that answers the question
    candidates: tuple[str, ...] = ()  # types or things that the question offers


@dataclass(frozen=True, slots=True, kw_only=True)
class MemoryAnswer:
    """What is said without doing anything."""

    lines: tuple[str, ...]
    known: bool = True
    look: str = ""  # the instruction that "yes" asks for: it would find it out, or repair it
    refuses: bool = False  # it was an instruction, and is not carried out


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class RequestReply:
    """What became of one request."""

    instruction: str
    understood: tuple[Understanding, ...] = ()  # one for each answer of the planner that stood
    plans: tuple[Plan, ...] = ()
    results: tuple[SkillResult, ...] = ()  # of all programs
    checks: tuple[Check, ...] = ()
    finished: bool = False
    record: SubTaskRecord | None = None
    answer: MemoryAnswer | None = None  # to a question; nothing was done for it
    requested: frozenset[tuple[str, str]] = frozenset()  # deeds and object types, if parsed
    about: str = ""  # the words of the first object, if parsed
    elsewhere: tuple[str, ...] = ()  # what was not where it was remembered
    change: MemoryChange | None = None  # what memory learnt, if anything was done
    end: End | None = None  # how it ended, in tool and goal mode

    @property
    def refused(self) -> str:
        """Why it was not carried out; "" where it was tried."""
        return self.understood[-1].refused if self.understood else ""

    @property
    def status(self) -> Status:
        """Whether it was done, done in part, tried in vain, refused, or asked back about."""
        if self.answer is not None:
            return "refused" if self.answer.refuses else "answered"
        if self.end is not None and self.end.kind != "done":
            return _STATUS_OF_END[self.end.kind]
        if self.refused:
            return "asked" if self.asks else "refused"
        said_no = any(check.found == "otherwise" for check in self.checks)
        if self.finished and not said_no:
            return "done"
        done = any(check.found in ("seen", "done") for check in self.checks)
        return "partly" if self.finished or (said_no and done) else "unfinished"

    @property
    def asks(self) -> bool:
        """Whether an answer is waited for, in place of doing it."""
        refused = next((plan.refused for plan in reversed(self.plans) if plan.refused), None)
        return refused is not None and refused.kind in ("incomplete", "unclear", "which", "alike")

    def __repr__(self) -> str:
        return "\n".join(line.text for line in lines_of(self))


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class AgentReply:
    """What became of all that was said at once."""

    said: str
    parts: tuple[RequestReply, ...]
    stopped: str = ""  # the request that was, with all after it; no part

    @property
    def spent(self) -> tuple[Spent, ...]:
        """What hosted models cost, without the seconds."""
        return tuple(one for part in self.parts if part.record for one in part.record.hosted)

    @property
    def status(self) -> Status:
        """The worst of the parts: unfinished, done in part, asked back about, refused, done.

        "answered" where nothing but questions was asked.
        """
        every = {part.status for part in self.parts} | ({"unfinished"} if self.stopped else set())
        order: tuple[Status, ...] = ("unfinished", "partly", "asked", "refused", "done")
        return next((s for s in order if s in every), "answered")

    @property
    def checks(self) -> tuple[Check, ...]:
        """The checks of all parts."""
        return tuple(check for part in self.parts for check in part.checks)

    def __bool__(self) -> bool:
        """Return whether all was done, or answered."""
        return self.status in ("done", "answered")

    def __repr__(self) -> str:
        return "\n".join(line.text for part in self.parts for line in lines_of(part))


def turns_of(replies: Iterable[AgentReply]) -> list[Turn]:
    """Return a conversation as it is kept; what was done has the number of its instruction."""
    numbers = count()
    return [
        Turn(
            said=part.instruction,
            status=part.status,
            lines=tuple((line.mark, line.text.strip()) for line in lines_of(part)[1:]),
            instruction=None if part.record is None else next(numbers),
        )
        for reply in replies
        for part in reply.parts
    ]


def lines_of(part: RequestReply) -> list[Line]:
    """Return the lines of one request's reply."""
    before = [line for one in part.understood[:1] for line in lines_before(one)]
    again = [line for one in part.understood[1:] for line in lines_again(one)]
    return [Line("said", part.instruction), *before, *again, *lines_after(part)]


def lines_before(one: Understanding) -> list[Line]:
    """Return what is announced before the first action."""
    sure = [Line("sure", f"  sure: {one.sure}")] if one.sure else []
    if one.refused:
        return [*sure, *_refusal(one)]
    meant = [Line("meant" if said.things else "asked", f"  {said}") for said in one.meant]
    if one.unnamed:
        meant.append(Line("meant", f"  not named, but used: {', '.join(one.unnamed)}"))
    if one.forbidden:
        meant.append(Line("failed", f"  it says not to: {', '.join(one.forbidden)}"))
    doing = [Line("meant", f"  {row}") for row in wrap(f"I will {_few(one.deeds, 8)}", _WIDTH)]
    return [*meant, *doing, *sure]


def lines_again(one: Understanding) -> list[Line]:
    """Return what is announced when another program replaces one that has failed."""
    if one.refused:
        return _refusal(one)
    return [Line("meant", f"  again: I will {_few(one.deeds, 6)}")]


def lines_after(part: RequestReply) -> list[Line]:
    """Return what a request came to, and what the agent observed afterwards."""
    mark: Mark
    if part.answer is not None:
        mark = "seen" if part.answer.known else "not seen"
        return [Line(mark, f"  {text}") for text in part.answer.lines]
    if part.end is not None and part.end.kind != "done":
        mark = "seen" if part.end.kind == "tell" else "asked"
        prefix = "not done: " if part.end.kind == "refuse" else ""
        return [Line(mark, f"  {row}") for row in wrap(f"{prefix}{part.end.text}", _WIDTH)]
    if part.refused and not part.results:
        return []
    steps = sum(result.actions for result in part.results)
    places = sum(result.explorations for result in part.results)
    cost = f"{steps} step{'s' * (steps != 1)}" + (
        f", {places} place{'s' if places > 1 else ''} searched" if places else ""
    )
    if part.status == "done":
        outcome = Line("did", f"  done: {cost}")
    elif part.status == "partly":
        so = sum(check.found in ("seen", "done") for check in part.checks)
        outcome = Line("failed", f"  partly: {so} of {len(part.checks)} hold ({cost})")
    else:
        outcome = Line("failed", f"  not finished: {reason_of(part)} ({cost})")
    elsewhere = [Line("meant", f"  {text}") for text in part.elsewhere]
    checks = [Line(_MARKS[check.found], f"  {check}") for check in part.checks]
    return [outcome, *elsewhere, *checks]


def reason_of(part: RequestReply) -> str:
    """Return why a request came to nothing."""
    failed = next((result for result in reversed(part.results) if not result.ok), None)
    if failed is not None:
        return f"{failed.call}: {failed.reason}"
    error = next((plan.error for plan in reversed(part.plans) if plan.error), "")
    if not part.plans:
        return "I found nothing that it could be done to"
    return error or "the planner gave no program"


def lines_why(part: RequestReply) -> list[Line]:
    """Return what a request went by: the memory in the prompt, the program, and its results."""
    found = [Line("said", part.instruction)]
    if part.plans:
        remembered = ", ".join(unit.object_type for unit in part.plans[0].units) or "nothing"
        found.append(Line("meant", f"  remembered for it: {remembered}"))
    found += [line for one in part.understood[-1:] for line in lines_before(one)]
    found += [Line("failed", f"  answer refused: {p.error}") for p in part.plans if p.error][:2]
    for result in part.results:
        reason = f": {result.reason}" if result.reason else ""
        found.append(Line("did" if result.ok else "failed", f"  {result.call}{reason}"))
    return found


def _refusal(one: Understanding) -> list[Line]:
    return [Line("failed", f"  not done: {one.refused}"), Line("asked", f"  {one.question}")]


def _few(words: Sequence[str], most: int) -> str:
    shown = [*words[:most], *([f"{len(words) - most} more deeds"] if len(words) > most else [])]
    return ", ".join(shown) or "do nothing"
