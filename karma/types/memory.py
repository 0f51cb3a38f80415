"""Units of short-term memory, areas of long-term memory, and what changes them."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from karma.types.observation import Observation, SeenObject
from karma.types.space import Vec3


@dataclass(frozen=True, slots=True, kw_only=True)
class MemoryUnit:
    """One line of short-term memory (KARMA §3.4, Listing 1, and the state it leaves out)."""

    object_id: str
    object_type: str
    position_m: Vec3
    states: tuple[str, ...] = ()  # a set with history, in the order they came about
    place_id: str | None = None  # the receptacle it was last seen in or on; "hand" when held
    handled: bool = False  # manipulated by the agent, not only seen
    image: str | None = None  # path below the run folder
    scene: str = ""  # name of the room that the object is in


@dataclass(frozen=True, slots=True, kw_only=True)
class Experience:
    """What skills have seen and done since an instruction was given: what memory is made of."""

    seen: Mapping[str, SeenObject]  # the latest sight of each id
    views: Mapping[str, Observation]  # in which each id was last in view or in the hand
    held: SeenObject | None  # at the last look
    handled_ids: tuple[str, ...]  # in the order of use, with repeats
    effects: Mapping[str, tuple[str, ...]]  # lasting state words that the agent brought about
    missed: Mapping[str, Vec3]  # id -> where it was not found
    cut: frozenset[str]  # ids of wholes that are no more
    emptied: frozenset[str] = frozenset()  # ids of vessels that were poured out
    spilled: frozenset[str] = frozenset()  # thrown vessels: what was in them may lie anywhere
    left: Mapping[str, str] = field(default_factory=dict)  # opened or on by it -> skill that undoes
    taken: Mapping[str, str] = field(default_factory=dict)  # id -> place that it was taken from

    @property
    def gone(self) -> frozenset[str]:
        """What memory must forget: missed and not seen since, or cut."""
        return self.cut | (self.missed.keys() - self.seen.keys())


@dataclass(frozen=True, slots=True, kw_only=True)
class MemoryChange:
    """What one instruction leaves in memory: learnt again, it makes the same memory."""

    scene: str  # name of the room
    at_s: float  # of the home's clock
    corrected: tuple[MemoryUnit, ...] = ()  # lines written anew, which is no use of them
    forgotten: tuple[str, ...] = ()  # ids
    remembered: tuple[MemoryUnit, ...] = ()  # in the order of use
    seen: tuple[SeenObject, ...] = ()  # the latest sight of each id
    in_view: tuple[str, ...] = ()  # ids
    gone: tuple[str, ...] = ()  # ids that are no more where they were, or no more at all
    taken: tuple[tuple[str, str], ...] = ()  # id, and id of the place that it was first taken from


@dataclass(frozen=True, slots=True, kw_only=True)
class Exchange:
    """A request of the conversation and what became of it."""

    request: str
    report: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Recalled:
    """A unit that recall chose, with its cosine similarity in [-1, 1]."""

    unit: MemoryUnit
    similarity: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Known:
    """Where the agent believes one object to be."""

    object_id: str
    object_type: str
    position_m: Vec3
    place_id: str | None = None  # receptacle it was last seen in or on
    box_center_m: Vec3 | None = None  # of the room it takes, where that is known
    box_size_m: Vec3 = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Area:
    """One area node of long-term memory: a cell to stand on and search from."""

    name: str  # "node_3"
    position_m: Vec3
    contains: tuple[str, ...] = ()  # types of the immovable objects assigned to it
    adjacent: tuple[str, ...] = ()  # names of the areas that can be walked to directly
    fixtures: tuple[Known, ...] = ()  # the immovable objects assigned to it, by id


@dataclass(frozen=True, slots=True, kw_only=True)
class Tour:
    """What the first tour of a room cost: the walk that made its map, which later visits save."""

    scene: str  # name of the room
    places: int  # walked to and looked around from
    actions: int  # of the world
