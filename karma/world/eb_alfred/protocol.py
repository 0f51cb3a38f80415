"""What EB-ALFRED and its ancestor, LoTa-Bench's ALFRED, do differently in the same rooms.

Source: EmbodiedBench (arXiv 2502.09560), LoTa-Bench (arXiv 2402.08178).
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class RoomProtocol:
    """A benchmark's limits, and what its robot does with a body that is the same."""

    most_steps: int
    most_invalid: int | None  # None = any number
    stops_at_goal: bool  # else the goal is looked at when the planner is done
    goes_on: bool  # with a plan of which an action failed
    numbered: bool  # second and further things of a type have actions of their own
    stays_within_m: float  # what is in view and nearer than this is found without a step
    basin_first: bool  # a put tries a basin first, else what is nearer of it and its sink
    patience: int  # failed puts at a target, from which on one lets go
    drop_counts: bool  # letting go is done well, else it is a put that failed


EB_ALFRED = RoomProtocol(
    most_steps=30,
    most_invalid=10,
    stops_at_goal=True,
    goes_on=False,
    numbered=True,
    stays_within_m=0.0,
    basin_first=True,
    patience=3,
    drop_counts=True,
)
LOTA_ALFRED = RoomProtocol(
    most_steps=25,
    most_invalid=None,
    stops_at_goal=False,
    goes_on=True,
    numbered=False,
    stays_within_m=1.0,
    basin_first=False,
    patience=1,
    drop_counts=False,
)
