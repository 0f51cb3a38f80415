"""Goals that nobody can meet in a room."""

from math import dist

import msgspec

from karma.goals.goals import parse_goal
from karma.plugins.training.possible import OUT_OF_REACH, TAKES_NONE, TOO_BIG, Possible
from karma.world.core.scene import load


def test_possible_says_what_nobody_could_do():
    room = Possible(load("bedroom_1"))
    assert room.refusal([parse_goal("ON(Laptop, Desk)"), parse_goal("HOLDON(robot, Pen)")]) == ""
    assert room.refusal([parse_goal("ON(Box, Pen)")]) == TAKES_NONE
    scene = load("kitchen_1")
    fridge = next(one for one in scene.objects if one.type == "Fridge")
    corner = max(scene.reachable, key=lambda cell: dist(cell, fridge.position[::2]))
    far = Possible(msgspec.structs.replace(scene, reachable=(corner,)))
    assert far.refusal([parse_goal("OPEN(Fridge)")]) == OUT_OF_REACH
    huge = [
        msgspec.structs.replace(one, size=(2.0, 2.0, 2.0)) if one.type == "Plate" else one
        for one in scene.objects
    ]
    wide = Possible(msgspec.structs.replace(scene, objects=tuple(huge)))
    assert wide.refusal([parse_goal("INSIDE(Plate, Microwave)")]) == TOO_BIG
    assert Possible(scene).refusal([parse_goal("INSIDE(Plate, Microwave)")]) == ""
