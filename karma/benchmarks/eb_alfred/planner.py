"""A language model at play: asked for a plan, and anew when an action of it has failed."""

from collections.abc import Sequence
from dataclasses import dataclass

from karma.benchmarks.eb_alfred.answers import read_answer
from karma.benchmarks.eb_alfred.prompt import PromptOptions, plan_spec, render_prompt
from karma.contracts import Completion, LanguageModel
from karma.world.eb_alfred.environment import Environment

KEPT = 20_000  # characters of an answer that a record keeps
_AGAIN_TEMPERATURE = 0.6  # once an answer was of no use, the same again will not help


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannerAnswer:
    """One planner call."""

    text: str  # the first 20,000 characters
    characters: int  # of the whole
    finish: str
    prompt_tokens: int | None
    completion_tokens: int | None
    plan: tuple[int, ...]
    error: str = ""
    mended: bool = False
    no_json: bool = False
    cost: float | None = None
    constrained: bool | None = None  # a grammar held; None where it is not known


class PlannerPlayer:
    """Asks a language model for plans.

    Args:
        model: any.
        options: how it is asked.
        instruction: of the task.
        subset: of the task.
        seed: of its sampling.
    """

    def __init__(
        self,
        model: LanguageModel,
        options: PromptOptions,
        *,
        instruction: str,
        subset: str,
        seed: int = 0,
    ) -> None:
        self._model, self._options, self._seed = model, options, seed
        self._instruction, self._subset = instruction, subset
        self._texts: list[str] = []
        self._complaint = ""
        self.answers: list[PlannerAnswer] = []

    def plan(self, environment: Environment) -> Sequence[int] | None:
        """Return a plan; () gives up, None says that the answer is of no use.

        In the source a useless answer is followed by the same question again. By default the
        question then says what was wrong, and the answer is drawn.

        Raises:
            ModelError: the model cannot answer.
        """
        strict = environment.strict
        prompt = render_prompt(
            environment,
            self._instruction,
            self._subset,
            self._options,
            answers=self._texts,
            pictures=environment.pictures(self._options.pictures),
            complaint="" if strict else self._complaint,
        )
        again = bool(self._complaint) and not strict
        said = self._model.complete(
            prompt,
            spec=plan_spec(environment, self._options),
            max_tokens=self._options.max_tokens,
            temperature=_AGAIN_TEMPERATURE if again else self._options.temperature,
            seed=self._seed + len(self.answers),
        )
        found = read_answer(said.text, len(environment.actions), mend=not strict)
        self.answers.append(_answer(said, found.plan, found.error, found.mended, found.no_json))
        self._texts.append(said.text[:KEPT])
        self._complaint = found.error
        return None if found.error else found.plan


def _answer(
    said: Completion, plan: tuple[int, ...], error: str, mended: bool, no_json: bool
) -> PlannerAnswer:
    return PlannerAnswer(
        text=said.text[:KEPT],
        characters=len(said.text),
        finish=said.finish,
        prompt_tokens=said.prompt_tokens,
        completion_tokens=said.completion_tokens,
        plan=plan,
        error=error,
        mended=mended,
        no_json=no_json,
        cost=said.cost,
        constrained=said.constrained,
    )
