"""EB-ALFRED's planner: a language model asked for a plan, and anew when an action has failed.

It is told a role, rules, actions, examples, guidelines, the task, the history: parts and order are
the source's, the words are ours (`eb_alfred/prompt.toml`, `eb_alfred/examples.toml`).
"""

import ast
import json
import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from karma.files import read_toml
from karma.plugins.alfred.eb_world.environment import Environment, Step
from karma.plugins.alfred.suites.plan_spec import PlanSpec
from karma.plugins.alfred.suites.players import BenchmarkAnswer, kept
from karma.types.planning import Prompt
from karma.types.roles import LanguageModel
from karma.types.space import Frame

_HERE = Path(__file__).parent / "eb_alfred"
_AGAIN_TEMPERATURE = 0.6  # once an answer was of no use, the same again will not help
Kind = Literal["short", "long"]  # of examples: `long` for long_horizon


class _Texts(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    role: str
    rules: tuple[str, ...]
    guidelines: tuple[str, ...]
    answer: str
    seen: str


class PlanExample(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An instruction and a plan that carries it out, in a trial that no task is of."""

    kind: Kind
    trial: str
    instruction: str
    scene: str  # what a picture of it would show
    reasoning: str
    plan: tuple[str, ...]  # names of actions


class PromptOptions(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How a planner is asked."""

    examples: Annotated[int, Meta(ge=0)] = 10  # at most; long_horizon has seven
    feedback: bool = True  # whether it is told how actions went
    dialogue: bool = False  # whether it is told its earlier answers
    pictures: Annotated[int, Meta(ge=0)] = 0  # of what the robot saw last; 0 = text only
    max_tokens: Annotated[int, Meta(ge=1)] = 2048
    temperature: float = 0.0
    constrained: bool = False  # held to the form, by a grammar or schema
    most_text: Annotated[int, Meta(ge=0)] = 300  # then: characters of each text
    most_actions: Annotated[int, Meta(ge=1)] = 20  # and actions of a plan


@cache
def _texts() -> _Texts:
    return read_toml(_HERE / "prompt.toml", _Texts)


@cache
def examples(kind: Kind) -> tuple[PlanExample, ...]:
    """Return the worked examples of a kind."""
    found = read_toml(_HERE / "examples.toml", dict[str, tuple[PlanExample, ...]])
    return tuple(one for one in found["example"] if one.kind == kind)


def kind_of(subset: str) -> Kind:
    """Return the kind of examples that a list's tasks are shown."""
    return "long" if subset == "long_horizon" else "short"


def render_prompt(
    environment: Environment,
    instruction: str,
    subset: str,
    options: PromptOptions,
    *,
    answers: Sequence[str] = (),
    complaint: str = "",
    pictures: Sequence[Frame] = (),
) -> Prompt:
    """Return the prompt for the next plan.

    `answers` are earlier ones, told with `options.dialogue`; `complaint`: what was wrong with
    the last one (the source says nothing of it); of `pictures` the last is the newest.
    """
    texts = _texts()
    numbers = {str(one): number for number, one in enumerate(environment.actions)}
    chosen = examples(kind_of(subset))[: options.examples]
    shown = [_example(one, numbers, options) for one in chosen]
    parts = [
        texts.role.strip(),
        "## Rules\n" + _numbered(texts.rules),
        f"## Actions (0 to {len(numbers) - 1})\n"
        + "\n".join(f"{number}: {name}" for name, number in numbers.items()),
        *(f"## Example {place}\n{one}" for place, one in enumerate(shown, 1)),
        "## Guidelines\n" + _numbered(texts.guidelines),
    ]
    asked = [f"## Instruction\n{instruction}"]
    if environment.steps:
        asked.append("## Done so far\n" + _history(environment.steps, options.feedback))
    if options.dialogue and answers:
        asked.append("## Your earlier answers\n" + "\n".join(answers))
    if complaint:
        asked.append(f"## Your last answer could not be used\n{complaint}")
    asked.append(texts.answer.strip() % (texts.seen if options.pictures else ""))
    stable, changing = "\n\n".join(parts) + "\n\n", "\n\n".join(asked) + "\n"
    if environment.strict:  # the source sends one message
        return Prompt(stable="", changing=stable + changing, pictures=tuple(pictures))
    return Prompt(stable=stable, changing=changing, pictures=tuple(pictures))


def plan_spec(environment: Environment, options: PromptOptions) -> PlanSpec | None:
    """Return what an answer is held to: this room's actions; None where it is held to nothing."""
    if not options.constrained:
        return None
    seen = ("visual_state_description",) if options.pictures else ()
    return PlanSpec(
        texts=(*seen, "reasoning_and_reflection", "language_plan"),
        plan=PLAN,
        number=NUMBER,
        name="action_name",
        actions=tuple(map(str, environment.actions)),
        max_text=options.most_text,
        max_actions=options.most_actions,
    )


def _numbered(lines: Sequence[str]) -> str:
    return "\n".join(f"{number}. {line}" for number, line in enumerate(lines, 1))


def _example(one: PlanExample, numbers: dict[str, int], options: PromptOptions) -> str:
    """Return an example as a planner would answer; numbers are those of the room at hand."""
    seen = {"visual_state_description": one.scene} if options.pictures else {}
    answer = {
        **seen,
        "reasoning_and_reflection": one.reasoning,
        "language_plan": "; ".join(one.plan),
        PLAN: [
            {NUMBER: numbers[name], "action_name": name} for name in one.plan if name in numbers
        ],
    }
    return f"Instruction: {one.instruction}\n{msgspec.json.encode(answer).decode()}"


def _history(steps: Sequence[Step], feedback: bool) -> str:
    return "\n".join(
        f"{place}. action {step.number}, {step.name}" + (f": {step.feedback}" if feedback else "")
        for place, step in enumerate(steps)
    )


# ----------------------------------------------------------------- asking


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannerAnswer(BenchmarkAnswer):
    """One planner call."""

    plan: tuple[int, ...]
    error: str = ""
    mended: bool = False
    no_json: bool = False
    constrained: bool | None = None  # a grammar held; None where it is not known


@dataclass(slots=True, kw_only=True)
class PlannerPlayer:
    """Asks a language model for plans; `seed` is of its sampling."""

    model: LanguageModel
    options: PromptOptions
    instruction: str
    subset: str
    seed: int = 0
    answers: list[PlannerAnswer] = field(default_factory=list)

    def plan(self, environment: Environment) -> Sequence[int] | None:
        """Return a plan; () gives up, None says that the answer is of no use.

        In the source a useless answer is followed by the same question again. By default
        the question then says what was wrong, and the answer is drawn. ModelError if the
        model cannot answer.
        """
        strict = environment.strict
        complaint = self.answers[-1].error if self.answers and not strict else ""
        prompt = render_prompt(
            environment,
            self.instruction,
            self.subset,
            self.options,
            answers=[one.text for one in self.answers],
            pictures=environment.pictures(self.options.pictures),
            complaint=complaint,
        )
        said = self.model.complete(
            prompt,
            spec=plan_spec(environment, self.options),
            max_tokens=self.options.max_tokens,
            temperature=_AGAIN_TEMPERATURE if complaint else self.options.temperature,
            seed=self.seed + len(self.answers),
        )
        found = read_answer(said.text, len(environment.actions), mend=not strict)
        self.answers.append(
            PlannerAnswer(constrained=said.constrained, **asdict(found), **kept(said))
        )
        return None if found.error else found.plan


LONGEST = 200_000  # characters that are looked at
PLAN, NUMBER = "executable_plan", "action_id"
_DIGITS = re.compile(r"\d{1,6}")
_BEGINS = (
    re.compile(rf"{PLAN}\W{{0,3}}[:=]\s*(?=[\[{{])"),
    re.compile(rf"(?=\[\s*\{{\W{{0,3}}{NUMBER})"),
)
_COMMENT = re.compile(r"(?<=[\s,\]}])(?://|#)[^\n\"]*")
_COMMA = re.compile(r",(?:\s*(?:\.\.\.|…),?)?(\s*[\]}])")
_QUOTES = str.maketrans("“”„‟", '""""')
_CLOSES = {"{": "}", "[": "]"}
_TEXT_OR_BRACKET = re.compile(r'"[^"\\]*(?:\\.[^"\\]*)*"?|[][{}]', re.DOTALL)
_TRIES = 20  # beginnings of a list, and ends of each


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanReading:
    """What an answer says."""

    plan: tuple[int, ...] = ()
    error: str = ""  # why it is of no use; "" with an empty plan: the planner gives up
    mended: bool = False
    no_json: bool = False  # no JSON, or not of the form that was asked for


def read_answer(text: str, actions: int, *, mend: bool = True) -> PlanReading:
    """Return the plan of an answer, cut before the first number that no action has.

    `actions`: how many there are; `mend` broken JSON.
    """
    found, mended = _parsed(text, mend=mend)
    if not isinstance(found, dict) or not isinstance(found.get(PLAN), list):
        what = "there is no JSON object" if not isinstance(found, dict) else f"no list {PLAN!r}"
        return PlanReading(error=f"{what} in the answer", no_json=True)
    plan: list[int] = []
    for place, item in enumerate(found[PLAN]):
        number = _number(item, mend=mend)
        if number is None:
            error = f"{PLAN}[{place}] has no whole number {NUMBER!r}"
            return PlanReading(error=error, no_json=True)
        if not 0 <= number < actions:
            if plan:
                break
            return PlanReading(error=f"there is no action {number}; the last is {actions - 1}")
        plan.append(number)
        mended |= not isinstance(_number_of(item), int)
    return PlanReading(plan=tuple(plan), mended=mended)


def _number_of(item: Any) -> Any:
    return item.get(NUMBER) if isinstance(item, dict) else item


def _number(item: Any, *, mend: bool) -> int | None:
    said = _number_of(item) if mend or isinstance(item, dict) else None
    if mend and isinstance(said, str) and _DIGITS.fullmatch(said.strip()):
        said = int(said)
    if mend and isinstance(said, float) and said.is_integer():
        said = int(said)
    return said if isinstance(said, int) and not isinstance(said, bool) else None


def _parsed(text: str, *, mend: bool) -> tuple[Any, bool]:
    """Return the JSON of an answer, and whether it had to be mended; None where there is none."""
    text = text[:LONGEST]
    whole = _decoded(text.strip())
    if not mend or (isinstance(whole, dict) and isinstance(whole.get(PLAN), list)):
        return whole, False
    if isinstance(whole, str):  # JSON as a text in JSON
        return _parsed(whole, mend=False)[0], True
    plans = [
        plan
        for begins in _BEGINS
        for match in islice(begins.finditer(text), _TRIES)
        if (plan := _list(text[match.end() :])) is not None
    ]
    plan = next(filter(None, plans), next(iter(plans), None))
    return (whole, False) if plan is None else ({PLAN: plan}, True)


def _list(text: str) -> list[Any] | None:
    """Return the list that a text begins with, up to its last whole item; None for none at all."""
    text = _COMMENT.sub("", text).translate(_QUOTES)
    for body in islice(_closed(text), _TRIES):
        found = _read(_COMMA.sub(r"\1", body))
        items = [found] if isinstance(found, dict) else found
        if isinstance(items, list) and ... not in items:
            return items
    return None


def _read(text: str) -> Any:
    """Return what JSON, or a literal of Python, says; None where it is neither."""
    try:
        return json.loads(text, strict=False)
    except (ValueError, RecursionError):
        pass
    try:
        with warnings.catch_warnings(action="ignore"):
            return ast.literal_eval(text)
    except (ValueError, SyntaxError, MemoryError, RecursionError, TypeError):
        return None


def _decoded(text: str) -> Any:
    try:
        return msgspec.json.decode(text)
    except (msgspec.DecodeError, UnicodeError, RecursionError):
        return None


def _closed(text: str) -> Iterator[str]:
    """Yield the first value of a text, whole, then up to its items, the last one first.

    Brackets that are missing at an end are put there.
    """
    open_: list[str] = []
    ends: list[tuple[int, str]] = []
    for match in _TEXT_OR_BRACKET.finditer(text):
        char = match[0]
        if char in _CLOSES:
            open_.append(_CLOSES[char])
        elif open_ and char == open_[-1]:
            open_.pop()
            ends.append((match.end(), "".join(reversed(open_))))
            if not open_:
                break
    for end, missing in reversed(ends):
        yield text[:end] + missing
