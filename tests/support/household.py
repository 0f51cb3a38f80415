"""A kitchen of boxes, made by hand, in which every rule of the world can be tried."""

from karma.household.types import object_types
from karma.types.memory import Known
from karma.world.core.scene import AgentPose, Scene, SceneObject


def thing(kind, center, size=None, *, suffix="", **state):
    row = object_types()[kind]
    size = size or row.size_m
    x, y, z = center
    identity = f"{kind}|{x:+06.2f}|{y:+06.2f}|{z:+06.2f}{suffix}"
    return SceneObject(
        id=identity,
        type=kind,
        name=f"{kind}_{abs(x):.2f}_{abs(z):.2f}{suffix}",
        position=center,
        center=center,
        size=size,
        capabilities=row.capabilities,
        mass_kg=row.mass_kg,
        materials=row.materials,
        **state,
    )


def on(parent, kind, x, z, *, level=None, size=None, **state):
    """A thing that rests on top of another, or inside at `level` above its bottom."""
    size = size or object_types()[kind].size_m
    low, high = (parent.center[1] + sign * parent.size[1] / 2 for sign in (-1, 1))
    y = (high if level is None else low + level) + size[1] / 2
    return thing(kind, (x, round(y, 4), z), size, parents=(parent.id,), **state)


def kitchen(extra=()):
    floor = thing("Floor", (0.0, -0.05, 0.0), (4.0, 0.1, 4.0))
    counter = thing("CounterTop", (0.0, 0.45, 1.2), (3.4, 0.9, 0.6))
    basin = thing("SinkBasin", (0.0, 0.85, 1.15), (0.4, 0.14, 0.4))
    faucet = thing("Faucet", (0.0, 1.05, 1.42), (0.1, 0.3, 0.1))
    burner = thing("StoveBurner", (0.8, 0.91, 1.15), (0.22, 0.02, 0.22))
    knob = thing("StoveKnob", (0.8, 0.8, 0.88), (0.05, 0.05, 0.04), controls=(burner.id,))
    microwave = on(counter, "Microwave", -1.2, 1.25, size=(0.5, 0.3, 0.4))
    machine = on(counter, "CoffeeMachine", -0.7, 1.3, size=(0.22, 0.3, 0.25))
    toaster = on(counter, "Toaster", 1.35, 1.3, size=(0.3, 0.2, 0.2))
    fridge = thing("Fridge", (-1.65, 0.9, -0.2), (0.6, 1.8, 0.8))
    table = thing("DiningTable", (1.65, 0.4, -0.4), (0.8, 0.8, 1.4))
    cabinet = thing("Cabinet", (-0.5, 0.4, 0.95), (0.5, 0.6, 0.1))
    drawer = thing("Drawer", (0.4, 0.7, 1.1), (0.4, 0.15, 0.4))
    can = thing("GarbageCan", (-1.0, 0.2, -1.6), (0.3, 0.4, 0.3), parents=(floor.id,))
    plate = on(table, "Plate", 1.5, -0.8, size=(0.2, 0.02, 0.2), is_dirty=True)
    objects = [
        floor, counter, basin, faucet, burner, knob, microwave, machine, toaster, fridge, table,
        cabinet, drawer, can, plate,
        thing("StoveBurner", (0.55, 0.91, 1.35), (0.18, 0.02, 0.18)),
        on(counter, "Mug", -0.4, 1.05, size=(0.1, 0.1, 0.1)),
        on(counter, "Pan", 1.25, 1.0, size=(0.3, 0.05, 0.22)),
        on(fridge, "Egg", -1.55, -0.2, level=0.7, size=(0.06, 0.06, 0.06), temperature="Cold"),
        on(table, "Apple", 1.4, -0.5, size=(0.1, 0.1, 0.1)),
        on(table, "Potato", 1.4, -0.3, size=(0.1, 0.08, 0.08)),
        on(table, "Bread", 1.5, -0.05, size=(0.12, 0.12, 0.3)),
        on(table, "Knife", 1.35, -0.65, size=(0.05, 0.02, 0.2)),
        on(table, "Bowl", 1.7, -0.5, size=(0.18, 0.08, 0.18)),
        on(table, "Candle", 1.85, -0.2, size=(0.05, 0.1, 0.05), is_toggled=True),
        on(table, "CellPhone", 1.35, 0.15, size=(0.07, 0.01, 0.14), is_toggled=True),
        on(plate, "Tomato", 1.5, -0.8, size=(0.07, 0.07, 0.07)),
        on(drawer, "Spoon", 0.4, 1.1, level=0.02, size=(0.04, 0.02, 0.15)),
        on(counter, "SoapBottle", 0.3, 1.35, size=(0.07, 0.2, 0.07)),
        thing("Window", (0.0, 1.6, 1.7), (0.8, 0.8, 0.05)),
        thing("LightSwitch", (-1.95, 1.2, -1.2), (0.03, 0.1, 0.07), is_toggled=True),
        *extra,
    ]  # fmt: skip
    return Scene(
        name="handmade",
        room="Kitchen",
        source="tests/support/household.py",
        agent=AgentPose(position=(0.0, 0.9, 0.0)),
        reachable=tuple((x / 4, z / 4) for x in range(-4, 5) for z in range(-4, 3)),
        bounds_center=(0.0, 1.25, 0.0),
        bounds_size=(4.0, 2.5, 4.0),
        objects=tuple(objects),
    )


def find(world, kind):
    """The id of the first object of a type that is still there."""
    state = world.state
    return next(i for i, t in state.objects.items() if t.type == kind and not t.is_sliced)


def reach(world, kind):
    """Teleport to where the object can be handled, and return its id."""
    object_id = find(world, kind)
    poses = world.step("GetInteractablePoses", objectId=object_id, maxPoses=1)
    assert poses.metadata["actionReturn"], f"nowhere to reach {object_id} from"
    pose = poses.metadata["actionReturn"][0]
    assert world.step("TeleportFull", **pose), world.last_event.message
    return object_id


def bring(world, kind, receptacle, *, force=False):
    """Pick one thing up and put it into another, walking to both."""
    taken = reach(world, kind)
    assert world.step("PickupObject", objectId=taken), world.last_event.message
    place = reach(world, receptacle)
    event = world.step("PutObject", objectId=place, forceAction=force)
    return event, taken, place


def look(world, object_id):
    """One object's metadata."""
    return world.last_event.get_object(object_id)


class Believes:
    """Knowledge of where things were when a room's file was read: it gets stale."""

    def __init__(self, things, areas=()):
        self._things, self._areas = things, areas

    def where(self, name):
        for one in self._things:
            if name in (one.id, one.type):
                return Known(object_id=one.id, object_type=one.type, position_m=one.position,
                             place_id=next(iter(one.parents), None))  # fmt: skip
        return None

    def areas(self):
        return self._areas
