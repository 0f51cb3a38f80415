"""A world that shows an agent what it may see and lies about all the rest.

What a robot may know of an object is what it saw when that was last in view, in its hand, or under
its hands. `SpyWorld` hands out exactly that: things in view as they are; things seen before as they
were then; things never seen somewhere else, in another state. Who acts on the truth behind its eyes
acts otherwise here than in the honest world, and reaches for what it cannot know.
"""

from pathlib import Path

FAR_M = 100.0  # where things are said to be that nobody has seen
ROBOT = frozenset(
    (
        "MoveAhead", "MoveBack", "MoveLeft", "MoveRight", "RotateLeft", "RotateRight", "LookUp",
        "LookDown", "Crouch", "Stand", "PickupObject", "PutObject", "DropHandObject", "OpenObject",
        "CloseObject", "ToggleObjectOn", "ToggleObjectOff", "SliceObject", "BreakObject",
        "ThrowObject", "EmptyLiquidFromObject", "GetReachablePositions",
    )
)  # what a body can do; the floor's cells are the robot's own map  # fmt: skip
LET_GO = ("PutObject", "DropHandObject", "ThrowObject")
_FLIPPED = (
    "isOpen", "isToggled", "isBroken", "isFilledWithLiquid", "isDirty", "isUsedUp", "isCooked",
    "isSliced", "isPickedUp", "isMoving",
)  # fmt: skip


class SpyWorld:
    """A `World` seen through honest or lying eyes.

    Args:
        world: the true one.
        lies: False shows everything as it is, and still takes note.

    Attributes:
        offences: actions no robot has, and things acted upon that were never in view.
    """

    def __init__(self, world, *, lies):
        self._world, self._lies = world, lies
        self._rooms = {}  # room -> `_shown`: what was seen in one is not known in another
        self._shown = {}  # id -> its record when it was last in view
        self._touched = frozenset()
        self.offences = []
        self._event = _SpyEvent(world.last_event, self)

    @property
    def last_event(self):
        if self._event.true is not self._world.last_event:
            self._event = _SpyEvent(self._world.last_event, self)
        return self._event

    def reset(self, scene):
        self._rooms.pop(scene, None)
        self._world.reset(scene)
        self.enter(scene)
        return self.last_event

    def enter(self, scene):
        """Note that the true world is another room."""
        self._shown, self._touched = self._rooms.setdefault(scene, {}), frozenset()

    def step(self, action, **arguments):
        held = []
        if action in LET_GO:
            inventory = self._world.last_event.metadata["inventoryObjects"]
            held = [item["objectId"] for item in inventory]
        target = arguments.get("objectId")
        if action not in ROBOT or "forceAction" in arguments:
            self.offences.append(f"{action} {arguments}")
        if target is not None and target not in self._shown and self._lies:
            self.offences.append(f"{action} of {target}, never seen")
        self._touched = frozenset([*held, *([target] if target else [])])
        self._world.step(action, **arguments)
        return self.last_event

    def stop(self):
        self._world.stop()

    def told(self, true):
        """The metadata of a true event as this agent gets it."""
        if not self._lies:
            return true.metadata
        metadata = dict(true.metadata)
        inventory = {item["objectId"] for item in metadata["inventoryObjects"]}
        for thing in metadata["objects"]:
            if thing["visible"] or thing["objectId"] in inventory or self._in_hands(thing):
                self._shown[thing["objectId"]] = thing
        metadata["objects"] = [self._account(thing) for thing in metadata["objects"]]
        return metadata

    def _in_hands(self, thing):
        return any(
            thing["objectId"] == name or thing["objectId"].startswith(f"{name}|")
            for name in self._touched
        )

    def _account(self, thing):
        shown = self._shown.get(thing["objectId"])
        if shown is None:
            return _lie(thing)
        known = [name for name in shown["receptacleObjectIds"] or () if name in self._shown]
        now = thing["visible"]
        return {
            **shown,
            "visible": now,
            "isInteractable": thing["isInteractable"] if now else False,
            "receptacleObjectIds": None if shown["receptacleObjectIds"] is None else known,
        }


class _SpyEvent:
    """An event with nothing but what a `World` promises; told when first asked."""

    def __init__(self, true, spy):
        self.true, self._spy, self._metadata = true, spy, None

    def __bool__(self):
        return bool(self.true)

    @property
    def metadata(self):
        if self._metadata is None:
            self._metadata = self._spy.told(self.true)
        return self._metadata

    @property
    def frame(self):
        return self.true.frame


def _lie(thing):
    away = {**thing["position"], "x": thing["position"]["x"] + FAR_M}
    box = thing["axisAlignedBoundingBox"]
    moved = {**box, "center": {**box["center"], "x": box["center"]["x"] + FAR_M}}
    return {
        **thing,
        **{flag: not thing[flag] for flag in _FLIPPED},
        "position": away,
        "axisAlignedBoundingBox": moved,
        "distance": thing["distance"] + FAR_M,
        "temperature": "Cold" if thing["temperature"] == "Hot" else "Hot",
        "parentReceptacles": None,
        "receptacleObjectIds": [] if thing["receptacle"] else None,
    }


class Spied:
    """A method that sees its world through a `SpyWorld`; the bench behind it sees the truth."""

    def __init__(self, method, *, lies):
        self._method, self._lies = method, lies
        self.name = method.name
        self.spy = None

    def begin(self, world, scene, *, seed, folder: Path):
        self.spy = SpyWorld(world, lies=self._lies)
        self.spy.enter(scene.source)
        episode = self._method.begin(self.spy, scene, seed=seed, folder=folder)
        return _SpiedEpisode(episode, self.spy)


class _SpiedEpisode:
    def __init__(self, episode, spy):
        self._episode, self._spy = episode, spy
        self.do = episode.do

    def enter(self, scene):
        self._spy.enter(scene.source)
        self._episode.enter(scene)
