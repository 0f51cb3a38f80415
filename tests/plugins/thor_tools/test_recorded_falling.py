"""What sinks through a basin without a floor is told from a recorded first event."""

import pytest
from msgspec.structs import replace
from support.household import kitchen, thing

from karma.plugins.thor_tools.importing.scenes import import_dump
from karma.plugins.thor_tools.recorded import with_falling
from karma.world.core.thing import moved

BASIN = next(one for one in kitchen().objects if one.type == "SinkBasin")  # its bottom at 0.78


def sponge(made=0.79, sunk=0.012, **state):
    """A sponge that was made at a height in the basin and has sunk since."""
    one = thing("DishSponge", (0.0, made, 1.15), (0.1, 0.02, 0.06), parents=(BASIN.id,), **state)
    return moved(one, (0.0, -sunk, 0.0))


def falling(*things):
    return [one.id for one in with_falling((BASIN, *things)) if one.is_falling]


def test_what_has_sunk_below_the_basin_that_it_was_made_in_is_falling():
    (found,) = falling(sponge())
    assert found.startswith("DishSponge")
    by_id = {one.id: one for one in with_falling((BASIN, sponge()))}
    assert by_id[found].parents == ()
    assert falling(replace(sponge(sunk=0.3), parents=())) == [found]  # it has left it


@pytest.mark.parametrize(
    "rests",
    [
        sponge(sunk=0.004),  # an id is rounded
        sponge(made=0.83),  # it comes to rest above the floor of the basin
        moved(sponge(made=0.77, sunk=0.0), (0.0, 0.003, 0.0)),  # a basin deeper than its box
        replace(sponge(), parents=("Cabinet|+00.00|+00.42|+01.15",)),
        replace(sponge(sunk=0.3), parents=(), id="DishSponge|surface|1|2"),
        replace(sponge(made=0.4, sunk=0.05), parents=()),  # it was made below
        moved(replace(sponge(), parents=()), (0.5, 0.0, 0.0)),
    ],
)
def test_what_rests_in_or_under_a_basin_is_not_falling(rests):
    assert falling(rests) == []


@pytest.mark.shared
def test_what_sinks_in_recorded_rooms_sinks_through_five_basins_with_all_that_is_in_them(shared):
    found = {}
    for scene in import_dump(shared / "data/thor5/scenes.jsonl.gz"):
        for one in with_falling(scene.objects):
            if one.is_falling:
                found.setdefault(scene.name, []).append(
                    float(one.id.split("|")[2]) - one.position[1]
                )
    assert sorted(found) == [f"FloorPlan{number}" for number in (1, 17, 20, 22, 5)]
    assert all(max(sunk) - min(sunk) < 0.05 for sunk in found.values())
