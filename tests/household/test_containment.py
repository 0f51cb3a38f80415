"""One table for expert and inspector: what goes where as it is, cut, or in a vessel."""

import pytest

from karma.agent.planning.expert import ExpertView, NamedThing, solve
from karma.agent.planning.inspector import objection
from karma.household.containment import brings, fits_whole_or_cut, goes_in
from karma.household.types import WIDEST, object_types, types_with
from karma.types.memory import Area
from karma.types.planning import SkillCall
from karma.types.tasks import Goal

WHOLE = [name for name, kind in object_types().items() if not kind.made_by_slicing]
CARRIED = [name for name in WHOLE if name in types_with("pickupable")]
RECEPTACLES = sorted(types_with("receptacle"))
ALL = ExpertView(
    things=tuple(NamedThing(name=name, object_type=name) for name in WHOLE),
    areas=(Area(name="node_1", position_m=(0.0, 0.0, 0.0), contains=tuple(WHOLE)),),
)


def put(thing, place):
    return SkillCall(skill="PutObject", objects=(thing, place))


def asked(predicate, thing, place):
    return [Goal(predicate=predicate, arguments=(thing, place))]


@pytest.mark.parametrize("place", RECEPTACLES)
def test_inspector_lets_through_what_the_expert_writes_for_every_type(place):
    for thing in CARRIED:
        program = solve(asked("INSIDE", thing, place), ALL)
        found = objection(program, held=None, known=WHOLE)
        way = fits_whole_or_cut(thing, place) or any(brings(one, thing, place) for one in WHOLE)
        if thing == place:
            continue
        if way:
            assert found is None, (thing, place, str(found))
        elif not fits_whole_or_cut(thing, place, WIDEST):
            assert found is not None, (thing, place)
            assert found.lasting, (thing, place)


@pytest.mark.parametrize("place", RECEPTACLES)
def test_inspector_calls_impossible_only_what_the_expert_has_no_way_for(place):
    for thing in CARRIED:
        found = objection([put(thing, place)], held=thing, known=WHOLE)
        if found is None or thing == place:
            continue
        program = [call for call in solve(asked("INSIDE", thing, place), ALL)]
        by_vessel = [call.objects for call in program if call.skill == "PutObject"]
        assert found.lasting == (len(by_vessel) < 2), (thing, place, by_vessel)
        if not found.lasting:
            assert f"it can be carried to {place}" in found.help


def test_laptop_comes_into_a_cabinet_in_a_box_and_the_refusal_says_so():
    program = solve(asked("INSIDE", "Laptop", "Cabinet"), ALL)
    puts = [call.objects for call in program if call.skill == "PutObject"]
    assert puts == [("Laptop", "Box"), ("Box", "Cabinet")]
    found = objection([put("Laptop", "Cabinet_2")], held="Laptop", known=["Cabinet_2", "Box"])
    assert not found.lasting
    assert found.help.endswith("goes in or on Box; in Box it can be carried to Cabinet_2")


def test_basin_counts_as_its_sink_and_what_holds_nothing_takes_nothing():
    assert goes_in("Mug", "Sink")
    assert not goes_in("ScrubBrush", "Television")
