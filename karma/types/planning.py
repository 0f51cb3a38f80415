"""What a planner is given, and the programs that it may answer."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, Self, get_args, runtime_checkable

from karma.types.grammars import program_grammar
from karma.types.memory import Area, MemoryUnit, Recalled
from karma.types.observation import SeenObject
from karma.types.space import Frame, Vec3


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkedExample:
    """An instruction and its program, shown to the planner."""

    instruction: str
    program: str


@dataclass(frozen=True, slots=True, kw_only=True)
class FailedProgram:
    """A program that came to nothing: refused when it was read, or by the world at one line."""

    lines: tuple[str, ...]  # of the program; with object ids for short names once it ran
    failed: int | None  # number of the line that failed, from 0; None: no single one
    reason: str  # why, and what would help; ids stand for things
    ran: bool = False  # the lines before the one that failed were carried out


@dataclass(frozen=True, slots=True, kw_only=True)
class Meaning:
    """What a phrase may mean, and how near to it that lies."""

    name: str  # an object type or an action
    similarity: float  # cosine, in [-1, 1]


@dataclass(frozen=True, slots=True, kw_only=True)
class Hint:
    """Words that a planner may not know, and what they may mean."""

    phrase: str
    meanings: tuple[Meaning, ...]  # the nearest first


@dataclass(frozen=True, slots=True, kw_only=True)
class Advice:
    """What an assistant knows of an instruction besides its words."""

    plain: str = ""  # the instruction in plain words, for a planner that did not understand
    actions: Sequence[str] = ()  # what a parser found in it, line by line, for the full prompt
    checker: "AnswerChecker | None" = None  # of the planner's answers
    only: Mapping[str, str] = field(default_factory=dict)  # type -> id of the only object meant


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanRequest:
    """All that a prompt may say, and what the program may not search for."""

    instruction: str
    whole: str = ""  # all that the user said, where the instruction is a part of it
    areas: Sequence[Area] = ()  # long-term memory; () without it
    graph_text: str = ""  # the same in the paper's text form, which then stands for it
    recalled: Sequence[Recalled] = ()  # of short-term memory, the best first
    units: Sequence[MemoryUnit] = ()  # in the prompt: recalled or just handled, the last used last
    held_id: str | None = None
    held_type: str | None = None
    error: str = ""  # why the last answer was refused or failed, in short
    failures: Sequence[FailedProgram] = ()  # of this instruction so far, the last one last
    examples: Sequence[WorkedExample] = ()  # for the instruction; the compact profile has no room
    missing: Sequence[str] = ()  # what was searched for in vain: ids or types
    advice: Advice = field(default_factory=Advice)
    first: Sequence["SkillCall"] = ()  # the first executed program; later ones keep its objects
    done: Sequence["SkillCall"] = ()  # what went well of the programs so far
    seen: Sequence[SeenObject] = ()  # in this room by now, as last seen, the first seen first
    named: Mapping[str, str] = field(default_factory=dict)  # furniture's names (-> id), which last
    hints: Sequence[Hint] = ()  # what words of the instruction may mean
    objects: Mapping[str, Collection[str]] = field(default_factory=dict)  # mentioned, and types


@dataclass(frozen=True, slots=True, kw_only=True)
class Prompt:
    """Planner input in the cut in which it is always decoded.

    `stable` (role, API, examples, scene graph; ends in a newline) is evaluated once per scene and
    kept; it is the system message of a chat. `turns` are earlier messages of user and assistant,
    in pairs. `changing` (recalled memory, instruction) is the user's last message. Pictures go
    before `changing`; a model that takes none refuses them.
    """

    stable: str
    changing: str
    turns: tuple[tuple[str, str], ...] = ()
    pictures: tuple[Frame, ...] = field(default=(), compare=False, repr=False)

    @property
    def before(self) -> str:
        """The text before `changing`, for a model without a chat template."""
        return self.stable + "".join(f"{user}{answer}\n" for user, answer in self.turns)

    @property
    def text(self) -> str:
        """The whole prompt as plain text."""
        return self.before + self.changing


@dataclass(frozen=True, slots=True, kw_only=True)
class Skill:
    """One function of the skill API; its effects are in `karma.household.skill_effects`."""

    name: str
    arguments: tuple[Literal["object", "positions"], ...]
    optional: int = 0  # how many of the last arguments may be left out
    doc: str = ""  # comment lines of Listing 2
    deed: str = ""  # as people are told of it; "" for ways to get somewhere
    takes: str = ""  # what AI2-THOR calls a thing that it can be done with; "": any
    cannot: str = ""  # what is said of other things
    needs: str = ""  # what it does and needs, for who reads whole prompts; household facts in {}
    action: str = ""  # AI2-THOR's, that does it; "" where several do


RefusalKind = Literal[
    "deed", "thing", "place", "language", "negated", "impossible", "unclear",
    "time", "condition", "question", "statement", "incomplete", "astray", "which",
    "alike",
]  # fmt: skip


REFUSAL_KINDS: tuple[RefusalKind, ...] = get_args(RefusalKind)[:7]  # that a planner may give


@dataclass(frozen=True, slots=True, kw_only=True)
class RefusedRequest:
    """A request that is not carried out, and why; it stands in place of a program."""

    kind: RefusalKind
    by: Literal["planner", "doubt", "inspector", "guard"] = "planner"  # doubt: until 0.3.0
    words: tuple[str, ...] = ()  # of the request, that nothing here is meant by

    def __str__(self) -> str:
        """Return the line as a planner writes it."""
        return f"refuse('{self.kind}')"


class AnswerSpec(Protocol):
    """The language of answers, for constrained decoding; hashable."""

    def __hash__(self) -> int:
        """Return a hash, by which an engine keeps what it makes of a spec."""

    @property
    def grammar(self) -> str:
        """Return the grammar, as `karma.types.grammars` says; ValueError if it admits nothing."""


@runtime_checkable
class JsonSpec(AnswerSpec, Protocol):
    """The language of answers in JSON, of which servers take a schema, too."""

    @property
    def schema(self) -> dict[str, Any]:
        """Return the JSON schema of the answers; it may admit more than the grammar."""

    def admits(self, text: str) -> bool:
        """Return whether a JSON text is an answer that can be read."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Grammar:
    """An `AnswerSpec` that is written down."""

    grammar: str


EndKind = Literal["done", "tell", "ask", "refuse"]


@dataclass(frozen=True, slots=True, kw_only=True)
class End:
    """How a model ends an instruction in tool mode, in its own words."""

    kind: EndKind
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ProgramSpec:
    """What a program may say: the `AnswerSpec` of lines, each written as `str(SkillCall)`."""

    skills: tuple[Skill, ...]
    objects: tuple[str, ...]  # names known to memory or in view
    positions: tuple[str, ...] = ()  # area nodes, e.g. "node_3"
    max_calls: int = 40
    refusals: tuple[RefusalKind, ...] = ()  # for which one line may stand, in place of any call
    narrowed: tuple[tuple[str, tuple[tuple[str, ...], ...]], ...] = ()  # skill, names by argument

    @property
    def grammar(self) -> str:
        """Return the grammar of programs; errors as those of `program_grammar`."""
        refusals = [str(RefusedRequest(kind=kind)) for kind in dict.fromkeys(self.refusals)]
        return program_grammar(self, refusals)


@dataclass(frozen=True, slots=True, kw_only=True)
class SkillCall:
    """One parsed line of a program, e.g. `PutObject(robot, 'Apple', 'Fridge')`."""

    skill: str
    objects: tuple[str, ...]
    positions: tuple[str | Vec3, ...] = ()
    line: int = 0
    exact: bool = False  # of several of its type this receptacle is meant, and no other
    turn: int = 0  # other things of its name that the program has put away before

    @classmethod
    def of(cls, skill: str, *objects: str) -> Self:
        """Return a call with names alone."""
        return cls(skill=skill, objects=objects)

    def __str__(self) -> str:
        """Return the line as a planner writes it."""
        parts = ["robot", *(f"'{name}'" for name in self.objects)]
        if self.positions:
            words = (f"'{p}'" if isinstance(p, str) else repr(p) for p in self.positions)
            parts.append(f"[{', '.join(words)}]")
        return f"{self.skill}({', '.join(parts)})"


class AnswerChecker(Protocol):
    """Checks a planner's answers before they are carried out, by what a plug-in knows."""

    def review(self, answer: Any, request: PlanRequest, *, attempt: int, is_last: bool) -> Any:
        """Return the `Review` of a `Plan` of `karma.types.events`, which imports this module."""
