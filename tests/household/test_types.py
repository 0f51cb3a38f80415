"""The table of object types is complete, consistent, and says what AI2-THOR 5.0.0 does."""

import json

import pytest
from support.paths import SHARED

from karma.errors import FileError, UnknownNameError
from karma.household.types import TABLE, WIDEST, object_type, object_types, read_types

FACTS = SHARED / "data/thor5/object_types.json"
CORRECTED = {"Bed", "Chair", "DogBed", "Desktop", "Floor", "Footstool", "LaundryHamper",
             "ShelvingUnit", "StoveBurner", "Stool"}  # fmt: skip


def test_types_count_is_125():
    assert len(object_types()) == 125


@pytest.mark.parametrize("kind", object_types().values(), ids=lambda kind: kind.name)
def test_type_names_only_types_and_holds_together(kind):
    types = object_types()
    receptacles = {name for name, other in types.items() if other.can("receptacle")}
    assert set(kind.goes_in or ()) <= receptacles
    assert kind.name not in (kind.goes_in or ())
    assert set(kind.accepts_only) <= set(types)
    assert not (kind.can("pickupable") and kind.can("moveable"))
    assert kind.can("sliceable") == (kind.slices_into is not None) == (kind.slice_count > 0)
    assert all(side > 0 for side in kind.size_m)
    assert (kind.mass_kg > 0) >= kind.can("pickupable")
    if kind.accepts_only:
        assert kind.can("receptacle")
        assert all(kind.name in types[other].goes_in for other in kind.accepts_only)


@pytest.mark.parametrize(
    ("receptacle", "takes"),
    [("StoveBurner", {"Pot", "Pan", "Kettle"}), ("CoffeeMachine", {"Mug"}),
     ("Toaster", {"BreadSliced"}), ("TowelHolder", {"Towel"}),
     ("HandTowelHolder", {"HandTowel"}), ("ToiletPaperHanger", {"ToiletPaper"})],
)  # fmt: skip
def test_receptacle_special_takes_exactly_its_types(receptacle, takes):
    place = object_type(receptacle)
    assert {kind.name for kind in object_types().values() if kind.fits(place)} == takes


@pytest.mark.parametrize(
    ("thing", "place"),
    [("Watch", "Bowl"), ("Pencil", "Bowl"), ("CreditCard", "Safe"), ("HandTowel", "GarbageCan")],
)
def test_type_fits_by_the_rules_of_2_1_0_what_5_0_0_refuses(thing, place):
    kinds = object_types()
    assert not kinds[thing].fits(kinds[place])
    assert kinds[thing].fits(kinds[place], WIDEST)


def test_rules_of_2_1_0_refuse_nothing_that_5_0_0_lets_in():
    kinds = object_types().values()
    assert all(a.fits(b, WIDEST) for a in kinds for b in kinds if a.fits(b))
    assert not object_types()["Book"].fits(object_types()["Fridge"], WIDEST)


def test_type_unknown_names_the_nearest():
    with pytest.raises(UnknownNameError, match=r"'Aple'.*Did you mean 'Apple'"):
        object_type("Aple")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [('"@basins"', '"@basin"', "no group named '@basin'"),
     ('"Microwave"', '"Micro"', "names 'Micro'"),
     ("slice_count = 3", "slices = 6", "slices"),
     ("slice_count = 3", 'slice_count = "six"', "slice_count"),
     ("slice_count = 3", "slice_count = ", "line")],
)  # fmt: skip
def test_types_damaged_table_says_where(tmp_path, old, new, said):
    path = tmp_path / "types.toml"
    path.write_text(TABLE.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")
    with pytest.raises(FileError, match=said) as caught:
        read_types(path)
    assert caught.value.path == path


@pytest.mark.shared
def test_types_agree_with_the_reference():
    reference = json.loads(FACTS.read_text(encoding="utf-8"))["types"]
    assert set(reference) == set(object_types())
    words = {"fillable": "canFillWithLiquid", "usedUp": "canBeUsedUp"}
    for name, row in reference.items():
        kind = object_type(name)
        listed = {*row["compatible_receptacles"], *row["compatible_receptacles_code_adds"]}
        assert listed & set(object_types()) <= set(kind.goes_in or listed), name
        if row["observed"]:
            sure = {flag for flag, share in row["observed"]["flags"].items() if share == 1.0}
            assert sure <= set(kind.capabilities), name
        if name not in CORRECTED:
            documented = {words.get(word, word) for word in row["properties"]}
            assert documented <= set(kind.capabilities), name
