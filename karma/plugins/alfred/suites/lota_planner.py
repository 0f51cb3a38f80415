"""LoTa-Bench's planners: one scores every skill step after step, one writes a whole list.

They are told a lead, examples, the instruction, the steps so far: parts and order are the source's,
the words are ours (`lota_alfred/prompt.toml`, `lota_alfred/examples.toml`).
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import msgspec

from karma.files import read_toml
from karma.plugins.alfred.eb_world.actions import DONE
from karma.plugins.alfred.eb_world.environment import Environment, Step
from karma.plugins.alfred.suites.players import BenchmarkAnswer, kept
from karma.types.completion import Scoring
from karma.types.planning import Prompt
from karma.types.roles import LanguageModel, ScoringModel

_HERE = Path(__file__).parent / "lota_alfred"
LONGEST = 200_000  # characters that are looked at
_MOST = 1_000  # items that are kept
_PUT = "put down "
_SPLIT = re.compile(r"[,;\n]+|\.\s+(?=[a-z])|(?<!step)\s+(?=\d{1,3}[.):])", re.IGNORECASE)
_NUMBERED = re.compile(
    r"^[\s\-*•]*(?:(?:step\s*)?\d+[.):]*\s*)?(?:robot:\s*)?(?:\d+[.):]*\s*)?", re.IGNORECASE
)
_ARTICLE = re.compile(r"\b(?:a|an|the)\s+")
Item = int | str  # a skill's number, or what is no skill


class _ListParts(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What stands around the parts where a whole list is asked for."""

    examples: str
    skills: str
    answer: str
    asked: str


class _PromptParts(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    lead: tuple[str, ...]
    again: str
    role: str
    whole: _ListParts


class StepExample(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An instruction and the steps that carry it out, in a trial that no task is of."""

    trial: str
    instruction: str
    steps: tuple[str, ...]
    failures: dict[str, str] = {}  # place of a step that fails, from 1 -> what is told of it


class LotaPromptOptions(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How a planner is asked."""

    examples: int = 6  # at most, one of each type of task
    failures: bool = False  # whether steps that failed are told: `use_predefined_prompt`
    max_tokens: int = 500  # of a whole list
    temperature: float = 0.0  # likewise


@cache
def _texts() -> _PromptParts:
    return read_toml(_HERE / "prompt.toml", _PromptParts)


@cache
def examples() -> tuple[StepExample, ...]:
    """Return the worked examples, those with failures last."""
    return read_toml(_HERE / "examples.toml", dict[str, tuple[StepExample, ...]])["example"]


def score_prompt(
    instruction: str, steps: Sequence[Step], options: LotaPromptOptions
) -> tuple[str, ...]:
    """Return the prompt that a skill follows, in segments: a step each that was taken."""
    asked = f"Human: {instruction.strip()}\nRobot: 1."
    failures = [
        _failure_phrase(step.feedback) if options.failures and not step.ok else "" for step in steps
    ]
    taken = [
        f" {step.name}{failure}, {place}."
        for place, (step, failure) in enumerate(zip(steps, failures, strict=True), 2)
    ]
    return (_shown("\n".join(_texts().lead) + "\n", options), asked, *taken)


def list_prompt(instruction: str, skills: Sequence[str], options: LotaPromptOptions) -> Prompt:
    """Return the prompt for a whole list."""
    texts = _texts()
    parts = [
        texts.role,
        f"{texts.whole.examples}\n{_shown('', options)}".rstrip(),
        texts.whole.skills % ", ".join(skills),
        texts.whole.answer,
    ]
    asked = texts.whole.asked % instruction.strip()
    return Prompt(stable="\n\n".join(parts) + "\n\n", changing=f"{asked}\n")


def _shown(lead: str, options: LotaPromptOptions) -> str:
    """Return the lead and the examples that are wanted."""
    plain = [one for one in examples() if not one.failures][: options.examples]
    failing = [one for one in examples() if one.failures] if options.failures else []
    lines = [*map(_example, plain), *([_texts().again] if failing else [])]
    return lead + "".join(f"{line}\n" for line in [*lines, *map(_example, failing)])


def _example(one: StepExample) -> str:
    said = [
        f"{place}. {step}{_failure_phrase(one.failures.get(str(place), ''))}"
        for place, step in enumerate(one.steps, 1)
    ]
    taken = ", ".join([*said, f"{len(said) + 1}. {DONE}."])
    return f"Human: {one.instruction}\nRobot: {taken}"


def _failure_phrase(failure: str) -> str:
    """Return how a failure is told behind its step."""
    reason = failure.removeprefix("Invalid: ").rstrip(".").lower()
    return f" (this action failed: {reason})" if reason else ""


# ----------------------------------------------------------------- asking


@dataclass(frozen=True, slots=True, kw_only=True)
class LotaAnswer(BenchmarkAnswer):
    """One planner call; of a score, `text` is the skill that was chosen."""

    score: float | None = None
    run_tokens: int | None = None  # of all skills, that had to be decoded to be sure
    named: int = 1  # skills in it, whether or not there are such
    unknown: int = 0  # those that there are not


@dataclass(slots=True, kw_only=True)
class ScoredPlayer:
    """Takes the skill that is likeliest to follow the steps so far.

    The source scores ` find a pen` as it stands, so that a skill which begins another one is never
    less likely under "sum". By default each is scored with the comma that would follow it, and the
    last one with its full stop.
    """

    model: ScoringModel
    options: LotaPromptOptions
    instruction: str
    scoring: Scoring
    answers: list[LotaAnswer] = field(default_factory=list)

    def plan(self, environment: Environment) -> Sequence[Item]:
        """Return one skill; ModelError where the prompt does not fit."""
        names = tuple(map(str, environment.actions))
        texts = tuple(followed(name, strict=environment.strict) for name in names)
        prompt = score_prompt(self.instruction, environment.steps, self.options)
        best = self.model.choose(prompt, texts, scoring=self.scoring)
        self.answers.append(
            LotaAnswer(
                text=names[best.number],
                characters=len(names[best.number]),
                prompt_tokens=best.prompt_tokens,
                completion_tokens=best.completion_tokens,
                score=best.score,
                run_tokens=best.run_tokens,
            )
        )
        return (best.number,)


@dataclass(slots=True, kw_only=True)
class GeneratedPlayer:
    """Writes a whole list in one answer, as chat models do in the source.

    `seed` is of its sampling.
    """

    model: LanguageModel
    options: LotaPromptOptions
    instruction: str
    seed: int
    answers: list[LotaAnswer] = field(default_factory=list)

    def plan(self, environment: Environment) -> Sequence[Item]:
        """Return the list; () where there is nothing in the answer, or where it was asked for.

        ModelError if the model cannot answer.
        """
        if self.answers:
            return ()
        names = tuple(map(str, environment.actions))
        said = self.model.complete(
            list_prompt(self.instruction, names, self.options),
            max_tokens=self.options.max_tokens,
            temperature=self.options.temperature,
            seed=self.seed,
        )
        plan = read_list(said.text, names, mend=not environment.strict)
        self.answers.append(
            LotaAnswer(
                named=len(plan),
                unknown=sum(isinstance(one, str) for one in plan),
                **kept(said),
            )
        )
        return plan


def followed(name: str, *, strict: bool) -> str:
    """Return a skill as it is scored."""
    mark = "" if strict else "." if name == DONE else ","
    return f" {name}{mark}"


def read_list(text: str, skills: Sequence[str], *, mend: bool = True) -> tuple[Item, ...]:
    """Return the skills of an answer in their order, up to the first that ends the list.

    `mend`: it may be written otherwise than in the source.
    """
    written = _bare_skill if mend else str
    known = {written(one): number for number, one in enumerate(skills)}
    puts = [number for number, one in enumerate(skills) if one.startswith(_PUT)]
    found: list[Item] = []
    for said in _items(text[:LONGEST], mend=mend):
        item: Item = known.get(written(said), said)
        if item == said and puts and written(said).startswith(_PUT):
            item = puts[0]  # whatever it names, it is what is held that goes
        found.append(item)
        if item == 0 or len(found) == _MOST:
            break
    return tuple(found)


def _items(text: str, *, mend: bool) -> Iterator[str]:
    if not mend:
        yield from (one.strip(" 1234567890.") for one in text.replace("Robot: ", "").split(","))
        return
    for one in _SPLIT.split(text):
        said = _NUMBERED.sub("", one).strip(" \t\r.'\"`[](){}*")
        if said:
            yield said


def _bare_skill(said: str) -> str:
    """Return a skill without capitals and articles.

    >>> _bare_skill("Find  an Arm chair")
    'find arm chair'
    """
    return " ".join(_ARTICLE.sub("", said.lower()).split())
