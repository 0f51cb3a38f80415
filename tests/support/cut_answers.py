"""What is carried out of an answer that may be cut; KARMA_CUTS=1 cuts at every place."""

import os

from karma.agent.planning.planner import Planner
from karma.types.completion import Decoding
from karma.types.memory import Area, MemoryUnit
from karma.types.planning import PlanRequest

AREAS = (Area(name="node_1", position_m=(0.0, 0.9, 0.0), contains=("Fridge", "Faucet", "Sink")),)
UNITS = tuple(
    MemoryUnit(object_id=f"{kind}|1", object_type=kind, position_m=(0, 0, 0))
    for kind in ("Apple", "Mug")
)
EVERY = bool(os.environ.get("KARMA_CUTS"))


def asked(model, said="Do it", **decoding):
    """What is carried out of one answer of a model."""
    request = PlanRequest(instruction=said, areas=AREAS, units=UNITS)
    (plan,) = Planner(model, "compact", Decoding(attempts=1, **decoding)).plan(request)
    assert plan.calls or plan.error or plan.refused
    return [str(call) for call in plan.calls]
