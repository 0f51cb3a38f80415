"""Houses on the first day: ids of all forms, types told by assets' names, starts, ids that stay."""

import random
from itertools import pairwise

import pytest
from support.tiny_house import tiny_house, xyz

from karma.errors import FileError
from karma.household.ids import type_of
from karma.household.types import object_types
from karma.plugins.thor_tools.importing.house_things import type_in
from karma.plugins.thor_tools.importing.procthor import house_scene

KINDS = ("Apple", "Mug", "ButterKnife", "SaltShaker", "CellPhone", "ToiletPaper", "CD", "TVStand",
         "CoffeeMachine", "Dresser", "Painting", "Pencil", "DishSponge", "AlarmClock")  # fmt: skip


def words_of(kind):
    """A type's words as assets write them: "coffee_machine"."""
    found = [kind[0]]
    for before, letter in pairwise(kind):
        found.append(f"_{letter}" if letter.isupper() and before.islower() else letter)
    return "".join(found)


def named(draw, kind, number):
    """An asset's name of a type, in one of the forms that houses have."""
    words = words_of(kind)
    return draw.choice((
        f"{kind}_{number}", f"{words}_{number}", f"{words.lower()}_{number}", f"{words}_I_{number}",
        f"RoboTHOR_{words.lower()}_{number}", f"{kind.upper()}_{number}_{draw.randint(1, 3)}",
        f"RoboTHOR{kind.lower()}aspelund", f"{kind.capitalize()}_{number}V",
    ))  # fmt: skip


def generated(seed):
    """A house whose ids and assets have forms of their own; returns it with its things' types."""
    draw = random.Random(seed)
    house, kinds = tiny_house(), {}
    house["objects"] = []
    for number in range(draw.randint(3, 12)):
        kind = draw.choice(KINDS)
        asset = named(draw, kind, number)
        identity = draw.choice((
            f"{number}|2", f"small|2|{number}", f"{asset}|2|{number}|0", f"surface|{number}|7|1",
            f"{kind}|2|{number}", f"{kind}|surface|2|{number}", f"{kind}|{number}",
        ))  # fmt: skip
        place = xyz(draw.uniform(0.5, 3.5), 1.0, draw.uniform(0.5, 3.5))
        house["objects"].append({"id": identity, "assetId": asset, "position": place})
        kinds[identity] = kind
    return house, kinds


@pytest.mark.parametrize("seed", range(50))
def test_each_thing_of_a_generated_house_is_there_with_its_type(seed):
    house, kinds = generated(seed)
    scene = house_scene(house, name="made")
    assert {one.name: one.type for one in scene.objects if one.type != "Floor"} == kinds
    assert "left out" not in scene.source
    for one in scene.objects:
        assert type_of(one.id) == one.type
        if type_of(one.name) == one.type and one.type != "Floor":
            assert one.id == one.name  # what tasks and trajectories of the house call it


@pytest.mark.parametrize(
    ("unknown", "known", "fails"), [(1, 2, False), (2, 2, False), (3, 2, True)]
)
def test_what_cannot_be_told_is_named_and_most_of_it_is_an_error(unknown, known, fails):
    house = tiny_house()
    house["objects"] = [
        {"id": f"{n}|2", "assetId": f"Thingy_{n}" if n < unknown else f"Mug_{n}",
         "position": xyz(1 + n / 4, 1, 1)}
        for n in range(unknown + known)
    ]  # fmt: skip
    if fails:
        with pytest.raises(FileError, match="of 3 of 5 the type cannot be told") as error:
            house_scene(house, name="made")
        assert "Thingy_0" in str(error.value)
    else:
        assert "Thingy_0" in house_scene(house, name="made").source


def test_told_start_stays_and_the_rooms_that_it_does_not_lead_to_are_named():
    house = tiny_house()
    house["doors"] = []
    for x, z, missed in ((1.0, 3.0, "bedroom_1"), (6.0, 1.0, "kitchen_1")):
        house["metadata"]["agent"]["position"] = xyz(x, 0.95, z)
        scene = house_scene(house, name="apart")
        start = scene.agent.position
        assert abs(start[0] - x) < 0.5 and abs(start[2] - z) < 0.5
        assert f"nobody can walk to {missed}" in scene.source
    del house["metadata"]["agent"]
    assert "nobody can walk to" in house_scene(house, name="apart").source


def test_all_types_are_told_by_their_own_names():
    for kind in object_types():
        if not kind.endswith(("Sliced", "Cracked", "Basin")):
            assert type_in(f"{words_of(kind)}_7") == kind
            assert type_in(f"{kind}_7") == kind
