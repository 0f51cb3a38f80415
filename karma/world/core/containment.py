"""Tell which objects lie in which."""

from collections.abc import Iterable

from karma.world.core.scene import SceneObject


class Containment:
    """The parents and children of each object, and of those in turn."""

    def __init__(self, things: Iterable[SceneObject]) -> None:
        self.parents = {thing.id: thing.parents for thing in things}
        found: dict[str, list[str]] = {}
        for object_id, parents in self.parents.items():
            for parent in parents:
                found.setdefault(parent, []).append(object_id)
        self.children = {parent: tuple(ids) for parent, ids in found.items()}  # direct ones

    def inside(self, object_id: str) -> tuple[str, ...]:
        """Return everything in an object, also within other things; each once, not itself."""
        found = dict.fromkeys([object_id])
        queue = [object_id]
        for current in queue:
            fresh = [child for child in self.children.get(current, ()) if child not in found]
            found.update(dict.fromkeys(fresh))
            queue.extend(fresh)
        return tuple(queue[1:])

    def around(self, object_id: str) -> tuple[str, ...]:
        """Return everything an object lies in, the nearest first; each once, not itself."""
        queue = [object_id]
        for current in queue:
            queue.extend(parent for parent in self.parents[current] if parent not in queue)
        return tuple(queue[1:])

    def nearest(self, object_id: str) -> list[str]:
        """Return the chain of first parents, the object left out."""
        chain = [object_id]
        while (parents := self.parents[chain[-1]]) and parents[0] not in chain:
            chain.append(parents[0])
        return chain[1:]
