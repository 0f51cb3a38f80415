"""What a planner is told by rows that give it no memory."""

from typing import Any

from karma.contracts import PlanRequest, SeenObject
from karma.memory.scene_graph import SceneGraph


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
