"""Every type has a shape, every state of it is seen, and every name has its colour."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.household import kitchen, thing
from support.stage import close_up, facing

from karma.errors import FileError
from karma.household.types import object_types
from karma.world.core.scene import SCENES, load
from karma.world.core.state import Settings, begin
from karma.world.core.thing import is_inert
from karma.world.render import form
from karma.world.render.drawn import DrawingTask, drawn
from karma.world.render.mesh import ball, box, drum, rod, turned
from karma.world.render.picture import agent_camera, render
from karma.world.render.pixels import (
    class_frame,
    colour_table,
    instance_frame,
    names,
)
from karma.world.render.shapes import builder

SHAPED = [kind for kind in object_types() if kind != "Floor"]
BEFORE = {"Laptop": {"openness": 1.0}}
FLAGS = {
    "openable": {"openness": 1.0},
    "toggleable": {"is_toggled": True},
    "breakable": {"is_broken": True},
    "canFillWithLiquid": {"is_filled": True, "liquid": "coffee"},
    "dirtyable": {"is_dirty": True},
    "canBeUsedUp": {"is_used_up": True},
    "cookable": {"is_cooked": True},
}
STATES = [
    (kind, flag)
    for kind, row in object_types().items()
    for flag in FLAGS
    if flag in row.capabilities and (kind, flag) != ("Egg", "breakable")
] + [("StoveBurner", "toggleable")]


def shot(kind, **state):
    now, camera = close_up(kind, **state)
    return now, render(now, camera, 96, 96)


@pytest.mark.parametrize(("kind", "flag"), STATES)
def test_every_state_is_seen(kind, flag):
    before = BEFORE.get(kind, {}) if flag != "openable" else {}
    _, plain = shot(kind, **before)
    now, changed = shot(kind, **{**before, **FLAGS[flag]})
    own = (plain.rows == 0) | (changed.rows == 0)
    differs = (plain.rgb != changed.rgb).any(axis=2) & own
    assert differs.sum() > 0.01 * own.sum()
    if not is_inert(next(iter(now.objects.values()))):
        assert (changed.rows == 0).any()


def test_all_looks_name_builders_and_colours():
    for kind, look in form.looks().items():
        assert kind in object_types()
        assert callable(builder(look.shape))
        for text in (*look.colours, look.second, look.third):
            assert len(form.rgb(text)) == 3


def test_a_table_without_a_type_is_refused(tmp_path, monkeypatch):
    text = form.TABLE.read_text().replace("Apple = {", "Appel = {", 1)
    broken = tmp_path / "form.toml"
    broken.write_text(text)
    monkeypatch.setattr(form, "TABLE", broken)
    with pytest.raises(FileError, match=r"types\.Appel"):
        form.looks_table.__wrapped__()


# ------------------------------------------------------------------ solids


@pytest.mark.parametrize(
    "solid",
    [
        box((-1, 0, -1), (1, 2, 1), (0, 0, 0)),
        drum(1.0, 0.0, 2.0, (0, 0, 0)),
        ball((0.0, 1.0, 0.0), (1.0, 1.0, 1.0), (0, 0, 0)),
        rod((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.3, (0, 0, 0)),
        turned(box((-1, 0, -1), (1, 2, 1), (0, 0, 0)), 30, axis=0),
    ],
)
def test_solids_wind_outwards(solid):
    a, b, c = solid.vertices[solid.faces].swapaxes(0, 1)
    middle = solid.vertices.mean(axis=0)
    outward = np.einsum("ij,ij->i", np.cross(b - a, c - a), (a + b + c) / 3 - middle)
    assert (outward > 0).all()
    volume = np.einsum("ij,ij->i", a - middle, np.cross(b - middle, c - middle)).sum() / 6
    assert volume > 0


# ------------------------------------------------------------------ colour tables


@pytest.mark.parametrize("name", sorted(path.stem for path in SCENES.glob("*.json")))
def test_colours_are_unique_and_complete(name):
    scene = load(name)
    objects = {one.id: one for one in scene.objects}
    table = colour_table(objects)
    colours = [tuple(entry["color"]) for entry in table]
    assert len(set(colours)) == len(colours)
    listed = {entry["name"] for entry in table}
    assert listed >= set(objects) | {one.type for one in scene.objects}
    assert all(0 <= part <= 255 for one in colours for part in one)


def test_frames_are_painted_by_the_table():
    state = facing(begin(kitchen(), Settings()), 0, horizon=20)
    picture = render(state, agent_camera(state), 90, 90)
    table = {entry["name"]: tuple(entry["color"]) for entry in colour_table(state.objects)}
    back = {tuple(value): name for name, value in table.items()}
    instances = instance_frame(picture.rows, state.objects)
    classes = class_frame(picture.rows, state.objects)
    assert instances.shape == classes.shape == (90, 90, 3)
    assert instances.dtype == np.uint8
    ids = list(state.objects)
    for y, x in np.ndindex(90, 90):
        row = picture.rows[y, x]
        own, kind = back[tuple(instances[y, x])], back[tuple(classes[y, x])]
        if row >= 0:
            assert own == ids[row] and kind == state.objects[ids[row]].type
        else:
            assert own == kind and "|" not in own
    assert len(names(state.objects)) == len(table)


SIZES = st.tuples(*[st.sampled_from([0.0, 0.001, 0.03, 0.3, 2.5]) for _ in range(3)])


@settings(max_examples=150)
@given(st.sampled_from(SHAPED), SIZES, st.sets(st.sampled_from(sorted(FLAGS))), st.booleans())
def test_any_box_in_any_state_has_a_shape_in_and_around_it(kind, size, flags, hot):
    state = {key: value for flag in sorted(flags) for key, value in FLAGS[flag].items()}
    one = thing(kind, (0.3, 1.0, -0.2), size, temperature="Hot" if hot else "RoomTemp", **state)
    cells = np.array([(0.0, -1.0), (0.25, -1.0)])
    mesh = drawn(DrawingTask(one), cells, "stage")
    assert len(mesh.faces) and np.isfinite(mesh.vertices).all() and np.isfinite(mesh.colours).all()
    assert mesh.faces.min() >= 0 and mesh.faces.max() < len(mesh.vertices)
    assert mesh.colours.min() >= 0 and mesh.colours.max() <= 255
    solid = mesh.vertices[mesh.faces[mesh.clear == 0]].reshape(-1, 3)
    reach = 2.5 * max(*size, 0.1) + 0.3  # doors swing, flaps fold, shards fall
    assert (np.abs(solid - np.array(one.center)) < reach).all()
