"""Pictures against what geometry says: boxes, walls, brute force over all triangles."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.floor_plans import floor_plans
from support.household import kitchen, reach, thing
from support.stage import facing, moment, towards

from karma.world.core.scene import SCENES, load
from karma.world.core.state import Camera, Room, Settings, begin
from karma.world.render.drawn import drawn, tasks
from karma.world.render.picture import Picture, agent_camera, camera_above, render
from karma.world.render.pixels import AGENT, CEILING, NOTHING, PIECES, STAND, WALL
from karma.world.sim import EmbeddedWorld

UNDER = ("SinkBasin", "BathtubBasin", "Cabinet", "Drawer", "Shelf")  # something lies over them
OURS = sorted(path.stem for path in SCENES.glob("*.json"))


def view(state, width=120, height=120, **more):
    return render(state, agent_camera(state), width, height, **more)


def place(picture, row):
    """The middle (x, y) of an object's pixels."""
    ys, xs = np.nonzero(picture.rows == row)
    assert len(xs), f"row {row} is not in the picture"
    return xs.mean(), ys.mean()


def pixel_rays(camera, width, height):
    """Forward, and each pixel's ray by trigonometry alone: length 1 along the view."""
    pitch, yaw = np.radians(camera.rotation_deg[:2])
    forward = np.array([np.sin(yaw) * np.cos(pitch), -np.sin(pitch), np.cos(yaw) * np.cos(pitch)])
    right = np.array([np.cos(yaw), 0.0, -np.sin(yaw)])
    up = np.cross(forward, right)
    reach = np.tan(np.radians(camera.fov_deg) / 2)
    rays = [
        forward
        + right * ((2 * (x + 0.5) / width - 1) * reach * width / height)
        + up * ((1 - 2 * (y + 0.5) / height) * reach)
        for y in range(height)
        for x in range(width)
    ]
    return np.array(camera.position_m), np.array(rays)


# ------------------------------------------------------------------ depth and rows


def test_depth_is_the_distance_to_the_wall_along_the_view():
    state = facing(moment(size=(5.0, 2.5, 7.0)), 0)
    picture = view(state)
    wall = picture.rows == WALL
    assert wall.any() and picture.rows[60, 60] == WALL
    ahead = picture.depth_m[55:65, 30:90]
    assert np.allclose(ahead, 3.5, atol=1e-4), "planar depth is the same all over a facing wall"
    assert np.isclose(view(facing(state, 90)).depth_m[60, 60], 2.5, atol=1e-4)


def ray_box(origin, rays, low, high):
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (low - origin) / rays, (high - origin) / rays
    enter, leave = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
    return np.where((enter < leave) & (leave > 0.01), enter, np.inf), leave


slabs = st.lists(
    st.tuples(
        st.floats(-1.6, 1.6), st.floats(0.2, 2.2), st.floats(0.7, 1.7),
        st.floats(0.1, 0.59), st.floats(0.02, 0.055), st.floats(0.1, 0.59),
    ),
    min_size=1,
    max_size=6,
)  # fmt: skip


@settings(max_examples=25)
@given(slabs, st.sampled_from([0.0, 20.0, -15.0]), st.sampled_from([0.0, 33.0, -20.0]))
def test_thin_worktops_are_the_boxes_that_they_are(boxes, pitch, yaw):
    objects = [
        thing("CounterTop", (round(x, 3), round(y, 3), round(z, 3)), (w, h, d), suffix=f"|{number}")
        for number, (x, y, z, w, h, d) in enumerate(boxes)
    ]
    state = facing(moment(*objects), 0, position=(0.0, 0.9, -1.2))
    camera = Camera(position_m=(0.0, 1.2, -1.2), rotation_deg=(pitch, yaw, 0.0), fov_deg=70.0)
    picture = render(state, camera, 48, 36)
    origin, rays = pixel_rays(camera, 48, 36)
    hits = np.array(
        [
            ray_box(origin, rays, np.array(o.center) - np.array(o.size) / 2,
                    np.array(o.center) + np.array(o.size) / 2)[0]
            for o in objects
        ]
    )  # fmt: skip
    walls = ray_box(origin, rays, np.array([-2.0, 0.0, -2.0]), np.array([2.0, 2.5, 2.0]))[1]
    nearest = hits.min(axis=0)
    expected = np.where(nearest < walls, hits.argmin(axis=0), -9)
    shown = np.where(picture.rows.ravel() >= 0, picture.rows.ravel(), -9)
    depth = np.minimum(nearest, walls)
    away = np.sort(np.vstack([hits, walls]), axis=0)
    clear = away[1] - away[0] > 1e-3  # two boxes in one place: either will do
    same = (shown == expected) | ~clear
    assert same.mean() > 0.985, "all but pixels on edges show the nearest box"
    near = np.abs(picture.depth_m.ravel() - depth) < 2e-3
    assert (near | (shown != expected)).mean() > 0.985


def test_pictures_agree_with_brute_force_over_all_triangles():
    state = facing(begin(kitchen(), Settings()), 0, horizon=20)
    camera = agent_camera(state)
    picture = render(state, camera, 60, 60)
    cells = np.array(list(state.room.cells.values()))
    origin, rays = pixel_rays(camera, 60, 60)
    chosen = np.arange(0, 3600, 13)
    found, owners = [], []
    for task in tasks(state.objects, cells, state.room.shell.walked):
        mesh = drawn(task, cells, state.room.name)
        found.append([nearest_triangle(origin, ray, mesh) for ray in rays[chosen]])
        owners.append(state.objects.rows[task.thing.id])
    best, second = np.sort(np.array(found), axis=0)[:2]
    owner = np.array(owners)[np.argmin(found, axis=0)]
    half = np.array(state.room.bounds_size) / 2
    middle = np.array(state.room.bounds_center)
    walls = ray_box(origin, rays[chosen], middle - half, middle + half)[1]
    depth = np.minimum(best, walls)
    rows, depths = picture.rows.ravel()[chosen], picture.depth_m.ravel()[chosen]
    best = np.minimum(best, 1e9)
    things = (best < walls) & (second - best > 1e-4)  # not where two things share a face
    assert things.sum() > 50, "the view must show something"
    assert (rows[things] == owner[things]).mean() > 0.98
    assert (np.abs(depths - depth) < 1e-3).mean() > 0.99


def nearest_triangle(origin, ray, mesh):
    """Moeller and Trumbore, over every triangle."""
    a, b, c = mesh.vertices[mesh.faces].astype(float).swapaxes(0, 1)
    ab, ac = b - a, c - a
    cross = np.cross(ray, ac)
    scale = np.einsum("ij,ij->i", ab, cross)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1 / scale
        gap = origin - a
        u = np.einsum("ij,ij->i", gap, cross) * inverse
        other = np.cross(gap, ab)
        v = other @ ray * inverse
        along = np.einsum("ij,ij->i", ac, other) * inverse
    hit = (np.abs(scale) > 1e-12) & (u >= 0) & (v >= 0) & (u + v <= 1) & (along > 0.01)
    return along[hit].min() if hit.any() else np.inf


def test_what_is_right_and_up_appears_right_and_up():
    state = moment(
        thing("Apple", (0.6, 1.0, 1.5)), thing("Tomato", (-0.6, 1.0, 1.5)),
        thing("Egg", (0.0, 1.9, 1.5), (0.2, 0.2, 0.2)), thing("Potato", (0.0, 1.0, 1.5)),
    )  # fmt: skip
    picture = view(facing(state, 0))
    (apple, _), (tomato, _) = place(picture, 0), place(picture, 1)
    (_, egg), (_, potato) = place(picture, 2), place(picture, 3)
    assert tomato < 60 < apple, "+x is right of a camera that looks along +z"
    assert egg < potato, "the top row comes first"
    behind = view(facing(state, 180))
    assert (behind.rows >= 0).sum() == 0


# ------------------------------------------------------------------ cameras


@pytest.mark.parametrize("name", ["kitchen_1", "living_2", "bedroom_3", "bathroom_4"])
def test_the_map_view_sees_all_big_furniture(name):
    state = begin(load(name), Settings())
    picture = render(state, camera_above(state), 300, 300)
    seen = set(np.unique(picture.rows))
    assert CEILING not in seen, "one looks in through the ceiling"
    for object_id, row in state.objects.rows.items():
        one = state.objects[object_id]
        if one.size[0] * one.size[2] > 0.4 and one.type not in UNDER:
            assert row in seen, f"{object_id} is not on the map"


def test_other_cameras_see_the_agent_and_it_does_not_see_itself():
    state = facing(moment(size=(6.0, 2.5, 6.0)), 0)
    camera = towards((0.0, 1.0, 0.0), yaw=0.0, pitch=10.0, far=2.0)
    picture = render(state, camera, 60, 60)
    assert picture.rows[30, 30] == AGENT
    assert picture.depth_m[30, 30] == pytest.approx(1.85, abs=0.1)
    assert not (view(facing(state, 0, horizon=60)).rows == AGENT).any()


def test_nothing_is_seen_beyond_the_far_plane():
    state = facing(moment(thing("Fridge", (0.0, 0.9, 3.0)), size=(8.0, 2.5, 8.0)), 0)
    camera = replace(agent_camera(state), far_m=2.0)
    picture = render(state, camera, 60, 60)
    assert (picture.rows != 0).all() and picture.depth_m.max() == 2.0
    assert (picture.rows[picture.depth_m == 2.0] == NOTHING).all()


def test_normals_are_unit_and_face_the_camera():
    state = facing(begin(kitchen(), Settings()), 0, horizon=20)
    camera = agent_camera(state)
    picture = render(state, camera, 50, 50, normals=True)
    assert picture.normals is not None and picture.normals.shape == (50, 50, 3)
    assert np.allclose(np.linalg.norm(picture.normals, axis=2), 1, atol=1e-3)
    _, rays = pixel_rays(camera, 50, 50)
    assert (np.einsum("ij,ij->i", picture.normals.reshape(-1, 3), rays) <= 1e-5).all()


# ------------------------------------------------------------------ moments


def test_what_is_in_the_hand_is_seen_and_moves_along():
    world = EmbeddedWorld(kitchen())
    apple = reach(world, "Apple")
    assert world.step("PickupObject", objectId=apple), world.last_event.message
    row = world.state.objects.rows[apple]
    first = view(world.state)
    assert (first.rows == row).sum() > 20
    assert 0.1 < first.depth_m[first.rows == row].min() < 0.6
    world.step("RotateRight")
    after = view(world.state)
    assert (after.rows == row).sum() > 20
    map_of_it = render(world.state, camera_above(world.state), 200, 200)
    assert (map_of_it.rows == row).any(), "other cameras see the hand too"


def open_and_shut(kind, child):
    """Two moments of the household's kitchen, seen from in front of a container."""
    state = begin(kitchen(), Settings())
    container = state.objects.by_type[kind][0]
    inside = next(
        c for c in state.objects.containment.inside(container) if state.objects[c].type == child
    )
    opened = msgspec.structs.replace(state.objects[container], openness=1.0)
    return container, inside, state, replace(
        state, objects=state.objects.changed({container: opened})
    )  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "child", "camera"),
    [
        ("Fridge", "Egg", Camera(position_m=(-0.2, 1.3, -0.2), rotation_deg=(20.0, 270.0, 0.0))),
        ("Drawer", "Spoon", Camera(position_m=(0.4, 1.5, 0.1), rotation_deg=(55.0, 0.0, 0.0))),
    ],
)
def test_closed_containers_hide_and_open_ones_show(kind, child, camera):
    container, inside, shut, opened = open_and_shut(kind, child)
    row = shut.objects.rows[inside]
    closed_view, open_view = (render(state, camera, 200, 200) for state in (shut, opened))
    assert (closed_view.rows == shut.objects.rows[container]).any()
    assert not (closed_view.rows == row).any()
    assert (open_view.rows == row).sum() > 10


def test_steam_is_seen_but_counts_for_nothing():
    cool, hot = (moment(thing("Mug", (0.0, 1.0, 1.0), temperature=t)) for t in ("RoomTemp", "Hot"))
    camera = towards((0.0, 1.05, 1.0), yaw=0.0, pitch=0.0, far=0.4)
    plain, steaming = render(cool, camera, 80, 80), render(hot, camera, 80, 80)
    assert np.array_equal(plain.rows, steaming.rows)
    assert np.allclose(plain.depth_m, steaming.depth_m, atol=1e-5)
    above = (plain.rows != 0) & (plain.rgb != steaming.rgb).any(axis=2)
    assert above.any(), "the plume stands over the mug"


def test_glass_shows_what_is_behind_it_and_owns_the_pixel():
    pane = thing("ShowerGlass", (0.0, 1.2, 1.0), (1.6, 1.9, 0.05))
    ball = thing("BasketBall", (0.0, 1.5, 1.6))
    with_ball, without = moment(pane, ball), moment(pane)
    camera = Camera(position_m=(0.0, 1.5, 0.0))
    first, second = render(with_ball, camera, 80, 80), render(without, camera, 80, 80)
    assert first.rows[40, 40] == second.rows[40, 40] == 0
    assert first.depth_m[40, 40] == pytest.approx(1.0, abs=0.03)
    assert (first.rgb[40, 40] != second.rgb[40, 40]).any()


def test_pieces_of_what_broke_are_seen_but_are_no_object():
    mug = thing("Mug", (0.0, 0.05, 1.0), is_broken=True)
    picture = render(moment(mug), towards((0.0, 0.02, 1.0), far=0.5), 80, 80)
    assert (picture.rows == PIECES).any() and not (picture.rows == 0).any()


def test_what_would_hang_in_the_air_stands_on_something_that_is_no_object():
    burners = [
        thing("StoveBurner", (x, 0.9, z), suffix=f"|{x}{z}")
        for x in (0.9, 1.2)
        for z in (-0.15, 0.15)
    ]
    island = thing("CounterTop", (-1.2, 0.9, 0.0), (1.0, 0.04, 0.6))
    state = facing(moment(*burners, island), 0, position=(0.0, 0.9, -1.7))
    across = Camera(position_m=(0.0, 0.6, -1.9))
    picture = render(state, across, 120, 120)
    left, right = picture.rows[:, :60] == STAND, picture.rows[:, 60:] == STAND
    assert left.any() and right.sum() > 2 * left.sum(), "legs of the island, body of the stove"
    cupboard = thing("Cabinet", (1.05, 0.45, 0.0), (0.6, 0.8, 0.6))
    housed = facing(moment(*burners, cupboard), 0, position=(0.0, 0.9, -1.7))
    assert not (render(housed, across, 120, 120).rows == STAND).any()


def test_a_room_with_all_its_lights_off_is_darker():
    bright, dark = (
        facing(
            moment(thing("LightSwitch", (1.98, 1.2, 0.5), (0.03, 0.1, 0.07), is_toggled=on)), 270
        )
        for on in (True, False)
    )
    assert view(dark).rgb.mean() < view(bright).rgb.mean() * 0.7


# ------------------------------------------------------------------ the same every time


def fresh(state):
    """The same moment in a room of which nothing is kept."""
    other = Room.__new__(Room)
    other.__dict__.update(state.room.__dict__)
    return replace(state, room=other)


def same(a: Picture, b: Picture) -> bool:
    return all(np.array_equal(x, y) for x, y in zip(a[:3], b[:3], strict=True))


def test_pictures_do_not_depend_on_what_was_drawn_before():
    world = EmbeddedWorld(kitchen())
    other = begin(load("bedroom_1"), Settings())
    for number in range(60):
        action = ("RotateRight", "MoveAhead", "LookDown", "LookUp", "RotateLeft")[number % 5]
        world.step(action)
        if number % 7 == 0:
            fridge = world.state.objects.by_type["Fridge"][0]
            world.step("OpenObject", objectId=fridge, forceAction=True)
            egg = world.state.objects.by_type["Egg"][0]
            world.step("PickupObject", objectId=egg, forceAction=True)
        if number % 7 == 4:
            world.step("DropHeldObject", forceAction=True)
        if number % 3 == 0:
            view(other, 20, 20)
        drawn_on = view(world.state, 40, 40)
        assert same(drawn_on, view(fresh(world.state), 40, 40)), f"differs after step {number}"


@pytest.mark.parametrize("name", OURS)
def test_every_pixel_of_our_scenes_is_accounted_for(name):
    state = begin(load(name), Settings())
    cells = list(state.room.cells.values())
    for number in range(0, len(cells), max(1, len(cells) // 6)):
        x, z = cells[number]
        at = (x, state.pose.position_m[1], z)
        picture = view(facing(state, 90 * (number % 4), 15, at), 40, 40)
        assert picture.rgb.dtype == np.uint8 and picture.rgb.shape == (40, 40, 3)
        assert picture.depth_m.dtype == np.float32 and picture.rows.dtype == np.int32
        assert (picture.rows >= STAND).all() and (picture.rows < len(state.objects)).all()
        assert not (picture.rows == NOTHING).any(), "inside a room one sees the room"
        assert (picture.depth_m > 0).all()


@pytest.mark.shared
def test_imported_scenes_can_be_drawn(shared):
    for number, scene in enumerate(floor_plans(shared, layouts=True)):
        if number % 8 == 0:
            state = begin(scene, Settings())
            picture = render(state, camera_above(state), 60, 60)
            assert len(np.unique(picture.rows)) > 5, scene.name


def test_things_that_lie_a_little_deep_are_drawn_on_the_worktop():
    top = thing("CounterTop", (0.0, 0.9, 1.0), (1.0, 0.06, 0.6))
    card = thing("CreditCard", (0.0, 0.912, 1.0), parents=(top.id,))
    picture = render(
        moment(top, card), Camera(position_m=(0.0, 1.6, 0.9), rotation_deg=(80.0, 0.0, 0.0)), 80, 80
    )
    assert (picture.rows == 1).sum() > 20
    assert picture.depth_m[picture.rows == 1].min() == pytest.approx(0.66, abs=0.03)
