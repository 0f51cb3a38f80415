"""Answer without a model: a script's texts, the simulator's own metadata, or nothing."""

from collections.abc import Iterable, Mapping, Sequence

from karma.errors import ModelError, RequestRefused
from karma.types.completion import END, Choice, Completion, Heard, Listener, Scoring
from karma.types.observation import SeenObject
from karma.types.planning import AnswerSpec, Prompt
from karma.types.space import Frame


class ScriptedModel:
    """A `LanguageModel` and `ScoringModel` that says texts in their order; specs are not applied.

    Attributes:
        prompts: the prompts it was given, in order.
        specs: the specs that came with them.
    """

    name = "scripted"

    def __init__(self, answers: Iterable[str] = ()) -> None:
        self._answers = iter(answers)
        self.prompts: list[Prompt] = []
        self.specs: list[AnswerSpec | None] = []
        self._lines: list[str] = []  # of the answer that `choose` is in

    def complete(
        self,
        prompt: Prompt,
        *,
        spec: AnswerSpec | None = None,
        max_tokens: int = 512,
        max_seconds: float | None = None,
        temperature: float = 0.0,
        seed: int = 0,
        listen: Listener | None = None,
    ) -> Completion:
        """Return the next answer, heard line by line; tokens are counted as words, times are zero.

        RequestRefused where the script has run out.
        """
        self.prompts.append(prompt)
        self.specs.append(spec)
        text = next(self._answers, None)
        if text is None:
            count = len(self.prompts) - 1
            raise RequestRefused(f"the script has run out: {count} answers, asked once more")
        for number, line in enumerate(text.splitlines(keepends=True), 1):
            if listen is not None:
                said = len(" ".join(text.splitlines()[:number]).split())
                listen(Heard(text=line, tokens=said, seconds=0.0))
        return Completion(
            text=text,
            finish="stop",
            prompt_tokens=len(prompt.text.split()),
            reused_tokens=0,
            completion_tokens=len(text.split()),
            first_token_s=0.0,
            total_s=0.0,
        )

    def choose(
        self, prompt: Sequence[str], continuations: Sequence[str], *, scoring: Scoring = "sum"
    ) -> Choice:
        """Choose the next line of the answers, `END` after each answer; others are passed over.

        RequestRefused where the script has run out.
        """
        self._pass_over(continuations)
        if not self._lines:
            whole = Prompt(stable=prompt[0], changing="".join(prompt[1:]))
            text = self.complete(whole).text
            self._lines = [one for line in text.splitlines() for one in (f"{line}\n", line)]
            self._lines.append(END)
            self._pass_over(continuations)
            if not self._lines:
                raise ModelError(f"the script's answer holds no line to choose: {text!r}")
        line = self._lines.pop(0)
        return Choice(
            number=continuations.index(line),
            score=0.0,
            prompt_tokens=len("".join(prompt).split()),
            reused_tokens=0,
            completion_tokens=len(line.split()),
            run_tokens=0,
            total_s=0.0,
        )

    def _pass_over(self, continuations: Sequence[str]) -> None:
        """Drop the lines before the first that can be chosen."""
        while self._lines and self._lines[0] not in continuations:
            del self._lines[0]


class MetadataVision:
    """A `VisionModel` that returns each object's own `states`, i.e. a reader without error."""

    name = "metadata"
    needs_pictures = False

    def read_states(
        self, image: Frame | None, instruction: str, objects: Sequence[SeenObject]
    ) -> Mapping[str, tuple[str, ...]]:
        """Return object id -> its states; picture and instruction are not looked at."""
        return {seen.object_id: seen.states for seen in objects}


class BlindVision:
    """A `VisionModel` that reads no state of anything: what a reader of pictures must better."""

    name = "blind"
    needs_pictures = False

    def read_states(
        self, image: Frame | None, instruction: str, objects: Sequence[SeenObject]
    ) -> Mapping[str, tuple[str, ...]]:
        """Return nothing, whatever is asked."""
        return {}
