"""Roles that plug-ins can fill: worlds, models, policies, methods."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, Self, runtime_checkable

from karma.types.completion import Choice, Completion, Decoding, Listener, Scoring
from karma.types.events import Outcome, Plan, SkillResult
from karma.types.memory import Area, Known, MemoryUnit, Recalled
from karma.types.observation import SeenObject
from karma.types.planning import AnswerSpec, Hint, Prompt, WorkedExample
from karma.types.space import Frame, SceneRef, Vectors
from karma.types.tasks import SubTask


class Event(Protocol):
    """What a world returns: AI2-THOR's event, at least this much of it."""

    def __bool__(self) -> bool:
        """Return whether the action succeeded."""

    @property
    def metadata(self) -> Mapping[str, Any]:
        """AI2-THOR 5.0.0 metadata, all 37 + 42 fields."""

    @property
    def frame(self) -> Frame | None:
        """RGB picture, or None when nothing was rendered."""


class Stage(Protocol):
    """What a body acts in: all of a world that skills need."""

    @property
    def last_event(self) -> Event:
        """The event of the last action."""

    def step(self, action: str, **arguments: Any) -> Event:
        """Do one action; a refusal is in the event's metadata, misuse raises ValueError."""


class World(Stage, Protocol):
    """Where the robot lives; speaks AI2-THOR 5.0.0."""

    def reset(self, scene: str) -> Event:
        """Load a scene by name or path."""

    def stop(self) -> None:
        """Release what the world holds."""


class ReplacementPolicy(Protocol):
    """Chooses which key leaves a full memory; it sees keys only, never the values."""

    capacity: int

    def touch(self, key: str) -> str | None:
        """Record one use of `key`, inserting it if absent; return the key that left, if any.

        The returned key can be `key` itself: a newcomer may be refused.
        """

    def discard(self, key: str) -> None:
        """Free every line of `key`, if it has one: what it stands for is no more."""

    def __contains__(self, key: object) -> bool:
        """Return whether `key` is resident; changes nothing."""

    def __len__(self) -> int:
        """Return the number of occupied lines, at most `capacity`."""

    def __iter__(self) -> Iterator[str]:
        """Yield resident keys, in a fixed order of the policy's own."""


class Embedder(Protocol):
    """Text to unit vectors."""

    name: str
    dimension: int

    def embed(self, texts: Sequence[str]) -> Vectors:
        """Return one row of length 1 per text, shape (n, dimension); n may be 0."""


class Recall(Protocol):
    """Chooses the units that go into the prompt (KARMA §3.5).

    A registered one is made as `made(embedder, text=...)`: an `Embedder`, and how a unit is put in
    words, a key of `karma.memory.recall.VERBALISERS`; with `folder=` of the run if it takes that.
    """

    def recall(self, query: str, units: Sequence[MemoryUnit], k: int) -> list[Recalled]:
        """Return at most k units, best first; ties keep the order of `units`."""


class LanguageModel(Protocol):
    """A planner's model."""

    name: str

    def complete(
        self,
        prompt: Prompt,
        *,
        spec: AnswerSpec | None = None,
        max_tokens: int = 512,
        max_seconds: float | None = None,
        temperature: float = 0.0,
        seed: int = 0,
        listen: Listener | None = None,
    ) -> Completion:
        """Continue the prompt; with `spec`, only with a program or plan that parses.

        `listen` hears the answer as it comes, and changes nothing of it.
        """


@runtime_checkable
class ScoringModel(Protocol):
    """A language model that tells how likely given texts are; not every one does."""

    name: str

    def choose(
        self, prompt: Sequence[str], continuations: Sequence[str], *, scoring: Scoring = "sum"
    ) -> Choice:
        """Return the likeliest of the texts that may follow the prompt, given in segments."""


class VisionModel(Protocol):
    """Reads object states out of a picture (KARMA §3.4, Fig. 10)."""

    name: str
    needs_pictures: bool  # False: it is asked without one, and none is drawn for it

    def read_states(
        self, image: Frame | None, instruction: str, objects: Sequence[SeenObject]
    ) -> Mapping[str, tuple[str, ...]]:
        """Return object id -> state words, for the objects of interest only."""


class Knowledge(Protocol):
    """What skills may ask the agent's memory."""

    def where(self, name: str) -> Known | None:
        """Return the best known place of an object id, type or receptacle name; None if unknown."""

    def areas(self) -> Sequence[Area]:
        """Return the area nodes to search, in order; () without long-term memory."""


class PhraseReader(Protocol):
    """Finds the phrases of an instruction, for a small planner that was trained with them."""

    def hints(self, instruction: str) -> Sequence[Hint]:
        """Return what phrases that the planner does not know may mean."""

    def objects(self, instruction: str) -> Mapping[str, Collection[str]]:
        """Return the objects that an instruction mentions, in the singular, and types called so."""


Examples = Callable[[str], Sequence[WorkedExample]]  # for an instruction, the nearest last


@dataclass(frozen=True, slots=True, kw_only=True)
class Resources:
    """What a run has loaded once, for all of its methods."""

    model: LanguageModel  # the planner's
    profile: str  # of its prompts: "compact", "full"; or a mode, "goals", "tools"
    decoding: Decoding = field(default_factory=Decoding)
    listen: Listener | None = None  # hears the planner's answers as they come
    reader: PhraseReader | None = None  # for a planner that was trained with hints
    examples: Examples | None = None  # for a planner that is told of some
    recall: Recall
    vision: VisionModel
    embedder: Embedder | None = None  # of texts, e.g. to find examples by their instructions
    maps: Path | None = None  # folder of long-term memories
    learn: bool = False  # write what episodes learn back to it


class Episode(Protocol):
    """One sequence of instructions being carried out, with its world and its memory."""

    def enter(self, scene: SceneRef) -> None:
        """Note that the agent, and its world, are now in that room of the home.

        What is remembered of other rooms stays, and short-term memory goes on. A room's first visit
        may be used to get to know it; then the world is reset to that room's start.
        """

    def do(self, subtask: SubTask) -> Iterator[Plan | SkillResult | Outcome]:
        """Carry out one instruction; yields what happens as it happens, `Outcome` last.

        Only the expert may look at `subtask.goals`.
        """


class Method(Protocol):
    """One way of acting on instructions: a row of KARMA Table 1."""

    @property
    def name(self) -> str:
        """What a table calls the row."""

    @classmethod
    def build(cls, resources: Resources, options: Mapping[str, Any]) -> Self:
        """Make the row from what a run has loaded and from the row's options.

        Raises:
            KarmaError: an option is unknown or of the wrong type, or a resource is missing.
        """

    def begin(self, world: World, scene: SceneRef, *, seed: int, folder: Path) -> Episode:
        """Start an episode: volatile memory empty, long-term memory loaded or built.

        Args:
            world: has been reset to `scene`, and is at its start again afterwards.
            scene: the first room.
            seed: of the method's own draws.
            folder: takes what the episode leaves behind (images).
        """
