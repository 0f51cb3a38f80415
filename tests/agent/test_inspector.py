"""The inspector: searches are added, one hand is enough, and what cannot work is named."""

import re

import pytest

from karma.agent.planning.inspector import mend, objection
from karma.agent.planning.program import parse_program
from karma.types.memory import Area
from karma.types.planning import SkillCall

NODES = (
    Area(name="node_1", position_m=(0, 0, 0), contains=("Toilet",)),
    Area(name="node_2", position_m=(1, 0, 0), contains=("CounterTop",)),
)
MENDED = {
    "an unknown object is searched for before its first use": (
        "Go Mug, Pickup Mug", "Explore Mug, Go Mug, Pickup Mug", {}
    ),
    "a known object is not searched for": (
        "Go Mug_2, Pickup Mug_2", "Go Mug_2, Pickup Mug_2", {"known": {"Mug_2"}}
    ),
    "the search begins in the likeliest area": (
        "Pickup Mug", "Explore Mug [node_2], Pickup Mug", {"areas": NODES}
    ),
    "what is shut in is searched for": (
        "Go Egg, Pickup Egg", "Explore Egg, Pickup Egg", {"known": {"Egg"}, "shut": {"Egg"}}
    ),
    "what is put down first is what the hand holds": (
        "Put Bottle CounterTop", "Put Knife CounterTop",
        {"known": {"Bottle", "CounterTop"}, "held": "Knife"},
    ),
    "the full hand is freed on a known surface": (
        "Pickup Mug", "Put Knife DiningTable, Pickup Mug",
        {"known": {"Mug", "DiningTable"}, "held": "Knife"},
    ),
    "or on a surface to be found": (
        "Pickup Mug", "Explore CounterTop, Put Knife CounterTop, Pickup Mug",
        {"known": {"Mug"}, "held": "Knife"},
    ),
    "a thrown object has left the hand": (
        "Throw Knife, Pickup Mug", "Throw Knife, Pickup Mug", {"known": {"Mug"}, "held": "Knife"}
    ),
    "what is held is neither gone to nor picked up": (
        "Go Mug, Pickup Mug, Put Mug Sink", "Put Mug Sink",
        {"known": {"Mug", "Sink"}, "held": "Mug"},
    ),
    "what is held is put down before it is broken": (
        "Break Vase", "Put Vase Desk, Break Vase", {"known": {"Vase", "Desk"}, "held": "Vase"}
    ),
    "what is cut is not cut again, and no knife is fetched": (
        "Go Knife, Pickup Knife, Go Apple, Slice Apple, Pickup Apple", "Go Apple, Pickup Apple",
        {"known": {"Apple", "Knife"}, "cut": {"Apple"}},
    ),
    "what runs is switched off before its lid is moved": (
        "Close Laptop", "ToggleOff Laptop, Close Laptop",
        {"known": {"Laptop"}, "running": {"Laptop"}},
    ),
    "also what the program itself switched on": (
        "Close Microwave, ToggleOn Microwave, Open Microwave",
        "Close Microwave, ToggleOn Microwave, ToggleOff Microwave, Open Microwave",
        {"known": {"Microwave"}},
    ),
    "but nothing else": (
        "ToggleOn DeskLamp, Open Fridge", "ToggleOn DeskLamp, Open Fridge",
        {"known": {"DeskLamp", "Fridge"}},
    ),
}  # fmt: skip
SKILL = {"Go": "GoToObject", "Explore": "Explore", "ToggleOn": "ToggleOn"}


def program(text):
    calls = []
    for line in text.split(", "):
        skill, *objects = line.split()
        calls.append(SkillCall(skill=SKILL.get(skill, f"{skill}Object"), objects=tuple(objects)))
    return calls


def short(calls):
    return ", ".join(re.sub(r"To(?=Obj)|Object|\(robot,|[',)]", "", str(call)) for call in calls)


@pytest.mark.parametrize(("written", "wanted", "facts"), MENDED.values(), ids=MENDED)
def test_program_is_mended(written, wanted, facts):
    assert short(mend(program(written), **{"known": (), **facts})) == wanted


@pytest.mark.parametrize(
    ("program", "held", "reason"),
    [
        ("PickupObject(robot, 'Fridge')", None, "cannot be picked up"),
        ("SliceObject(robot, 'Plate')", None, "cannot be sliced"),
        ("ToggleOn(robot, 'Apple')", None, "cannot be switched"),
        ("OpenObject(robot, 'Apple')", None, "cannot be opened"),
        ("PutObject(robot, 'Apple', 'Fridge')", None, "the hand is empty"),
        ("PutObject(robot, 'Apple', 'Fridge')", "Mug", "the hand holds Mug, not Apple"),
        ("PutObject(robot, 'Pillow', 'Toaster')", "Pillow", "cannot be placed in Toaster"),
        ("PickupObject(robot, 'Apple')", "Mug", "the hand holds Mug"),
    ],
)
def test_line_that_cannot_work_is_named(program, held, reason):
    found = str(objection(parse_program(program), held=held))
    assert found.startswith(program) and reason in found
