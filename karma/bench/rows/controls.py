"""Rows that read no request: `idle` does nothing, `copying` does what the nearest example did."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Self

from karma.agent.karma import KarmaMethod, KarmaSettings
from karma.agent.options import settings_of
from karma.bench.rows.baseline import WithoutOptions
from karma.contracts import (
    Examples,
    Outcome,
    Plan,
    Resources,
    SceneRef,
    SkillResult,
    SubTask,
    WorkedExample,
    World,
)
from karma.errors import KarmaError
from karma.infer.scripted import ScriptedModel


class IdleMethod(WithoutOptions):
    """Ends each instruction at once: the floor that other rows stand on."""

    name = "idle"

    def begin(self, world: World, scene: SceneRef, *, seed: int, folder: Path) -> "IdleEpisode":
        """Start an episode."""
        return IdleEpisode()


class IdleEpisode:
    """One sequence of instructions, none of them carried out."""

    def enter(self, scene: SceneRef) -> None:
        """Note nothing."""

    def do(self, subtask: SubTask) -> Iterator[Plan | SkillResult | Outcome]:
        """End."""
        yield Outcome(finished=True, resident=(), handled_ids=())


_NONE = "row method 'copying' needs examples: profile = \"full\", examples = 1 or more in [models]"


class CopyingMethod(KarmaMethod):
    """What a model that is told examples has to beat: who copies has read no request."""

    settings_kind: ClassVar[type] = KarmaSettings

    @classmethod
    def build(cls, resources: Resources, options: Mapping[str, Any]) -> Self:
        """Make the row from KARMA's options.

        KarmaError if the run tells its planner no examples.
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
