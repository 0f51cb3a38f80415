"""The table of simplifications says the numbers that the world goes by."""

import re
import tomllib

from support.paths import ROOT

DOC = (ROOT / "docs/world/simplifications.md").read_text(encoding="utf-8")
RULES = tomllib.loads((ROOT / "karma/world/core/rules.toml").read_text(encoding="utf-8"))
TYPES = tomllib.loads((ROOT / "karma/household/types.toml").read_text(encoding="utf-8"))["types"]
SAID = re.findall(r"`([\w.]+) = ([\d.]+)`", DOC)


def look_up(name):
    value = {"types": TYPES, **RULES}
    for part in name.split("."):
        value = value[part]
    return value


def test_numbers_in_the_table_are_those_of_the_rules():
    assert [(name, look_up(name)) for name, _ in SAID] == [(n, float(v)) for n, v in SAID]


def test_every_number_of_the_rules_stands_in_the_table():
    numbers = {
        f"{section}.{key}"
        for section, table in RULES.items()
        if isinstance(table, dict)
        for key, value in table.items()
        if isinstance(value, int | float) and not isinstance(value, bool)
    }
    assert numbers == {name for name, _ in SAID if not name.startswith("types.")}


def test_every_type_that_is_cut_stands_in_the_table():
    cut = {f"types.{name}.slice_count" for name, row in TYPES.items() if "slice_count" in row}
    assert cut - {name for name, _ in SAID} == {"types.Egg.slice_count"}  # an egg gives one
