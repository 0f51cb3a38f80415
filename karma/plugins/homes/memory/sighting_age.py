"""The chance that an object is still where it was seen, in a home with residents."""

from collections.abc import Sequence

from karma.agent.seeing.perceive import place_of
from karma.assistant.session_log import CLOCK_START_S, PastRequest
from karma.household.pieces import base_type
from karma.plugins.homes.memory.ageing import HOUR_S, Ageing, home_prior
from karma.plugins.rules.talk.history import can_move
from karma.types.observation import SeenObject


def chance_in_place(
    past: Sequence[PastRequest], sight: SeenObject, seen_s: float, now_s: float
) -> float:
    """Return the chance that an object is still where it was seen.

    The prior of its type, from training homes, is sharpened by what this home showed: for each
    object that was seen twice, whether somebody else had moved it.
    """
    ageing = Ageing(home_prior().types)
    last: dict[str, tuple[str | None, float]] = {}
    for request in past:
        for change in request.changes:
            for seen in filter(can_move, change.seen):
                place, kind, at_s = place_of(seen), base_type(seen.object_type), request.at_s
                before, before_s = last.get(seen.object_id, (place, at_s))
                if at_s - before_s > HOUR_S:
                    found = dict(change.taken).get(seen.object_id, place)
                    hours = ageing.hours(kind, CLOCK_START_S + before_s, CLOCK_START_S + at_s)
                    ageing.learn(seen.object_id, kind, hours, moved=found != before)
                last[seen.object_id] = (place, at_s)
    kind = base_type(sight.object_type)
    hours = ageing.hours(kind, CLOCK_START_S + seen_s, CLOCK_START_S + now_s)
    return ageing.stays(sight.object_id, kind, hours)
