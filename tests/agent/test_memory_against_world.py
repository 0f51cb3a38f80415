"""After random deeds in kitchens, what memory claims of handled things is held against the world.

`KARMA_SEQUENCES=400 pytest tests/agent/test_memory_against_world.py` does 2,000 of them.
"""

import os
import random
from dataclasses import replace

import pytest
from support.experiences import begun
from support.household import kitchen

from karma.models.scripted import ScriptedModel
from karma.types.completion import Decoding
from karma.types.memory import MemoryUnit
from karma.types.tasks import SubTask
from karma.world.core import scene as scenes
from karma.world.sim import EmbeddedWorld

THINGS = ("Apple", "Potato", "Tomato", "Egg", "Mug", "Bowl", "Plate", "Spoon", "Bread", "Pan")
PLACES = (
    "CounterTop", "DiningTable", "Sink", "Fridge", "Microwave", "Bowl", "Plate", "Mug", "Pan",
    "GarbageCan", "Drawer", "Cabinet",
)  # fmt: skip
DOORS = ("Fridge", "Microwave", "Drawer", "Cabinet")
SWITCHES = ("Faucet", "Microwave", "CoffeeMachine", "Toaster", "StoveKnob", "CellPhone")
NEAR_M = 0.35  # a thing stands where memory has it, or beside it on the same place


def deed(draw):
    """One request's program: what a planner could say, sensible or not."""
    thing, place, door = draw.choice(THINGS), draw.choice(PLACES), draw.choice(DOORS)
    take = f"Explore(robot, '{thing}')\nPickupObject(robot, '{thing}')\n"
    opens, closes = (f"{skill}(robot, '{door}')\n" for skill in ("OpenObject", "CloseObject"))
    put = f"PutObject(robot, '{thing}', '{{}}')\n"
    water = "ToggleOn(robot, 'Faucet')\nToggleOff(robot, 'Faucet')\n"
    oven = "OpenObject(robot, 'Microwave')\n" + put.format("Microwave")
    oven += "CloseObject(robot, 'Microwave')\nToggleOn(robot, 'Microwave')\n"
    oven += "ToggleOff(robot, 'Microwave')\nOpenObject(robot, 'Microwave')\n"
    oven += f"PickupObject(robot, '{thing}')\n"
    cold = "OpenObject(robot, 'Fridge')\n" + put.format("Fridge") + "CloseObject(robot, 'Fridge')\n"
    return draw.choice((
        take + put.format(place), take + put.format(place), take, put.format(place),
        take + opens + put.format(door) + closes, opens, closes, opens + take,
        take + put.format("Sink") + water, take + oven, take + oven + cold, take + cold,
        f"ToggleOn(robot, '{draw.choice(SWITCHES)}')\n", f"EmptyObject(robot, '{thing}')\n",
        f"ToggleOff(robot, '{draw.choice(SWITCHES)}')\n", f"BreakObject(robot, '{thing}')\n",
        f"Explore(robot, 'Knife')\nPickupObject(robot, 'Knife')\nSliceObject(robot, '{thing}')\n",
        take + f"ThrowObject(robot, '{thing}')\n", water,
    ))  # fmt: skip


def sequence(room, folder, seed, deeds):
    """Do so many deeds; yields after each what memory claims that is not so, and the program."""
    draw = random.Random(seed)
    said = [deed(draw) for _ in range(deeds)]
    decoding = Decoding(attempts=1, inspected=False)
    episode, world = begun(
        folder, ScriptedModel(said), room=room, profile="full", decoding=decoding, attempts=1
    )
    for number, program in enumerate(said):
        list(episode.do(SubTask(instruction=f"deed {number}")))
        yield untrue(episode.memory.short_term.units(), world), program


def untrue(units, world):
    """What units of handled things claim that the world denies."""
    things = {one["objectId"]: one for one in world.last_event.metadata["objects"]}
    return [
        f"{unit.object_id} {unit.states} {unit.place_id} {unit.position_m}: {claim}"
        for unit in units
        if unit.handled
        for claim in _denied(unit, things.get(unit.object_id), things)
    ]


def _denied(unit, thing, things):
    if thing is None:
        yield "there is no such thing"
        return
    held = thing["isPickedUp"]
    parents = thing["parentReceptacles"] or ()
    if (unit.place_id == "hand") != held:
        yield f"in the hand: {held}"
    elif not held and unit.place_id is not None and unit.place_id not in parents:
        yield f"it lies in or on {parents}"
    elif not held:
        there = [thing["position"][axis] for axis in "xyz"]
        gap = sum((a - b) ** 2 for a, b in zip(unit.position_m, there, strict=True)) ** 0.5
        if gap > NEAR_M:
            yield f"it is at {there}"
    flags = {  # what was heated cools off by itself, and was heated all the same
        "opened": thing["isOpen"], "closed": thing["openable"] and not thing["isOpen"],
        "on": thing["isToggled"], "off": thing["toggleable"] and not thing["isToggled"],
        "dirty": thing["isDirty"], "filled": thing["isFilledWithLiquid"],
        "sliced": thing["isSliced"] or thing["objectType"].endswith(("Sliced", "Cracked")),
        "broken": thing["isBroken"], "cleaned": not thing["isDirty"],
        "heated": thing["temperature"] != "Cold", "cooled": thing["temperature"] != "Hot",
    }  # fmt: skip
    for state in unit.states:
        if not flags.get(state, True):
            yield f"not {state}"


SEQUENCES = int(os.environ.get("KARMA_SEQUENCES", "3"))  # in each room
DEEDS = 6
ROOMS = ("handmade", "kitchen_1", "kitchen_2", "kitchen_3", "kitchen_4")


@pytest.mark.parametrize("room", ROOMS)
def test_memory_claims_nothing_of_what_it_handled_that_is_not_so(room, tmp_path):
    scene = kitchen() if room == "handmade" else scenes.load(room)
    found, handled = {}, 0
    for seed in range(SEQUENCES):
        for number, (claims, program) in enumerate(sequence(scene, tmp_path, seed, DEEDS)):
            handled += "PickupObject" in program
            if claims:
                found[seed, number] = (program, claims)
    assert not found
    assert handled > SEQUENCES


APPLE = "Apple|+01.40|+00.85|-00.50"


@pytest.mark.parametrize(
    ("change", "claim"),
    [
        ({"place_id": "Bowl|+01.70|+00.84|-00.50"}, "it lies in or on"),
        ({"place_id": "hand"}, "in the hand"),
        ({"position_m": (0.0, 0.9, 1.2)}, "it is at"),
        ({"states": ("sliced",)}, "not sliced"),
        ({"object_id": "Apple|+09.00|+00.85|-00.50"}, "there is no such thing"),
        ({}, ""),
    ],
)
def test_claim_that_is_not_so_is_found(change, claim):
    world = EmbeddedWorld(kitchen())
    x, y, z = world.last_event.get_object(APPLE)["position"].values()
    unit = MemoryUnit(object_id=APPLE, object_type="Apple", position_m=(x, y, z), handled=True)
    found = untrue([replace(unit, **change)], world)
    assert len(found) == bool(claim)
    assert all(claim in one for one in found)
