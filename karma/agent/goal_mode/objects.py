"""Find the objects of a description: known objects first, then by search."""

from collections.abc import Generator, Iterable
from dataclasses import dataclass

from karma.agent.goal_mode.language import NEEDS, STATES, Description, GoalAnswer
from karma.agent.goal_mode.names import Similar, types_named
from karma.agent.loop import AgentSession
from karma.agent.memory import AgentMemory
from karma.agent.seeing.perceive import place_of
from karma.agent.session import LOOK_OVER, SURVEY
from karma.household.ids import root_id, type_of
from karma.household.pieces import base_type, is_piece
from karma.household.places import FLOOR, OVERLOOKED, landmark_types
from karma.household.saying import with_article
from karma.household.states import NEEDS as STATE_NEEDS
from karma.household.types import Capability, object_types
from karma.household.uses import COFFEE_MACHINE, without_basin
from karma.types.events import AgentEvent
from karma.types.observation import SeenObject
from karma.types.planning import SkillCall

MAX_OBJECTS = 20  # of one description


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownObject:
    """An object that the agent knows of."""

    object_id: str
    object_type: str
    states: tuple[str, ...]
    place_id: str | None


Search = Generator[AgentEvent, None, tuple[str, ...]]
"""Yields skill results; returns ids of objects."""


class ObjectFinder:
    """Finds the objects of the descriptions in a request."""

    def __init__(
        self, memory: AgentMemory, session: AgentSession, similar: Similar | None = None
    ) -> None:
        self._memory, self._session, self._similar = memory, session, similar
        self._searched: set[str] = set()  # types whose search is complete
        self._surveyed = False
        self._handled: list[str] = []  # ids, in the order of use in this request
        self._avoided: tuple[Description, ...] = ()

    def avoid(self, descriptions: Iterable[Description]) -> None:
        """Leave out objects of some descriptions from now on."""
        self._avoided = tuple(descriptions)

    def handle(self, object_id: str) -> None:
        """Note that an object was used: its description means it from now on."""
        self._handled.append(object_id)

    def left_open(self, answer: GoalAnswer) -> frozenset[str]:
        """Return the ids of the objects that the answer opens or switches on."""
        wanted = [wish.what for wish in answer.wishes if wish.verb in ("open", "on")]
        ids = {entry.object_id for what in wanted for entry in self.matching(_bare(what))}
        coffee = any(wish.verb == "coffee" for wish in answer.wishes)
        machines = {
            entry.object_id for entry in self.known() if entry.object_type == COFFEE_MACHINE
        }
        return frozenset(ids | (machines if coffee else set()))

    # ------------------------------------------------------------- names

    def unknown_names(self, answer: GoalAnswer) -> tuple[str, ...]:
        """Return names of an answer that mean nothing that could be in this room."""
        names = [name for d in answer.descriptions for name in (d.name, *(p for p, _ in d.places))]
        return tuple(dict.fromkeys(name for name in names if not self._could_be_here(name)))

    def impossible(self, answer: GoalAnswer) -> tuple[str, ...]:
        """Return the actions and states in an answer that its object types do not allow."""
        found = []
        for wish in answer.wishes:
            needed, done = NEEDS.get(wish.verb, (None, ""))
            if needed is not None and not self._can(wish.what.name, needed):
                found.append(f"{with_article(wish.what.name)} cannot be {done}")
        for description in answer.descriptions:
            for word, _ in description.states:
                needed = STATE_NEEDS.get(STATES[word][0])
                if needed is not None and not self._can(description.name, needed):
                    found.append(f"{with_article(description.name)} is never {word}")
        return tuple(dict.fromkeys(found))

    def _can(self, name: str, capability: Capability) -> bool:
        """Return whether an object of some name may be capable of something."""
        kinds = [object_types()[kind] for kind in self.types(name)]
        return not kinds or any(kind.can(capability) for kind in kinds)

    def types(self, name: str) -> tuple[str, ...]:
        """Return the object types that a name means."""
        object_id = self._named(name)
        return (type_of(object_id),) if object_id else types_named(name, self._similar)

    def _named(self, name: str) -> str | None:
        """Return the id of the object that a numbered name means; a bare type means any."""
        return self._memory.room.names.get(name) if "_" in name else None

    def _could_be_here(self, name: str) -> bool:
        """Return whether a name means a type that can be here: the map shows all furniture."""
        types = self.types(name)
        graph = self._memory.graph
        if graph is None or self._named(name):
            return bool(types)
        here = {node.type for node in graph.objects()} | {FLOOR, *OVERLOOKED}
        here |= {without_basin(kind) for kind in here}
        here |= {entry.object_type for entry in self.known()}
        return any(kind in here or kind not in landmark_types() for kind in types)

    # ------------------------------------------------------------- what is known

    def known(self) -> tuple[KnownObject, ...]:
        """Return all objects that the agent knows of, those handled in this request first."""
        seen = self._session.seen()
        found = {
            unit.object_id: KnownObject(
                object_id=unit.object_id,
                object_type=unit.object_type,
                states=unit.states,
                place_id=unit.place_id,
            )
            for unit in reversed(self._session.remembered().units)
        }
        for object_id, sight in seen.items():
            if self._memory.may_tell(sight) or object_id in found:
                found[object_id] = _as_known(sight)
        graph = self._memory.graph
        for node in graph.objects() if graph is not None else ():
            if node.id not in found:
                found[node.id] = KnownObject(
                    object_id=node.id, object_type=node.type, states=(), place_id=None
                )
        order = {object_id: number for number, object_id in enumerate(self._handled)}
        return tuple(
            sorted(
                found.values(),
                key=lambda entry: (
                    -order.get(entry.object_id, order.get(root_id(entry.object_id), -1))
                ),
            )
        )

    def matching(self, description: Description) -> tuple[KnownObject, ...]:
        """Return the known objects that a description means, without those to be avoided."""
        return tuple(
            entry
            for entry in self.known()
            if self._fits(entry, description)
            and not any(self._fits(entry, avoided) for avoided in self._avoided)
        )

    def _fits(self, entry: KnownObject, description: Description) -> bool:
        if named := self._named(description.name):
            return entry.object_id == named
        types = self.types(description.name)
        if not {entry.object_type, base_type(entry.object_type)} & set(types):
            return False
        for word, holds in description.states:
            state, has = STATES[word]
            cut = state == "sliced" and is_piece(entry.object_type)
            if (cut or state in entry.states) != (has == holds):
                return False
        return all(self._lies_in(entry, place) == holds for place, holds in description.places)

    def _lies_in(self, entry: KnownObject, place: str) -> bool:
        if entry.place_id is None:
            return False
        if named := self._named(place):
            return entry.place_id == named or root_id(entry.place_id) == named
        return without_basin(type_of(entry.place_id)) in self.types(place)

    # ------------------------------------------------------------- looking for them

    def find(self, description: Description) -> Search:
        """Search for the objects of a description; return the ids, at most its count.

        Closed containers are searched if all objects are wanted, or too few are known.
        """
        yield from self.look_at_places(description)
        if any(holds for _, holds in description.places):  # and only there
            ids = [entry.object_id for entry in self.matching(description)]
            return tuple(ids[: description.count])
        wanted = description.count or MAX_OBJECTS
        is_all = description.count is None
        if is_all and not self._is_fixed(description):
            yield from self.survey()
        for object_type in self.types(description.name):
            while is_all or len(self.matching(description)) < wanted:
                if object_type in self._searched or self._is_fixed(description):
                    break
                known = {
                    o.object_id for o in self.known() if base_type(o.object_type) == object_type
                }
                if len(known) >= MAX_OBJECTS:
                    break
                call = SkillCall.of("Explore", object_type)
                result = self._session.call(call, aside=known)
                yield result
                if not result.ok:
                    self._searched.add(object_type)
        return tuple(entry.object_id for entry in self.matching(description))[:wanted]

    def look_at_places(self, description: Description) -> Generator[AgentEvent, None, None]:
        """Observe the contents of the receptacles that a description names."""
        for place, _ in description.places:
            for entry in self.matching(Description(name=place, count=None)):
                if entry.object_id not in self._searched:
                    self._searched.add(entry.object_id)
                    yield from self.look_over(entry.object_id)

    def look_over(self, object_id: str) -> Generator[AgentEvent, None, None]:
        """Go to a receptacle and observe its contents."""
        result = self._session.call(SkillCall.of("GoToObject", object_id))
        yield result
        if object_id in self._session.seen():
            yield self._session.call(SkillCall.of(LOOK_OVER, object_id))

    def survey(self) -> Generator[AgentEvent, None, None]:
        """Look around everywhere, once for a request."""
        if not self._surveyed:
            self._surveyed = True
            yield self._session.call(SkillCall.of(SURVEY))

    def _is_fixed(self, description: Description) -> bool:
        """Return whether a description means furniture, which the map shows."""
        types = self.types(description.name)
        movable = [object_types()[kind].can("pickupable") for kind in types]
        return not any(movable)


def _bare(description: Description) -> Description:
    return Description(name=description.name, count=None, places=description.places)


def _as_known(sight: SeenObject) -> KnownObject:
    return KnownObject(
        object_id=sight.object_id,
        object_type=sight.object_type,
        states=sight.states,
        place_id=place_of(sight),
    )
