"""The `copying` row: KARMA with the program of the nearest example in place of a model's answer."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, ClassVar, Self

from karma.agent.karma import KarmaMethod, KarmaSettings
from karma.agent.options import settings_of
from karma.contracts import Examples, Resources, WorkedExample
from karma.errors import KarmaError
from karma.infer.scripted import ScriptedModel

_NONE = "row method 'copying' needs examples: profile = \"full\", examples = 1 or more in [models]"


class CopyingMethod(KarmaMethod):
    """What a model that is told examples has to beat: who copies has read no request."""

    settings_kind: ClassVar[type] = KarmaSettings

    @classmethod
    def build(cls, resources: Resources, options: Mapping[str, Any]) -> Self:
        """Make the row from KARMA's options.

        Raises:
            KarmaError: the run tells its planner no examples.
        """
        settings_of(KarmaSettings, options)
        if resources.examples is None:
            raise KarmaError(_NONE)
        nearest = _Nearest(resources.examples)
        model = ScriptedModel(nearest.programs())
        copying = replace(resources, model=model, examples=nearest, hints=None, doubt=None)
        return super().build(copying, options)


class _Nearest:
    """Finds the examples of an instruction, and says the nearest one's program until the next."""

    def __init__(self, examples: Examples) -> None:
        self._examples, self._program = examples, ""

    def __call__(self, instruction: str) -> tuple[WorkedExample, ...]:
        found = tuple(self._examples(instruction))
        self._program = found[-1].program
        return found

    def programs(self) -> Iterator[str]:
        while True:
            yield self._program
