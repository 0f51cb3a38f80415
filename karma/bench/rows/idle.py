"""The `idle` row: does nothing, so what it solves was solved before it was asked for."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

from karma.agent.options import settings_of
from karma.contracts import Outcome, Plan, Resources, SceneRef, SkillResult, SubTask, World


@dataclass(frozen=True, slots=True)
class _IdleOptions:
    pass


class IdleMethod:
    """Ends each instruction at once: the floor that other rows stand on."""

    name = "idle"
    settings_kind: ClassVar[type] = _IdleOptions

    @classmethod
    def build(cls, resources: Resources, options: Mapping[str, Any]) -> Self:
        """Make the row; it has no options."""
        settings_of(_IdleOptions, options)
        return cls()

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
