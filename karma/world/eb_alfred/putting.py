"""Put what is held at a place, from seven poses: the benchmark's tries."""

from collections.abc import Iterator

from karma.household.ids import is_id, is_part, root_type
from karma.household.uses import BASIN_OF, BASINS
from karma.world.eb_alfred.choosing import Thing, nearest
from karma.world.sim import EmbeddedWorld

_LOOK_DEG = 15.0
_BEFORE: tuple[tuple[tuple[str, int], ...], ...] = (
    (),
    (("LookUp", 2),),
    (("LookDown", 4),),
    (("LookUp", 2), ("MoveBack", 1)),
    (("MoveAhead", 1), ("MoveRight", 4)),
    (("MoveLeft", 8),),
    (("MoveRight", 4),),  # the source also turns the hand, which changes nothing here
)


def put_at(world: EmbeddedWorld, target: str, *, basin_first: bool = True, strict: bool) -> bool:
    """Put what is held at a target; return whether that was done. The pose stays as tried last.

    Args:
        world: of the episode.
        target: id or type.
        basin_first: whether a basin is tried before what is nearer of it and its sink; unless
            strict, it always is, since here what lies on a rim lies in no basin.
        strict: whether it is tried at another object of the type after that.
    """
    last = ""
    parts_first = (basin_first or not strict) and root_type(target) in BASIN_OF
    for elsewhere in (False, True) if strict else (False,):
        other_than = last if elsewhere else ""
        for steps in _BEFORE:
            for place in _places(world, target, other_than, parts_first, strict):
                last = place
                _shift(world, steps)
                if _put_there(world, place):
                    return True
    return False


def is_basin(one: Thing) -> bool:
    """Return whether an object is the basin of a sink or bathtub."""
    return one["objectType"] in BASINS


def _places(
    world: EmbeddedWorld, target: str, other_than: str, parts_first: bool, strict: bool
) -> Iterator[str]:
    """Yield what is tried from one pose: the object itself, or the nearest of the type."""
    things = world.last_event.objects
    if is_id(target) and not other_than:
        basins = (one["objectId"] for one in things if is_basin(one))
        yield from (one for one in basins if is_part(one, of=target))
        yield target
        return
    word = root_type(target)
    for parts_only in (parts_first, not parts_first):
        found = nearest(things, word, parts_only=parts_only, other_than=other_than, any_lid=strict)
        if found is not None:
            yield found["objectId"]


def _shift(world: EmbeddedWorld, steps: tuple[tuple[str, int], ...]) -> None:
    for name, times in steps:
        more = {"degrees": _LOOK_DEG} if name.startswith("Look") else {}
        for _ in range(times):
            world.step(name, **more)


def _put_there(world: EmbeddedWorld, place: str) -> bool:
    """Put into what is in view, whether or not its type takes such things."""
    if place not in world.state.sight.visible:
        return False
    return world.step("PutObject", objectId=place, forceAction=True).success
