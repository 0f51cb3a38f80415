"""What baselines share: what an instruction may cost, and a request without memory."""

from dataclasses import dataclass
from typing import Any

from karma.agent.body.skills import Skills
from karma.contracts import PlanRequest, SeenObject
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
