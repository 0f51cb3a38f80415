"""Programs narrowed by types: what the expert writes is admitted, what no type allows is not."""

import os
from dataclasses import replace

import numpy as np
import pytest
from support.random_programs import random_program

from karma.agent.planning.inspector import narrowed, objection
from karma.agent.planning.program import OUR_SKILLS, SKILLS, parse_program
from karma.household.types import object_types
from karma.models.constraint import begins
from karma.types.planning import ProgramSpec

SAMPLE = int(os.environ.get("KARMA_SAMPLE", "0")) or 200  # of the 2,000 and 10,000
ROOM = (
    "Apple", "Apple_2", "Bread", "Cabinet_1", "CounterTop", "CreditCard", "Egg", "Faucet", "Fridge",
    "Knife", "Laptop", "LightSwitch", "Microwave", "Mug", "Plate", "Potato", "Sink", "StoveBurner",
)  # fmt: skip


def held_to_types(spec: ProgramSpec) -> ProgramSpec:
    return replace(spec, narrowed=narrowed(spec.skills, spec.objects))


def test_no_walk_says_what_its_types_never_allow():
    """A control beside it: without the narrowing such walks are most."""
    refused = []
    for narrow in (True, False):
        spec = ProgramSpec(skills=(*SKILLS, *OUR_SKILLS), objects=ROOM)
        spec = held_to_types(spec) if narrow else spec
        generator = np.random.default_rng(7)
        count = 0
        for _ in range(SAMPLE):
            calls = parse_program(random_program(spec, generator, 1), (*SKILLS, *OUR_SKILLS))
            found = objection(calls, held=None, known=set(ROOM))
            misplaced = found is not None and "cannot be placed" in found.reason
            count += found is not None and found.lasting and not misplaced
        refused.append(count)
    assert refused[0] == 0
    assert refused[1] > SAMPLE // 5


@pytest.mark.parametrize(
    ("line", "is_legal"),
    [
        ("ToggleOn(robot, 'Fridge')", False), ("ToggleOn(robot, 'StoveBurner')", True),
        ("SliceObject(robot, 'Egg')", True), ("SliceObject(robot, 'Plate')", False),
        ("PickupObject(robot, 'CounterTop')", False), ("PutObject(robot, 'Fridge')", False),
        ("PutObject(robot, 'Apple', 'CreditCard')", False), ("GoToObject(robot, 'Sink')", True),
        ("PutObject(robot, 'Apple_2', 'Plate')", True), ("OpenObject(robot, 'Laptop')", True),
    ],
)  # fmt: skip
def test_pairs_of_skill_and_type(line, is_legal):
    spec = held_to_types(ProgramSpec(skills=SKILLS, objects=ROOM))
    assert begins(spec.grammar, line) == is_legal


def test_what_no_table_knows_may_stand_anywhere():
    assert "Gizmo" not in object_types()
    lists = dict(narrowed(SKILLS, ("Gizmo", "Fridge")))
    assert lists["SliceObject"] == (("Gizmo",),)
    assert lists["PutObject"] == (("Gizmo",), ("Gizmo", "Fridge"))
