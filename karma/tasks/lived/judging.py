"""Whether an answer is right, and whether an errand is done: by the world's truth alone."""

from collections.abc import Mapping

from karma.contracts import HomeAnswer, Sighting
from karma.tasks.lived.request import LivedRequest


def answered_rightly(
    request: LivedRequest, answer: HomeAnswer, now: Mapping[str, Sighting]
) -> bool:
    """Return whether a question was answered rightly.

    Args:
        request: with the truth when it was asked.
        answer: structured.
        now: truth when it was answered; what was moved meanwhile may be told by either.
    """
    if request.unknown or answer.unknown:
        return request.unknown and answer.unknown
    match request.asked:
        case "place":
            return answer.place_id is not None and answer.place_id in _right_places(request, now)
        case "count":
            return answer.count == request.count
        case "who":
            return answer.who == request.who
        case "time":
            return _within(request, answer.time_s)
        case _:
            return False


def room_right(request: LivedRequest, answer: HomeAnswer, now: Mapping[str, Sighting]) -> bool:
    """Return whether at least the room of an answer is right."""
    if request.unknown or answer.unknown:
        return request.unknown and answer.unknown
    rooms = {request.room} | {now[one].room for one in _here(request, now)}
    return bool(answer.room) and answer.room in rooms


def done(request: LivedRequest, now: Mapping[str, Sighting]) -> bool:
    """Return whether an errand is done: what was meant is where it was to be."""
    return any(
        now[one].place_id in request.destinations for one in request.object_ids if one in now
    )


def _right_places(request: LivedRequest, now: Mapping[str, Sighting]) -> set[str | None]:
    return {*request.places, *(now[one].place_id for one in _here(request, now))}


def _here(request: LivedRequest, now: Mapping[str, Sighting]) -> list[str]:
    """Return the things whose place of now is a right answer too: those asked for as of now."""
    if request.before_s is not None:  # it was asked where a thing was
        return []
    return [one for one in request.object_ids if one in now]


def _within(request: LivedRequest, time_s: float | None) -> bool:
    if time_s is None or request.after_s is None or request.before_s is None:
        return False
    return request.after_s <= time_s <= request.before_s
