"""What baselines share: what an instruction may cost, what usually lies where, what is asked."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from karma.agent.body.skills import Skills
from karma.contracts import PlanRequest, SeenObject
from karma.files import read_toml
from karma.household.pieces import base_type
from karma.household.uses import TAPS
from karma.memory.scene_graph import SceneGraph


@dataclass(slots=True)
class Budget:
    """What a body has spent of the most that one instruction may take."""

    skills: Skills
    steps: int  # world actions at most
    most_failures: int
    failures: int = 0

    @property
    def is_spent(self) -> bool:
        """Whether nothing more may be tried."""
        return self.skills.actions >= self.steps or self.failures >= self.most_failures

    @property
    def left(self) -> int:
        """How many world actions the next skill may take, at least 1."""
        return max(self.steps - self.skills.actions, 1)


def is_known_tap(name: str, skills: Skills) -> bool:
    """Return whether a name is that of a tap which the skill finds over the basin last used."""
    return name in TAPS and bool(skills.experience.handled_ids)


def request_for(
    instruction: str, held: SeenObject | None, furniture: SceneGraph | None = None, **more: Any
) -> PlanRequest:
    """Return a request: the instruction, what is in the hand, furniture where that is told."""
    return PlanRequest(
        instruction=instruction,
        areas=furniture.areas() if furniture else (),
        graph_text=furniture.to_text(edges=False) if furniture else "",
        held_id=held.object_id if held else None,
        held_type=held.object_type if held else None,
        **more,
    )


TABLE = Path(__file__).parent / "likely_places.toml"


@cache
def _table() -> Mapping[str, Mapping[str, float]]:
    return read_toml(TABLE, dict[str, dict[str, float]])


def likely_places(kind: str) -> Mapping[str, float]:
    """Return receptacle type -> share of such things, the likeliest first; {} for none counted.

    Stands for what the sources ask a large model (HELPER) or a trained network (CAPEAM). Counted in
    rooms of our generator that are in no task; the counter is in the history, at commit cb939ce.

    Raises:
        FileError: the table is damaged.
    """
    return _table().get(base_type(kind), {})
