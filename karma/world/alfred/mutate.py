"""Leave an action out of a demonstration: a replay that does not notice checks nothing."""

from karma.seeds import stream
from karma.world.alfred.trial import LowAction, Trial


def without_one(trial: Trial, seed: int) -> tuple[tuple[LowAction, ...], int | None]:
    """Return a trial's actions but one drawn by lot, and which it was.

    Each trial has a stream of its own, so the draw does not depend on which others are replayed.
    A trial without actions is returned as it is, with None.
    """
    actions = trial.plan.low_actions
    if not actions:
        return actions, None
    left_out = int(stream(seed, "alfred", "mutate", trial.id).integers(len(actions)))
    return (*actions[:left_out], *actions[left_out + 1 :]), left_out
