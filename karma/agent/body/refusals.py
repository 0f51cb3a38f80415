"""What a refusal says in full: the blocker, what is there now, and what would help.

The short reason is the world's, or what the nano planner was trained on; the detail is for
planners that can read. In it ids stand for things, until the prompt puts its names in their place.
"""

from collections.abc import Sequence

from karma.agent.body.sightings import Sightings
from karma.agent.planning.full_profile import stand_ins
from karma.agent.planning.inspector import TOLD, goes_where, takers
from karma.agent.planning.program import SKILL_OF
from karma.household.ids import root_id
from karma.household.places import SURFACES
from karma.types.memory import Known
from karma.types.observation import Reason, ReasonKind, SeenObject

NOT_FOUND = "could not find"  # how a search that left nothing out begins its refusal
_DO_FIRST = {
    "open": "is open and has to be closed before; do CloseObject(robot, '{it}') first",
    "on": "is on and has to be off before; do ToggleOff(robot, '{it}') first",
    "closed": "is closed; do OpenObject(robot, '{it}') first",
}  # kind of reason -> what it means
_TRY_OTHERS = {
    "broken": "is broken",
    "unreached": "could not be got at: something is in the way, or it is shut in",
}
_CANNOT = {one.takes: one.cannot for one in reversed(SKILL_OF.values()) if one.takes}


class RefusedError(Exception):
    """Why a skill cannot go on; becomes the reason of its result.

    `detail` says the reason in full, with ids; `why` is the world's, where it is the world's.
    """

    def __init__(self, reason: str, detail: str = "", why: Reason | None = None) -> None:
        super().__init__(reason)
        self.detail, self.why = detail or reason, why

    def is_for(self, *kinds: ReasonKind) -> bool:
        """Return whether the world refused for such a reason."""
        return self.why is not None and self.why.kind in kinds


def explained(
    why: Reason, target: Known, others: Sequence[str] = (), places: Sequence[str] = ()
) -> str:
    """Return the world's refusal of an action on an object as a planner can use it.

    `others` are ids of its type, `places` types that the agent knows of, the nearest first.
    """
    it = target.object_id
    if why.kind == "held":
        down = _put_down(it, target.object_type, places)
        return f"{it} is in the hand; put it down first{down}, then PickupObject(robot, 'Knife')"
    text = {**_DO_FIRST, **_CANNOT, **_TRY_OTHERS}.get(why.kind)
    if text is None:
        return f"{it}: {why.words}"
    more = of_its_kind(others) if why.kind in _TRY_OTHERS else ""
    return f"{it} {text.format(it=it)}{more}"


def of_its_kind(others: Sequence[str]) -> str:
    """Name the others of a thing's type that are known, or say that none is."""
    return f"; others of its kind: {_listed(others)}" if others else "; no other is known here"


def put_refused(
    refusal: RefusedError,
    held: SeenObject,
    target: Known,
    others: Sequence[Known],
    log: Sightings,
    places: Sequence[str],
) -> str:
    """Return why a receptacle did not take a thing, what is in it, and where the thing would go.

    "" where it is not to blame. `others` are of its type, `places` types that the agent knows of,
    the nearest first.
    """
    it, thing, kind = target.object_id, held.object_id, held.object_type
    if refusal.is_for("misplaced"):
        return f"{thing} cannot be placed in or on {it}; {goes_where(kind, it, places)}"
    if not refusal.is_for("full"):
        return ""
    inside = contents(it, log)
    holds = f"there is {_listed(inside)} in or on it" if inside else "there is no room in or on it"
    text = f"{it} is full: {holds}{of_its_kind([one.object_id for one in others])}"
    if not inside:
        return text
    down = f"put {thing} down first{_put_down(thing, kind, places, besides=target.object_type)}"
    return f"{text}. Make room: {down}, then PickupObject(robot, '{inside[0]}')"


def hand_full(held: SeenObject, places: Sequence[str]) -> str:
    """Return what to do with what is in the hand before another thing is picked up."""
    it = held.object_id
    down = _put_down(it, held.object_type, places)
    return f"the hand holds {it}; put it down first{down}"


def _put_down(it: str, kind: str, places: Sequence[str], besides: str = "") -> str:
    """Name where a thing may be put down: best where nothing is to be opened, or spoilt."""
    there = [one for one in takers(kind, places) if one != besides]
    there.sort(key=lambda one: one not in SURFACES)
    if not there:
        return f"; no place for it is known: Explore(robot, '{SURFACES[0]}')"
    text = f", e.g. PutObject(robot, '{it}', '{there[0]}')"
    return f"{text} ({_listed(there[1:])} would do too)" if there[1:] else text


def contents(receptacle_id: str, log: Sightings) -> list[str]:
    """Return the ids of what was last seen in or on a receptacle, one slice for all of a thing."""
    gone = {*log.missed, *log.cut, log.held_id}
    inside = [
        sight
        for object_id, sight in log.seen.items()
        if object_id not in gone
        if any(receptacle_id in (parent, root_id(parent)) for parent in sight.parent_ids)
    ]
    return list(dict.fromkeys(stand_ins(inside).values()))


def _listed(names: Sequence[str]) -> str:
    more = len(names) - TOLD
    return ", ".join(names[:TOLD]) + (f" and {more} more" if more > 0 else "")
