"""A map belongs to what is in a room, and forgets what was looked for at its place in vain."""

import json

import msgspec
import pytest
from support.household import kitchen, on, thing
from support.needs import need_models
from typer.testing import CliRunner

from karma import Agent
from karma.agent.tour import contents_of, explore_room
from karma.cli import app
from karma.files import to_json
from karma.memory.scene_graph import SceneGraph
from karma.types.observation import SeenObject
from karma.types.space import SceneRef
from karma.world.sim import EmbeddedWorld

COUNTER = thing("CounterTop", (0.0, 0.45, 1.2), (3.4, 0.9, 0.6))
EDITS = {
    "a thing less": lambda room: tuple(one for one in room.objects if one.type != "Toaster"),
    "a thing more": lambda room: (*room.objects, on(COUNTER, "CoffeeMachine", 0.3, 1.3)),
    "a thing elsewhere": lambda room: tuple(
        msgspec.structs.replace(one, position=(0.9, *one.position[1:]))
        if one.type == "CoffeeMachine" else one
        for one in room.objects
    ),
}  # fmt: skip


def written(path, objects=None):
    room = kitchen()
    path.write_bytes(to_json(msgspec.structs.replace(room, objects=objects or room.objects)))
    return path


@pytest.mark.parametrize("edit", EDITS.values(), ids=EDITS)
def test_map_of_a_room_that_was_edited_is_made_anew(tmp_path, edit):
    room, saved = tmp_path / "room.json", tmp_path / "map.json"
    for objects, is_new in ((None, True), (None, False), (edit(kitchen()), True)):
        written(room, objects)
        world = EmbeddedWorld(str(room))
        world.reset(str(room))
        graph, made = explore_room(world, SceneRef.of(str(room)), saved)
        assert made is is_new
        assert graph.room == contents_of(world)
        graph.save(saved)
    assert {node.id for node in SceneGraph.load(saved).objects()} <= {
        one.id for one in edit(kitchen())
    }


def test_map_is_of_the_room_whatever_lies_about_in_it(tmp_path):
    room = written(tmp_path / "room.json")
    world = EmbeddedWorld(str(room))
    world.reset(str(room))
    first = contents_of(world)
    written(room, tuple(one for one in kitchen().objects if one.type != "Apple"))
    world = EmbeddedWorld(str(room))
    world.reset(str(room))
    assert contents_of(world) == first


def test_thing_of_the_map_that_is_not_there_is_forgotten(tmp_path):
    """Somebody took the toaster away meanwhile; the file of the room is as it was."""
    need_models("karma-nano")
    room = written(tmp_path / "room.json", EDITS["a thing less"](kitchen()))
    maps = tmp_path / "maps"
    Agent(str(room), maps=maps, folder=tmp_path / "first")
    saved = maps / "room.json"
    graph = SceneGraph.load(saved)
    toaster = next(one for one in kitchen().objects if one.type == "Toaster")
    sight = SeenObject(
        object_id=toaster.id, object_type="Toaster", position_m=toaster.position,
        box_center_m=toaster.center, box_size_m=toaster.size, pickupable=False,
    )  # fmt: skip
    graph.observe([sight])
    graph.save(saved)
    agent = Agent(str(room), maps=maps, folder=tmp_path / "second")
    assert "Toaster" in agent.map.types()
    assert not agent.do("turn on the toaster")
    assert "Toaster" not in agent.map.types()
    assert "Toaster" not in saved.read_text()


def test_two_rooms_of_one_name_are_refused_by_both(tmp_path):
    sub = {"instruction": "Open the fridge.", "goals": ["OPEN(Fridge)"]}
    lines, places = [], [tmp_path / "a" / "room.json", tmp_path / "b" / "room.json"]
    for number, place in enumerate(places):
        place.parent.mkdir()
        written(place, EDITS["a thing less"](kitchen()) if number else None)
        task = {"id": f"t{number}", "kind": "simple", "scene": str(place), "subtasks": [sub]}
        lines.append(json.dumps(task))
    (tmp_path / "t.jsonl").write_text("\n".join(lines) + "\n")
    (tmp_path / "e.toml").write_text(
        'name = "e"\ntasks = "t.jsonl"\n[[rows]]\nname = "e"\nmethod = "expert"\n'
    )
    words = ["eval", str(tmp_path / "e.toml"), "--out", str(tmp_path / "run"), "--workers", "1"]
    shown = CliRunner().invoke(app, words)
    assert shown.exit_code == 1
    said = " ".join(shown.output.split())
    assert "two rooms have the name 'room'" in said
    assert all(str(place) in said.replace(" ", "") for place in places)
    written(places[1])  # one room in two folders is one room
    assert CliRunner().invoke(app, words).exit_code == 0
