"""Oracle of the table of skill effects: every skill is run, and the world's truth decides.

A case is a program whose last call is the one under test. What the table says of it has to be true
afterwards, and of what can be carried nothing else may have changed.
"""

from dataclasses import replace

import pytest
from support.household import Believes, kitchen, on, thing

from karma.agent.body.skills import Skills
from karma.agent.planning.program import OUR_SKILLS, SKILLS, parse_program
from karma.agent.seeing.perceive import place_of, truth_of
from karma.household.ids import is_part, type_of
from karma.household.places import FLOOR, HAND
from karma.household.skill_effects import (
    SIDE_EFFECTS,
    SKILL_EFFECTS,
    BeliefState,
    Item,
    ItemPlace,
    changes,
    unmet,
)
from karma.household.types import object_types
from karma.world.sim import EmbeddedWorld

BURNT = "Go Pan, Pick Pan, Put Pan StoveBurner"
OVEN = "Open Microwave, Pick {0}, Put {0} Microwave, Close Microwave, On Microwave"
BY_PARTS = ("sliced", "broken")  # what is left lies somewhere else
CASES = {
    "go": "Go Apple",
    "explore": "Explore Spoon",
    "pick up": "Pick Apple",
    "put on": "Pick Apple, Put Apple CounterTop",
    "put into an open box": "Open Fridge, Pick Apple, Put Apple Fridge",
    "put near": "Pick Apple, PutNear Apple Knife",
    "throw": "Pick Apple, Throw Apple",
    "open": "Open Fridge",
    "close": "Open Drawer, Close Drawer",
    "close the fridge on something": "Open Fridge, Pick Apple, Put Apple Fridge, Close Fridge",
    "switch on": "SwitchOff LightSwitch, SwitchOn LightSwitch",
    "switch off": "SwitchOff LightSwitch",
    "toggle off": "ToggleOff LightSwitch",
    "slice": "Pick Knife, Slice Apple",
    "break": "Break Bowl",
    "crack": "Open Fridge, Break Egg",
    "pour out": "Pick Mug, Put Mug SinkBasin, On Faucet, Off Faucet, Empty Mug",
    "rinse": "Pick Plate, Put Plate SinkBasin, On Faucet",
    "fill": "Pick Mug, Put Mug SinkBasin, On Faucet",
    "rinse what lies in a bowl":
        "Pick Apple, Put Apple Bowl, Pick Bowl, Put Bowl SinkBasin, On Faucet",
    "microwave": OVEN.format("Apple"),
    "microwave cooks": OVEN.format("Potato"),
    "burner": f"{BURNT}, On StoveKnob",
    "burner cooks what lies in the pan": f"Pick Potato, Put Potato Pan, {BURNT}, On StoveKnob",
    "toaster": "Pick Knife, Slice Bread, Put Knife CounterTop, Pick BreadSliced, "
               "Put BreadSliced Toaster, On Toaster",
    "coffee machine": "Pick Mug, Put Mug CoffeeMachine, On CoffeeMachine",
}  # fmt: skip
SHORT = {
    "Go": "GoToObject", "Pick": "PickupObject", "Put": "PutObject", "Throw": "ThrowObject",
    "Open": "OpenObject", "Close": "CloseObject", "Slice": "SliceObject", "Break": "BreakObject",
    "Empty": "EmptyObject", "On": "ToggleOn", "Off": "ToggleOff",
}  # fmt: skip


class Room:
    """The handmade kitchen, the skills in it, and the calls of a short program by ids."""

    def __init__(self):
        scene = kitchen()
        table = next(one for one in scene.objects if one.type == "DiningTable")
        laptop = on(table, "Laptop", 1.6, 0.1, size=(0.3, 0.05, 0.2), is_toggled=True, openness=1.0)
        glass = thing("Window", (0.0, 1.6, -1.9), (0.8, 0.8, 0.05))
        scene = kitchen((laptop, glass))
        self.world = EmbeddedWorld(scene)
        self.skills = Skills(self.world, Believes(scene.objects))

    def truth(self):
        return truth_of(self.world.last_event)

    def id_of(self, kind):
        things = [one for one in self.truth().objects if one.object_type == kind]
        return next(
            one.object_id for one in things if "sliced" not in one.states or "Sliced" in kind
        )

    def call(self, line):
        skill, *kinds = line.split()
        names = ", ".join(repr(self.id_of(kind)) for kind in kinds)
        text = f"{SHORT.get(skill, skill)}(robot, {names})"
        (call,) = parse_program(text, (*SKILLS, *OUR_SKILLS))
        return replace(call, line=0)

    def run(self, call):
        return self.skills.run(call)

    def prepare(self, program):
        """Run all calls of a program but the last, and return that one."""
        *before, last = program.split(", ")
        for line in before:
            result = self.run(self.call(line))
            assert result.ok, (line, result.reason)
        return self.call(last)

    def beliefs(self):
        """The whole truth as beliefs."""
        truth = self.truth()
        held = next((Item(one) for one in truth.held_ids), None)
        carried = [one for one in truth.objects if one.pickupable]
        places = {Item(one.object_id): ItemPlace(place_of(one) or "") for one in carried}
        places |= {held: ItemPlace(HAND)} if held else {}
        states = {Item(one.object_id): frozenset(one.states) for one in truth.objects}
        return BeliefState(held, places, states)


def is_true(truth, change):
    """Return whether a change holds in the world, and what it deletes does not."""
    name, place = change.item.name, change.place
    one = next(one for one in truth.objects if one.object_id == name)
    states = {*one.states, *(("broken",) if one.broken else ())}
    states |= {"cleaned"} if name in truth.washed and "dirty" not in states else set()
    states |= {"heated"} if name in truth.heated else set()
    states |= {"cooled"} if name in truth.cooled else set()
    states |= {"coffee"} & {change.state} if "filled" in states else {"empty"}
    states |= {"toasted"} if "cooked" in states else set()
    if type_of(name) == "Egg" and change.state == "broken":  # it runs out
        states |= {"broken"} if any(is_part(o.object_id, name) for o in truth.objects) else set()
    if place is None:
        return change.state in states and states.isdisjoint(change.deletes)
    if place.name == HAND:
        return name in truth.held_ids
    if place.name == FLOOR or place.beside:
        return name not in truth.held_ids
    return place.name in one.parent_ids and name not in truth.held_ids


def unsaid(before, truth, said):
    """Return what changed of things that can be carried and that no change says."""
    states = {(change.item.name, change.state) for change in said}
    states |= {(change.item.name, word) for change in said for word in change.deletes}
    moved = {change.item.name for change in said if change.place or change.state in BY_PARTS}
    was = {one.object_id: one for one in before.objects if one.pickupable}
    found = set()
    for one in truth.objects:
        if (old := was.get(one.object_id)) is None:
            continue  # a piece
        changed = set(one.states) ^ set(old.states)
        found |= {(one.object_id, word) for word in changed} - states
        if place_of(one) != place_of(old) and not moved & {one.object_id, place_of(old)}:
            found.add((one.object_id, place_of(one)))  # contents stay in what is moved
    return found


@pytest.mark.parametrize("program", CASES.values(), ids=CASES)
def test_what_the_table_says_of_a_call_is_what_the_world_does(program):
    room = Room()
    call = room.prepare(program)
    before, beliefs = room.truth(), room.beliefs()
    assert unmet(call, beliefs) == ()
    said = changes(call, beliefs)
    result = room.run(call)
    assert result.ok, result.reason
    truth = room.truth()
    assert [change for change in said if not is_true(truth, change)] == []
    assert unsaid(before, truth, said) == set()


def test_every_skill_and_side_effect_has_a_case():
    skills, effects = set(), set()
    for program in CASES.values():
        room = Room()
        call = room.prepare(program)
        skills.add(call.skill)
        said = {(one.item.name, one.state) for one in changes(call, room.beliefs())}
        for effect in SIDE_EFFECTS:
            kinds = {type_of(name) for name, state in said if state in effect.adds}
            if call.skill != "EmptyObject" and any(
                type_of(call.objects[0]).replace("Knob", "Burner") in effect.of for _ in kinds
            ):
                effects.add(effect)
    assert {*SKILL_EFFECTS} == {skill.name for skill in (*SKILLS, *OUR_SKILLS)}
    assert skills | {"ToggleOn"} == {*SKILL_EFFECTS}
    assert effects == {*SIDE_EFFECTS}


UNMET = {
    ("PickupObject", "empty hand"): "Pick Apple, Pick Mug",
    ("PutObject", "held"): "Put Apple CounterTop",
    ("PutObject", "opened"): "Pick Apple, Put Apple Fridge",
    ("PutNear", "held"): "PutNear Apple Knife",
    ("ThrowObject", "held"): "Throw Apple",
    ("OpenObject", "off"): "On Microwave, Open Microwave",
    ("CloseObject", "off"): "Close Laptop",
    ("SwitchOn", "closed"): "Open Microwave, SwitchOn Microwave",
    ("ToggleOn", "closed"): "Open Microwave, On Microwave",
}
NOT_OF_THE_WORLD = {
    ("SliceObject", "knife"),  # ALFRED's rule: AI2-THOR cuts without one
    ("BreakObject", "not held"),  # ours: pieces would fall where the agent stands
}


@pytest.mark.parametrize(("skill", "need"), UNMET, ids=map(" ".join, UNMET))
def test_call_whose_precondition_is_not_met_is_refused_by_the_world(skill, need):
    room = Room()
    call = room.prepare(UNMET[skill, need])
    assert call.skill == skill
    assert unmet(call, room.beliefs()) == (need,)
    assert not room.run(call).ok


def test_every_precondition_has_a_case():
    needed = {(skill, need) for skill, effect in SKILL_EFFECTS.items() for need in effect.needs}
    assert needed == {*UNMET} | NOT_OF_THE_WORLD


@pytest.mark.parametrize("skill", [s for s in SKILL_EFFECTS if SKILL_EFFECTS[s].takes])
def test_object_that_lacks_what_a_skill_takes_is_refused_by_the_world(skill):
    room, takes = Room(), SKILL_EFFECTS[skill].takes
    lacks = ("Apple", "DiningTable", "Plate")
    kind = next(one for one in lacks if not object_types()[one].can(takes))
    assert not room.run(room.call(f"{skill} {kind}")).ok
