"""Keep what is built for a room until something in it looks different."""

from weakref import WeakKeyDictionary

import numpy as np

from karma.world.core.boxes import Box
from karma.world.core.state import Room, WorldState
from karma.world.render import shell
from karma.world.render.drawn import DrawingTask, drawn, support, supports, tasks
from karma.world.render.layer import Layer
from karma.world.render.mesh import Mesh
from karma.world.render.pixels import STAND


class BuiltRoom:
    """The triangles of the last moment of one room.

    Attributes:
        layers: what stands still, then what is in the hand, if anything is.
        shell: the room itself.
    """

    def __init__(self, state: WorldState) -> None:
        self._cells = np.array(list(state.room.cells.values()), dtype=float).reshape(-1, 2)
        self._objects = state.objects
        self._in_hand = state.in_hand
        self._still: list[DrawingTask] = []
        self._held: list[DrawingTask] = []
        self._stands: tuple[Box, ...] = ()
        self._meshes: dict[str, Mesh] = {}
        self.layers = [Layer((), ())]
        self._build(state)

    def update(self, state: WorldState) -> None:
        """Build anew what looks different now."""
        if self._objects is not state.objects or self._in_hand != state.in_hand:
            self._build(state)
            self._objects, self._in_hand = state.objects, state.in_hand

    def _build(self, state: WorldState) -> None:
        wanted = list(tasks(state.objects, self._cells, state.room.shell.walked))
        still = [task for task in wanted if task.thing.id not in state.in_hand]
        held = [task for task in wanted if task.thing.id in state.in_hand]
        self.shell = shell.around(state.room, state.objects)
        stands = supports(state.objects, state.room.floor_y)
        if not _same(still, self._still) or stands != self._stands:
            kept = {task.thing.id: task for task in self._still}
            self._meshes = {task.thing.id: self._mesh(task, kept, state) for task in still}
            self.layers[0] = Layer(
                [*(task.owner for task in still), STAND],
                [*self._meshes.values(), support(stands)],
                self.layers[0],
            )
            self._still, self._stands = still, stands
        if not _same(held, self._held):
            meshes = [drawn(task, self._cells, state.room.name) for task in held]
            self.layers[1:] = [Layer([task.owner for task in held], meshes)] if held else []
            self._held = held

    def _mesh(self, task: DrawingTask, kept: dict[str, DrawingTask], state: WorldState) -> Mesh:
        before = kept.get(task.thing.id)
        if before is not None and before.same(task):
            return self._meshes[task.thing.id]
        return drawn(task, self._cells, state.room.name)


_ROOMS: WeakKeyDictionary[Room, BuiltRoom] = WeakKeyDictionary()  # the longest unused first
_AT_ONCE = 16  # rooms of which something is kept; Embree dies of some thousand scenes at once


def built(state: WorldState) -> BuiltRoom:
    """Return the layers and the shell of a moment."""
    found = _ROOMS.pop(state.room, None)
    if found is None:
        for room in list(_ROOMS)[: max(0, len(_ROOMS) - _AT_ONCE + 1)]:
            del _ROOMS[room]
        found = BuiltRoom(state)
    _ROOMS[state.room] = found
    found.update(state)
    return found


def _same(some: list[DrawingTask], others: list[DrawingTask]) -> bool:
    return len(some) == len(others) and all(map(DrawingTask.same, some, others))
