"""A box is coarser than its thing: worktops end where people walk, loose things have a shape."""

import msgspec
import numpy as np
import pytest
from support.household import kitchen, look, on, thing

from karma.world.core.hiding import walked_in
from karma.world.core.rays import own_frame
from karma.world.core.rules import rules
from karma.world.render.drawn import DrawingTask, drawn
from karma.world.sim import EmbeddedWorld

FILLED = rules().view.filled


def room(*extra, reachable=None):
    """Our kitchen's floor with other things on it."""
    base = kitchen()
    floor = next(one for one in base.objects if one.type == "Floor")
    return msgspec.structs.replace(
        base, objects=(floor, *extra), reachable=reachable or base.reachable
    )


def seen_from(scene, one, x, z, *, yaw, horizon=30):
    world = EmbeddedWorld(scene)
    event = world.step(
        "TeleportFull", x=x, y=0.9, z=z, rotation=yaw, horizon=horizon, standing=True
    )
    assert event, event.message
    return look(world, one.id)["visible"]


# ----------------------------------------------------------------- worktops


def test_worktop_round_a_corner_does_not_hide_what_stands_beneath_its_box_where_people_walk():
    """One box spans both legs and the floor between them, where the agent stands."""
    corner = thing("CounterTop", (-0.5, 0.89, 0.5), (2.0, 0.06, 2.0))
    low = thing("GarbageCan", (-0.5, 0.2, 0.6), (0.2, 0.4, 0.2))
    drawer = thing("Drawer", (-1.2, 0.7, 0.5), (0.4, 0.2, 0.4))
    free = tuple((x / 4, z / 4) for x in range(-3, 5) for z in range(-4, 2))
    scene = room(corner, low, drawer, reachable=free)
    assert seen_from(scene, low, -0.5, -0.25, yaw=0, horizon=45)
    assert walked_in(scene.objects, free).keys() == {corner.id}


def test_worktop_that_stands_out_over_drawers_ends_at_their_fronts_all_along_the_row():
    """The agent stands before the first drawer and the edge of the next, whose front is in line."""
    fronts = [thing("Drawer", (x, 0.7, 0.75), (0.46, 0.2, 0.4)) for x in (-0.25, 0.25)]
    top = thing("CounterTop", (0.0, 0.83, 0.7), (1.0, 0.04, 0.8))  # 25 cm out over them
    cell = ((-0.1, 0.1),)
    (grounds,) = walked_in([*fronts, top], cell).values()
    front = 0.75 - 0.2
    for x in (-0.4, 0.0, 0.45):
        inside = (grounds[:, 0] <= x) & (x <= grounds[:, 2])
        assert grounds[inside, 3].max() == pytest.approx(front - 0.05), x
    assert grounds[:, 3].max() < front


def test_worktop_goes_on_hiding_what_is_beneath_it_where_nobody_walks():
    top = thing("CounterTop", (0.0, 0.87, 1.2), (3.4, 0.06, 0.6))
    under = thing("DishSponge", (0.45, 0.7, 1.2), (0.08, 0.03, 0.05))
    assert not seen_from(room(top, under), under, 0.25, 0.25, yaw=0, horizon=45)


# ----------------------------------------------------------------- loose things


@pytest.mark.parametrize("kind", ["Bottle", "Statue", "SprayBottle", "WineBottle", "ScrubBrush"])
def test_thing_behind_a_narrow_top_is_seen_and_behind_a_broad_foot_is_not(kind):
    table = thing("DiningTable", (0.0, 0.4, 1.2), (1.5, 0.8, 0.8))
    before = on(table, kind, 0.0, 1.0, size=(0.3, 0.6, 0.3))
    high = thing("Pen", (0.1, 1.33, 1.35), (0.02, 0.02, 0.02))
    low = thing("Pen", (0.0, 0.83, 1.35), (0.02, 0.02, 0.02))
    scene = room(table, before, high, low)
    assert seen_from(scene, high, 0.0, 0.0, yaw=0)
    assert not seen_from(scene, low, 0.0, 0.0, yaw=0)
    solid = msgspec.structs.replace(before, type="Box", id="Box|1|1|1")
    assert not seen_from(room(table, solid, high), high, 0.0, 0.0, yaw=0)


def test_laptop_s_lid_hides_and_the_air_over_its_keys_does_not():
    table = thing("DiningTable", (0.0, 0.4, 1.2), (1.5, 0.8, 0.8))
    laptop = on(table, "Laptop", 0.0, 1.1, size=(0.4, 0.3, 0.3), openness=1.0)
    keys = thing("Pen", (0.0, 0.9, 1.2), (0.02, 0.02, 0.02))
    assert seen_from(room(table, laptop, keys), keys, 0.0, 0.25, yaw=0)


@pytest.mark.parametrize("kind", FILLED)
def test_bands_of_the_rules_are_those_of_the_drawing(kind):
    state = {"openness": 1.0} if kind == "Laptop" else {}
    one = thing(kind, (0.0, 1.0, 0.0), **state)
    axes, size = own_frame(one)
    points = (_surface(one) - np.array(one.center)) @ axes.T * 2 / np.array(size)
    bands = FILLED[kind]
    for number, (half_width, *depth) in enumerate(bands):
        low, high = (2 * (number + step) / len(bands) - 1 for step in (0, 1))
        there = points[(points[:, 1] >= low) & (points[:, 1] <= high)]
        ends = depth if len(depth) == 2 else (-depth[0], depth[0])
        found = np.abs(there[:, 0]).max(), there[:, 2].min(), there[:, 2].max()
        assert found == pytest.approx((half_width, *ends), abs=0.16), number


def _surface(one):
    """Points all over what is drawn of a thing."""
    mesh = drawn(DrawingTask(one), np.zeros((0, 2)), "room")
    a, b, c = mesh.vertices[mesh.faces].astype(float).swapaxes(0, 1)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(a), 20_000, p=area / area.sum())
    u, v = rng.random((2, 20_000, 1))
    u, v = np.where(u + v > 1, (1 - u, 1 - v), (u, v))
    return a[chosen] + u * (b - a)[chosen] + v * (c - a)[chosen]
