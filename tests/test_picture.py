"""The picture of the flow is the program: arrow by arrow, held against the code."""

import ast
import re
from functools import cache

import pytest
from support.paths import ROOT

import karma

NODES = {
    "world": ["world/sim.py", "world/event.py"],
    "perceive": [f"agent/seeing/{name}.py" for name in (
        "perceive", "eyes", "projection")],
    "skills": ["agent/body"],
    "memory": ["memory"],
    "method": [f"agent/{name}.py" for name in (
        "karma", "loop", "memory", "session", "attempts", "experience", "tour", "knowledge")],
    "planner": ["agent/planning"],
    "models": ["models"],
}  # a stop of the picture -> where its code is  # fmt: skip

NOUNS = {
    name: node
    for path in sorted((ROOT / "karma/types").glob("*.py"))
    for node in ast.parse(path.read_text(encoding="utf-8")).body
    if isinstance(node, ast.ClassDef)
    for name in [node.name]
    if node.decorator_list or name == "Event"
}


def picture(text):
    """The first fenced or indented block with arrows in it, without its indent."""
    lines = [line.strip() for line in text.splitlines()]
    return [line for line in lines if re.search(r"\w+ -\w+-> \w+", line)]


def arrows(lines):
    """(from, noun, to) for every arrow; a stop may end one arrow and begin the next."""
    found = set()
    for chain in re.split(r",|\n", "\n".join(re.sub(r"^\w+ {2,}", "", line) for line in lines)):
        stops = re.split(r" -(\w+)-> ", chain.strip())
        found |= set(zip(stops[:-2:2], stops[1::2], stops[2::2], strict=True))
    return found


DRAWN = arrows(picture(karma.__doc__))


@cache
def trees(stop):
    paths = [ROOT / "karma" / name for name in NODES[stop]]
    files = [f for path in paths for f in (path.rglob("*.py") if path.is_dir() else [path])]
    return tuple(ast.parse(file.read_text(encoding="utf-8")) for file in files)


def named_in(node):
    """The nouns that an annotation speaks of."""
    parts = list(ast.walk(node)) if node is not None else []
    words = [part.id for part in parts if isinstance(part, ast.Name)]
    quoted = [str(part.value) for part in parts if isinstance(part, ast.Constant)]
    return {name for name in NOUNS if name in words or name in quoted}


@cache
def makes(stop):
    """The nouns that a stop's code constructs; an event is what a world returns."""
    calls = [n.func for tree in trees(stop) for n in ast.walk(tree) if isinstance(n, ast.Call)]
    made = {call.id for call in calls if isinstance(call, ast.Name) and call.id in NOUNS}
    return made | ({"Event"} if stop == "world" else set())


@cache
def takes(stop):
    """The nouns that functions of a stop take; an event is taken where its metadata is read."""
    nodes = [node for tree in trees(stop) for node in ast.walk(tree)]
    given = [n.args for n in nodes if isinstance(n, ast.FunctionDef)]
    taken = set().union(
        *(named_in(one.annotation) for args in given for one in (*args.args, *args.kwonlyargs))
    )
    reads = any(ast.unparse(n) == "event.metadata" for n in nodes if isinstance(n, ast.Attribute))
    return taken - {"Event"} | ({"Event"} if reads else set())


@cache
def inside(noun):
    """The nouns that travel in a noun's fields, at any depth."""
    fields = [line.annotation for line in NOUNS[noun].body if isinstance(line, ast.AnnAssign)]
    direct = set().union(*map(named_in, fields)) - {noun}
    return direct.union(*map(inside, direct))


def in_code():
    """Every (from, noun, to) where one stop constructs what another one takes."""
    return {
        (one, noun, other)
        for one in NODES
        for other in NODES
        if one != other
        for noun in makes(one) & takes(other)
    }


def test_every_arrow_of_the_picture_is_a_frozen_noun():
    for _, noun, _ in DRAWN:
        (decorator,) = NOUNS[noun].decorator_list or [None]
        assert noun == "Event" or "frozen=True" in ast.unparse(decorator), noun


def test_every_stop_of_the_picture_is_code_that_there_is():
    assert {stop for start, _, end in DRAWN for stop in (start, end)} == set(NODES)
    assert all(trees(stop) for stop in NODES)


def test_every_arrow_of_the_picture_is_taken_by_the_code():
    assert in_code() >= DRAWN


def test_every_noun_that_goes_from_stop_to_stop_is_drawn():
    """Save what travels inside another noun, or what the stop that takes it also makes itself."""
    for start, noun, end in sorted(in_code() - DRAWN):
        into = {other for _, other, stop in DRAWN if stop == end}
        nested = any(noun in inside(other) for other in into)
        assert nested or noun in makes(end), f"{start} -{noun}-> {end}"


def test_stops_that_import_one_another_are_joined_by_an_arrow():
    joined = {frozenset((start, end)) for start, _, end in DRAWN}
    of_module = {
        "karma." + name.removesuffix(".py").replace("/", "."): stop
        for stop, names in NODES.items()
        for name in names
    }
    for stop in NODES:
        nodes = [node for tree in trees(stop) for node in ast.walk(tree)]
        modules = {n.module for n in nodes if isinstance(n, ast.ImportFrom) and n.module}
        others = {
            s for m in modules for name, s in of_module.items() if f"{m}.".startswith(f"{name}.")
        }
        for other in others - {stop}:
            assert frozenset((stop, other)) in joined, f"{stop} imports {other}"


def test_only_perceive_reads_events():
    allowed = {ROOT / "karma/agent/seeing/perceive.py"}
    for path in (ROOT / "karma").rglob("*.py"):
        folder = path.relative_to(ROOT / "karma").as_posix()
        if path not in allowed and not folder.startswith(
            ("world/", "plugins/alfred/", "plugins/thor_tools/")
        ):
            text = path.read_text(encoding="utf-8")
            assert not re.search(r"event\.metadata|\.metadata\[", text), path


@pytest.mark.parametrize("page", ["README.md", "docs/architecture.md"])
def test_pages_show_the_same_picture(page):
    assert picture((ROOT / page).read_text(encoding="utf-8")) == picture(karma.__doc__)
