"""Facts of homes stand once, in `karma.household`; other modules of the package read them there."""

import ast
import re
from collections.abc import Iterator

import pytest
from support.paths import ROOT

from karma.household import places, uses
from karma.household.states import OPPOSITES
from karma.household.types import object_types

PACKAGE = ROOT / "karma"
HOME = PACKAGE / "household"
WORDS = {
    value
    for module in (uses, places)
    for name, value in vars(module).items()
    if name.isupper() and isinstance(value, str)
} | {*uses.BASINS, *uses.TAPS, *uses.KNIVES, *uses.LAMPS}
PIECE = re.compile(r"(?<!^is)(?<!^CanBe)(Sliced|Cracked)")  # not the flag and the action
CUTS_IDS = {"split", "rsplit", "partition", "rpartition", "startswith", "endswith"}
MANY = 6  # types in one row are a table of places or things
EXEMPT = {
    "plugins/training/drawing/phrases.py": "`|` parts an annotation's alternatives",
    "world/event_base.py": "`hand` is AI2-THOR's other name for a field of its metadata",
    "world/render/pixels.py": "`Floor` names a surface of a room, as Wall and Ceiling do",
}


def faults(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield the line and the reason of each fact in a module; texts of documentation are none."""
    told: set[int] = set()
    for node in ast.walk(tree):  # which yields a body's owner before its text
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and node.body:
            told.add(id(getattr(node.body[0], "value", None)))
        match node:
            case ast.Constant(value=str(text)) if id(node) not in told:
                if text in WORDS:
                    yield node.lineno, f"{text!r} has a name in karma.household"
                elif PIECE.search(text):
                    yield node.lineno, f"{text!r}: what a piece is called, household.pieces knows"
            case ast.Call(func=ast.Attribute(attr=name)) if name in CUTS_IDS:
                parts = [node.func.value, *node.args]
                if any(isinstance(part, ast.Constant) and part.value == "|" for part in parts):
                    yield node.lineno, f".{name} with '|': household.ids takes ids apart"
            case ast.JoinedStr(values=[*_, ast.FormattedValue(), ast.Constant(value="|")]):
                yield node.lineno, "f'{...}|': household.ids tells parts of an id"
            case ast.Compare(left=ast.Constant(value="|"), ops=[ast.In() | ast.NotIn()]):
                yield node.lineno, "'|' in a name: household.ids tells ids from types"
            case ast.Dict():
                for key, value in zip(node.keys, node.values, strict=True):
                    if _text(key) in OPPOSITES and OPPOSITES[_text(key)] == _text(value):
                        yield (
                            node.lineno,
                            f"{_text(key)!r} ends with its opposite: household.states",
                        )
            case ast.Tuple() | ast.List() | ast.Set():
                if sum(_text(one) in object_types() for one in node.elts) >= MANY:
                    yield node.lineno, "a row of object types: household.places or types.toml"


def _text(node: ast.expr | None) -> str:
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""


def test_every_fact_of_homes_stands_in_the_household_package_only():
    found = [
        f"{path.relative_to(ROOT)}:{line}: {reason}"
        for path in sorted(PACKAGE.rglob("*.py"))
        if HOME not in path.parents and str(path.relative_to(PACKAGE)) not in EXEMPT
        for line, reason in faults(ast.parse(path.read_text(encoding="utf-8")))
    ]
    assert not found, "\n".join(found)


def test_exempt_modules_need_it():
    for path in (PACKAGE / name for name in EXEMPT):
        if path.exists():  # a plug-in can be deleted
            assert any(faults(ast.parse(path.read_text(encoding="utf-8")))), path


@pytest.mark.parametrize(
    "fact",
    [
        'PART = {"Sink": 1}', 'TAPS = ("Faucet",)', 'kind == "StoveKnob"', 'place = "hand"',
        'kind.removesuffix("Sliced")', 'kind.endswith(("Sliced", "Cracked"))',
        'f"{name}Sliced"', 'one.split("|")[0]', 'one.rpartition("|")',
        'one.startswith(f"{whole}|")', '"|" in name', 'ENDS = {"opened": "closed"}',
        'ROW = ("Bed", "Desk", "Dresser", "Shelf", "SideTable", "Sofa")',
    ],
)  # fmt: skip
def test_fact_told_anew_is_found_with_its_line(fact):
    lines = {line for line, _ in faults(ast.parse(f"a = 1\n{fact}\n"))}
    assert lines == {2}


@pytest.mark.parametrize(
    "harmless",
    [
        '"""A `Sink|x|y|z|SinkBasin` is no Faucet."""', 'thing["isSliced"]', 'f"{a}|{b}"',
        'words = text.split(" | ")', 'CARRIED = ("Cup", "Bowl")', 'say = {"opened": "open"}',
        'def f():\n    """Return the SinkBasin."""',
    ],
)  # fmt: skip
def test_text_without_a_fact_is_let_be(harmless):
    assert not list(faults(ast.parse(harmless)))
