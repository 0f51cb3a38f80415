"""LoTa-Bench's planners: one scores every skill step after step, one writes a whole list."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from karma.benchmarks.lota_alfred.prompt import LotaPromptOptions, list_prompt, score_prompt
from karma.contracts import LanguageModel, Scoring, ScoringModel
from karma.world.eb_alfred.environment import Environment
from karma.world.eb_alfred.skills import DONE

_KEPT = 20_000  # characters of an answer that a record keeps
LONGEST = 200_000  # characters that are looked at
_MOST = 1_000  # items that are kept
_PUT = "put down "
_SPLIT = re.compile(r"[,;\n]+|\.\s+(?=[a-z])|(?<!step)\s+(?=\d{1,3}[.):])", re.IGNORECASE)
_NUMBERED = re.compile(
    r"^[\s\-*•]*(?:(?:step\s*)?\d+[.):]*\s*)?(?:robot:\s*)?(?:\d+[.):]*\s*)?", re.IGNORECASE
)
_ARTICLE = re.compile(r"\b(?:a|an|the)\s+")
Item = int | str  # a skill's number, or what is no skill


@dataclass(frozen=True, slots=True, kw_only=True)
class LotaAnswer:
    """One planner call; of a score, `text` is the skill that was chosen."""

    text: str  # the first 20,000 characters
    characters: int  # of the whole
    prompt_tokens: int | None
    completion_tokens: int | None
    score: float | None = None
    run_tokens: int | None = None  # of all skills, that had to be decoded to be sure
    finish: str = ""  # of a list
    named: int = 1  # skills in it, whether or not there are such
    unknown: int = 0  # those that there are not
    cost: float | None = None


class ScoredPlayer:
    """Takes the skill that is likeliest to follow the steps so far.

    The source scores ` find a pen` as it stands, so that a skill which begins another one is never
    less likely under "sum". By default each is scored with the comma that would follow it, and the
    last one with its full stop.

    Args:
        model: tells log-probabilities.
        options: how it is asked.
        instruction: of the task.
        scoring: of a skill's tokens.
    """

    def __init__(
        self, model: ScoringModel, options: LotaPromptOptions, *, instruction: str, scoring: Scoring
    ) -> None:
        self._model, self._options = model, options
        self._instruction = instruction
        self._scoring: Scoring = scoring
        self.answers: list[LotaAnswer] = []

    def plan(self, environment: Environment) -> Sequence[Item]:
        """Return one skill; ModelError where the prompt does not fit."""
        names = tuple(map(str, environment.actions))
        texts = tuple(followed(name, strict=environment.strict) for name in names)
        prompt = score_prompt(self._instruction, environment.steps, self._options)
        best = self._model.choose(prompt, texts, scoring=self._scoring)
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


class GeneratedPlayer:
    """Writes a whole list in one answer, as chat models do in the source.

    Args:
        model: any.
        options: how it is asked.
        instruction: of the task.
        seed: of its sampling.
    """

    def __init__(
        self, model: LanguageModel, options: LotaPromptOptions, *, instruction: str, seed: int
    ) -> None:
        self._model, self._options = model, options
        self._instruction, self._seed = instruction, seed
        self.answers: list[LotaAnswer] = []

    def plan(self, environment: Environment) -> Sequence[Item]:
        """Return the list; () where there is nothing in the answer, or where it was asked for.

        Raises:
            ModelError: the model cannot answer.
        """
        if self.answers:
            return ()
        names = tuple(map(str, environment.actions))
        said = self._model.complete(
            list_prompt(self._instruction, names, self._options),
            max_tokens=self._options.max_tokens,
            temperature=self._options.temperature,
            seed=self._seed,
        )
        plan = read_list(said.text, names, mend=not environment.strict)
        self.answers.append(
            LotaAnswer(
                text=said.text[:_KEPT],
                characters=len(said.text),
                prompt_tokens=said.prompt_tokens,
                completion_tokens=said.completion_tokens,
                finish=said.finish,
                named=len(plan),
                unknown=sum(isinstance(one, str) for one in plan),
                cost=said.cost,
            )
        )
        return plan


def followed(name: str, *, strict: bool) -> str:
    """Return a skill as it is scored."""
    mark = "" if strict else "." if name == DONE else ","
    return f" {name}{mark}"


def read_list(text: str, skills: Sequence[str], *, mend: bool = True) -> tuple[Item, ...]:
    """Return the skills of an answer in their order, up to the first that ends the list.

    Args:
        text: as the planner gave it.
        skills: as they are written; the first one ends a list.
        mend: whether it may be written otherwise than in the source.
    """
    written = _plain if mend else str
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


def _plain(said: str) -> str:
    """Return a skill without capitals and articles.

    >>> _plain("Find  an Arm chair")
    'find arm chair'
    """
    return " ".join(_ARTICLE.sub("", said.lower()).split())
