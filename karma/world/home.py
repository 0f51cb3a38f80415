"""Join several rooms to one home: each is a world of its own, and stays as it was left.

A door costs nothing, and nothing goes through it: what is in the hand is put onto the nearest open
surface first, or dropped where none takes it. Time stands still in a room that nobody is in.
"""

from collections.abc import Callable
from typing import Any

from karma.errors import KarmaError
from karma.household.places import BESIDE_A_DOOR
from karma.types.roles import Event, World


class Home:
    """The rooms of a home, made as entered; as a `World`, it is the room that the agent is in."""

    def __init__(self, make: Callable[[], World]) -> None:
        self._make = make
        self._rooms: dict[str, World] = {}
        self._here = ""

    @property
    def scene(self) -> str:
        """The room that the agent is in, as it was named; "" before the first."""
        return self._here

    @property
    def last_event(self) -> Event:
        """The last event of this room.

        Raises:
            KarmaError: no room has been entered.
        """
        return self._room().last_event

    def reset(self, scene: str) -> Event:
        """Bring one room back to its start, and be in it; the other rooms stay as they are.

        Raises:
            FileError: there is no such scene, or it is damaged.
        """
        if scene != self._here:
            self._leave()
        room = self._rooms.get(scene) or self._make()
        event = room.reset(scene)
        self._rooms[scene], self._here = room, scene
        return event

    def enter(self, scene: str) -> Event:
        """Go into a room, which is as it was left; at the first visit it is as the scene has it.

        Raises:
            FileError: there is no such scene, or it is damaged.
        """
        if scene not in self._rooms:
            return self.reset(scene)
        if scene != self._here:
            self._leave()
            self._here = scene
        return self.last_event

    def step(self, action: str, **arguments: Any) -> Event:
        """Do one action in this room."""
        return self._room().step(action, **arguments)

    def stop(self) -> None:
        """Release all rooms."""
        for room in self._rooms.values():
            room.stop()
        self._rooms.clear()
        self._here = ""

    def _room(self) -> World:
        if not self._here:
            raise KarmaError("no room has been entered\n  To fix: home.enter('<scene>')")
        return self._rooms[self._here]

    def _leave(self) -> None:
        """Put down what is in the hand: on the floor it would soon be in the agent's way."""
        if not self._here or not self.last_event.metadata["inventoryObjects"]:
            return
        for place in _surfaces(self.last_event):
            if self.step("PutObject", objectId=place, forceAction=True):
                return
        event = self.step("DropHandObject", forceAction=True)
        if not event:
            reason = event.metadata["errorMessage"]
            raise KarmaError(f"{self._here}: the hand is not free to leave: {reason}")


def _surfaces(event: Event) -> list[str]:
    """Return the ids of what things can be put onto without opening it, the nearest first."""
    things = (thing for thing in event.metadata["objects"] if thing["objectType"] in BESIDE_A_DOOR)
    return [
        thing["objectId"]
        for thing in sorted(things, key=lambda thing: (thing["distance"], thing["objectId"]))
        if thing["receptacle"] and not thing["openable"]
    ]
