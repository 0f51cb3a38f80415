"""The nouns and the roles; every arrow of the flow picture in `karma/__init__.py` is one of these.

World coordinates follow AI2-THOR: metres, y up; yaw in degrees, 0 = +z, 90 = +x; horizon in
degrees, down positive.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any, Literal, Protocol, Self, get_args, runtime_checkable

import numpy as np
from numpy.typing import NDArray

Vec3 = tuple[float, float, float]
Frame = NDArray[np.uint8]  # (H, W, 3) RGB
Vectors = NDArray[np.float32]  # (n, d), rows of length 1
Region = tuple[float, float, float, float]  # left, top, right, bottom; pixels of a frame
Point = tuple[float, float]  # x, y; pixels of a frame
Kind = Literal["simple", "composite", "complex", "sequence"]  # of tasks

State = Literal[
    "heated", "cooked", "sliced", "cleaned", "dirty", "filled",
    "used up", "off", "on", "opened", "closed", "none",
]  # the 12 words of KARMA Fig. 10  # fmt: skip


# ----------------------------------------------------------------- where it is


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneRef:
    """A room: its name, which maps, memory and records use, and its file."""

    name: str
    path: str = ""  # "" for a room that the world knows by its name

    @classmethod
    def of(cls, source: str) -> Self:
        """Return the room that a name or a path means.

        >>> SceneRef.of("kitchen_1"), SceneRef.of("rooms/loft.json").name
        (SceneRef(name='kitchen_1', path=''), 'loft')
        """
        path = Path(source)
        is_file = path.suffix == ".json" or path.name != source
        return cls(name=path.stem, path=source) if is_file else cls(name=source)

    @property
    def source(self) -> str:
        """What `World.reset` takes."""
        return self.path or self.name


# ----------------------------------------------------------------- what the robot sees


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """Where the agent stands and looks."""

    position_m: Vec3
    yaw_deg: float
    horizon_deg: float
    standing: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraPose:
    """Where the agent's camera is and how it maps the world to a frame."""

    position_m: Vec3
    yaw_deg: float
    horizon_deg: float
    fov_deg: float  # vertical
    width_px: int
    height_px: int


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenObject:
    """One object in view, as the simulator's own detector labels it (KARMA §4.1)."""

    object_id: str
    object_type: str
    position_m: Vec3
    box_center_m: Vec3
    box_size_m: Vec3
    pickupable: bool
    parent_ids: tuple[str, ...] = ()
    states: tuple[str, ...] = ()  # words of `State`, sorted; () when nothing was read
    controls: tuple[str, ...] = ()  # ids of what it switches: a knob's burner
    region: Region | None = None  # where its box is in the frame it was seen in
    silhouette: tuple[Point, ...] = ()  # corners of its box there, pixels, may reach out of it

    @property
    def is_somewhere(self) -> bool:
        """Whether its place is a number in all directions: a camera may tell none."""
        return all(map(isfinite, (*self.position_m, *self.box_center_m, *self.box_size_m)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Detection:
    """One thing that a detector found in a picture."""

    label: str  # one of the words that were asked for
    score: float  # in [0, 1]
    box_px: Region
    mask: NDArray[np.bool_] | None = field(default=None, compare=False, repr=False)  # (H, W)


ReasonKind = Literal[
    "open", "on", "closed", "held", "broken", "empty", "full", "misplaced", "unreached", "other",
    "pickupable", "openable", "toggleable", "breakable", "sliceable", "canFillWithLiquid",
]  # how a thing is that must not be so; or the capability that it lacks  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Reason:
    """Why the world refused an action."""

    words: str  # the world's, without what no planner can use (stack, asset hashes)
    kind: ReasonKind
    elsewhere: bool = False  # standing elsewhere may help


@dataclass(frozen=True, slots=True, kw_only=True)
class Observation:
    """What the agent knows after one action: what is in view or was touched, never more."""

    pose: Pose
    camera: CameraPose
    seen: tuple[SeenObject, ...]  # in view, without what is held
    held: SeenObject | None
    reachable: frozenset[str]  # ids in view that an arm can get at: not behind glass
    reason: Reason | None = None  # why the last action did not happen; None: it did
    touched: tuple[SeenObject, ...] = ()  # out of view, but just acted on
    pieces: tuple[SeenObject, ...] = ()  # what a touched thing was just cut into
    washed: frozenset[str] = frozenset()  # known ids that a tap just turned on has washed
    heated: frozenset[str] = frozenset()  # known ids that are hot after something was switched on
    cooled: frozenset[str] = frozenset()  # known ids in a fridge that was just shut
    render: Callable[[], Frame | None] = field(default=lambda: None, compare=False, repr=False)
    look_at: Callable[[SeenObject], tuple[str, ...]] = field(
        default=lambda seen: seen.states, compare=False, repr=False
    )  # states of something in view or held; a picture is read when this is asked


@dataclass(frozen=True, slots=True, kw_only=True)
class Capture:
    """What a camera takes in of one moment, with the simulator's own instance masks."""

    rgb: Frame
    depth_m: NDArray[np.float32]  # (H, W), metres along the camera's forward axis
    masks: Mapping[str, NDArray[np.bool_]]  # object id -> where it shows, (H, W)


@dataclass(frozen=True, slots=True, kw_only=True)
class TrueObject(SeenObject):
    """One object as it is, seen or not."""

    distance_m: float
    visible: bool
    child_ids: tuple[str, ...]  # what lies in or on it
    receptacle: bool
    openable: bool
    dirtyable: bool
    broken: bool
    temperature: str  # "Hot", "Cold" or "RoomTemp"


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """The whole scene after one action: for the judge of goals, the expert and the benchmark only.

    `washed`, `heated` and `cooled` say what the last action did, by ids.
    """

    objects: tuple[TrueObject, ...]
    held_ids: frozenset[str]
    washed: frozenset[str]
    heated: frozenset[str]
    cooled: frozenset[str]


# ----------------------------------------------------------------- what it remembers


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
    missed: frozenset[str]  # ids that were not where they were believed to be
    cut: frozenset[str]  # ids of wholes that are no more
    ended: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # words no longer true
    spilled: frozenset[str] = frozenset()  # thrown vessels: what was in them may lie anywhere
    left: Mapping[str, str] = field(default_factory=dict)  # opened or on by it -> skill that undoes
    taken: Mapping[str, str] = field(default_factory=dict)  # id -> place that it was taken from

    @property
    def gone(self) -> frozenset[str]:
        """What memory must forget: missed and not seen since, or cut."""
        return (self.missed - self.seen.keys()) | self.cut


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
class Recalled:
    """A unit that recall chose, with its cosine similarity in [-1, 1]."""

    unit: MemoryUnit
    similarity: float


# ----------------------------------------------------------------- what it plans


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkedExample:
    """An instruction and its program, shown to the planner."""

    instruction: str
    program: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Fixture:
    """One immovable thing of the map."""

    object_id: str
    object_type: str
    position_m: Vec3


@dataclass(frozen=True, slots=True, kw_only=True)
class Area:
    """One area node of long-term memory: a cell to stand on and search from."""

    name: str  # "node_3"
    position_m: Vec3
    contains: tuple[str, ...] = ()  # types of the immovable objects assigned to it
    adjacent: tuple[str, ...] = ()  # names of the areas that can be walked to directly
    fixtures: tuple[Fixture, ...] = ()  # the immovable objects assigned to it, by id


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

    name: str  # an object type, or a deed of `karma.language`
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Prompt:
    """Planner input in the cut in which it is always decoded.

    `stable` (role, API, examples, scene graph; ends in a newline) is evaluated once per scene and
    kept; `changing` (recalled memory, instruction) follows it. Pictures go before `changing`; a
    model that takes none refuses them.
    """

    stable: str
    changing: str
    pictures: tuple[Frame, ...] = field(default=(), compare=False, repr=False)


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


@dataclass(frozen=True, slots=True, kw_only=True)
class ProgramSpec:
    """What a program may say: the language that constrained decoding admits."""

    skills: tuple[Skill, ...]
    objects: tuple[str, ...]  # names known to memory or in view
    positions: tuple[str, ...] = ()  # area nodes, e.g. "node_3"
    max_calls: int = 40
    refusals: tuple[RefusalKind, ...] = ()  # for which one line may stand, in place of any call
    narrowed: tuple[tuple[str, tuple[tuple[str, ...], ...]], ...] = ()  # skill, names by argument


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanSpec:
    """What a plan in JSON may say: short texts by key, then numbers and names of listed actions."""

    texts: tuple[str, ...]  # keys, in their order
    plan: str  # key of the list of actions
    number: str  # key of an action's number
    name: str  # key of its name
    actions: tuple[str, ...]  # names, by number
    max_text: int = 300  # characters of each text
    max_actions: int = 20


AnswerSpec = ProgramSpec | PlanSpec


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


Constraint = Literal["free", "syntax", "types"]
"""Any text; programs; programs with names that fit the skill by their types."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Decoding:
    """How a planner's answers are drawn."""

    constraint: Constraint = "types"  # what an answer may say
    temperature: float = 0.0
    retry_temperature: float = 0.6  # once a program has failed, the same again will not help
    seed: int = 0
    max_tokens: int = 512
    answer_seconds: float | None = None  # by the clock, reading the prompt counted; None: no bound
    attempts: int = 4  # per request; later ones quote the error
    inspected: bool = True  # see `karma.agent.planning.inspector`
    refusing: bool = False  # the planner has learnt to refuse requests, or is told how to


@dataclass(frozen=True, slots=True, kw_only=True)
class Engine:
    """What a local model was computed by; answers may depend on it in their last bits."""

    device: str  # as llama.cpp names it: "CPU", "CUDA0", "Metal"
    gpu_layers: int  # of the model, that lie on it; 0 on the CPU
    n_ctx: int  # tokens
    threads: int
    batch: int  # tokens per call of the prompt
    kv: str  # type of the kept keys and values, e.g. "f16"
    flash_attention: bool


Thinking = Literal["off", "on"]  # of a model that can think before it answers

KvState = Literal["kept", "evaluated"]  # of a prompt's stable part


@dataclass(frozen=True, slots=True, kw_only=True)
class Certainty:
    """How sure a model was of its own answer, by what it would have said without any grammar."""

    mean_logprob: float  # natural logarithm of the chance of a token, over those of the answer
    least_logprob: float  # of the token that it was least sure of
    refusing: float | None = None  # chance that the answer refuses; None where it may not


@dataclass(frozen=True, slots=True, kw_only=True)
class Completion:
    """A model's answer and what it cost; None where a hosted model does not tell."""

    text: str
    finish: Literal["stop", "length", "time", "cycle", "filter"]  # all but the first have a fault
    prompt_tokens: int | None
    reused_tokens: int | None  # of the prompt, taken from kept KV state
    completion_tokens: int | None
    first_token_s: float | None
    total_s: float
    cost: float | None = None  # in the currency of the user's price table
    reasoning: str = ""  # what a thinking model said before its answer
    constrained: bool | None = None  # a grammar held; None where it is not known
    fault: str = ""  # why it cannot be a program, whatever it says: cut off, or not held
    engine: Engine | None = None  # None where it is not ours to know
    state: KvState | None = None  # where that of the stable part came from, likewise
    certainty: Certainty | None = None  # None where a model does not tell


@dataclass(frozen=True, slots=True, kw_only=True)
class Heard:
    """What has come of an answer while the model is still at it."""

    text: str  # since it was heard last, a thought's too
    tokens: int | None  # so far; None where a hosted model does not tell
    seconds: float  # since it was asked


Listener = Callable[[Heard], None]

Scoring = Literal["sum", "average"]  # of the log-probabilities of a text's tokens
END = ""  # as a text to be scored: the answer ends here


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """The likeliest text of a closed list, and what it cost to find."""

    number: int  # in the list given; the first of equals
    score: float
    prompt_tokens: int
    reused_tokens: int  # of the prompt, taken from kept KV state
    completion_tokens: int  # of the text that was chosen
    run_tokens: int  # of all texts, that had to be decoded to be sure
    total_s: float
    engine: Engine | None = None  # None where it is not ours to know


@dataclass(frozen=True, slots=True, kw_only=True)
class SkillResult:
    """What one skill did; a refusal of the world is a value with a reason."""

    call: SkillCall
    ok: bool
    reason: str = ""
    detail: str = ""  # a refusal in full, with ids: the blocker, what is there, what would help
    actions: int = 0  # world steps taken
    explorations: int = 0  # area nodes visited in search of an object
    object_ids: tuple[str, ...] = ()  # what the names resolved to


@dataclass(frozen=True, slots=True, kw_only=True)
class Known:
    """Where the agent believes one object to be."""

    object_id: str
    object_type: str
    position_m: Vec3
    place_id: str | None = None  # receptacle it was last seen in or on
    source: Literal["held", "memory", "graph", "seen"] = "seen"
    box_center_m: Vec3 | None = None  # of the room it takes, where that is known
    box_size_m: Vec3 = (0.0, 0.0, 0.0)


# ----------------------------------------------------------------- what an instruction came to


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """One planner call: what was recalled, asked, answered, and whether it parsed."""

    prompt: Prompt
    completion: Completion
    calls: tuple[SkillCall, ...]
    names: Mapping[str, str]  # what short names in the calls stand for (name -> object id)
    recalled: tuple[Recalled, ...] = ()  # of short-term memory, the best first
    units: tuple[MemoryUnit, ...] = ()  # in the prompt, the last used last
    refused: RefusedRequest | None = None  # in place of calls: the request, not the answer
    error: str = ""  # why the answer was refused; quoted in the next prompt
    failure: FailedProgram | None = None  # the same with the program, for planners that can read it
    dropped: tuple[str, ...] = ()  # lines of the answer that were no part of the program
    examples: tuple[str, ...] = ()  # instructions of the worked examples that were retrieved


@dataclass(frozen=True, slots=True, kw_only=True)
class Tour:
    """What the first tour of a room cost: the walk that made its map, which later visits save."""

    scene: str  # name of the room
    places: int  # walked to and looked around from
    actions: int  # of the world


Found = Literal["seen", "done", "otherwise", "unseen"]  # done: by the agent's deed, out of sight


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """What a program was to bring about, held against what the agent has seen, never the truth."""

    text: str  # "the apple is in the fridge"
    found: Found
    note: str = ""  # what was seen in its place

    def __str__(self) -> str:
        """Return it as people are told."""
        said = {"done": "done, not seen", "otherwise": "no", "unseen": "not seen"}
        note = f", {self.note}" if self.note else ""
        return f"{self.text}: {said.get(self.found, self.found)}{note}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """The last thing a method yields for an instruction."""

    finished: bool  # every skill of the last program succeeded, and all that the first was to do
    resident: tuple[MemoryUnit, ...]  # short-term memory before the instruction
    handled_ids: tuple[str, ...]  # in the order of use
    kept: tuple[MemoryUnit, ...] = ()  # short-term memory after it
    tour: Tour | None = None  # that made the map in use, now or earlier; no part of the episode
    checks: tuple[Check, ...] = ()  # of its programs, where the method looks back
    change: MemoryChange | None = None  # what memory has learnt, where anything was done


AgentEvent = Plan | SkillResult | Outcome
"""What happens while an instruction is carried out: an answer, a call's result, the report."""


# ----------------------------------------------------------------- what it is asked


@dataclass(frozen=True, slots=True, kw_only=True)
class Goal:
    """One symbolic condition, e.g. INSIDE(Apple, Fridge) (KARMA Table 3), or 2*ON(Pen, Desk)."""

    predicate: str  # ON, INSIDE, STATE, TOGGLEON, TOGGLEOFF, HOLDON
    arguments: tuple[str, ...]
    count: int = 1  # of how many objects it must hold; ON and INSIDE: with one and the same place

    def __str__(self) -> str:
        """Return the paper's notation, a count before it."""
        times = "" if self.count == 1 else f"{self.count}*"
        return f"{times}{self.predicate}({', '.join(self.arguments)}): 1"


@dataclass(frozen=True, slots=True, kw_only=True)
class SubTask:
    """One instruction of a sequence and what must hold when it ends."""

    instruction: str
    goals: tuple[Goal, ...] = ()
    passing: tuple[Goal, ...] = ()  # of the goals; these need only have held since it began
    whole: str = ""  # the user's whole text, of which this is a part
    scene: SceneRef | None = None  # the room it plays in; None: the task's

    @property
    def is_whole(self) -> bool:
        """Whether it is all that the user said: a task by itself, as in ALFRED."""
        return self.whole == self.instruction


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """A sequence of instructions in one home; it succeeds when every sub-task does.

    Of a "sequence" every sub-task is a task by itself, in a room of its own choice.
    """

    id: str
    kind: Kind
    scene: SceneRef
    subtasks: tuple[SubTask, ...]
    notes: tuple[str, ...] = field(default=())  # what a loader could not resolve
    group: str = ""  # in a benchmark of others: a list or type that is counted apart
    trained: bool | None = None  # it stands word for word in training data; None: not known

    @property
    def counted_as(self) -> str:
        """The group or kind that figures count it in."""
        return self.group or self.kind

    @property
    def scenes(self) -> tuple[SceneRef, ...]:
        """The rooms it plays in, in the order in which they are first needed."""
        rooms = (sub.scene or self.scene for sub in self.subtasks)
        return tuple(dict.fromkeys(rooms)) or (self.scene,)


# ----------------------------------------------------------------- the roles


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


@runtime_checkable
class ImageEmbedder(Embedder, Protocol):
    """Text and pictures to unit vectors of one space."""

    def embed_images(self, frames: Sequence[Frame]) -> Vectors:
        """Return one row of length 1 per picture, shape (n, dimension); n may be 0."""


class Detector(Protocol):
    """Finds things in a picture by their names: the eyes of a robot without a simulator."""

    name: str

    def detect(self, image: Frame, words: Sequence[str]) -> Sequence[Detection]:
        """Return what was found, the best score first; labels are of the words."""


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


Hints = Callable[[str], Sequence[Hint]]  # of an instruction, for one planner
Examples = Callable[[str], Sequence[WorkedExample]]  # for an instruction, the nearest last


class AnswerChecker(Protocol):
    """Checks a planner's answers before they are carried out, by what a plug-in knows."""

    def contradicts(self, refused: RefusedRequest) -> bool:
        """Return whether a refusal's reason is wrong, so that the planner is asked again."""

    def check(
        self, calls: Sequence[SkillCall], request: PlanRequest, names: Mapping[str, str]
    ) -> tuple[tuple[SkillCall, ...], str]:
        """Return a program as it may be carried out, and why it may not be, or ""."""

    def program(self, request: PlanRequest, names: Mapping[str, str]) -> tuple[SkillCall, ...]:
        """Return a program of the checker's own, where no answer will do; () for none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Resources:
    """What a run has loaded once, for all of its methods."""

    model: LanguageModel  # the planner's
    profile: str  # of its prompts: "compact", "full" or "goals"
    decoding: Decoding = Decoding()
    listen: Listener | None = None  # hears the planner's answers as they come
    hints: Hints | None = None  # where the planner has learnt to read them
    examples: Examples | None = None  # for a planner that is told of some
    recall: Recall
    vision: VisionModel
    detector: Detector | None = None  # for perception by pictures without given boxes
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
