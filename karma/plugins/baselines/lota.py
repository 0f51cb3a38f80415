"""LoTa-Bench, modified (KARMA Table 1): a language model alone, without memory of the home.

`lota.score` chooses one step after the other from a closed list, by the log-likelihood that the
model gives each; `lota.generate` takes a whole plan in one answer. Where they deviate from their
sources is in docs/plugins/baselines.md.
"""

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Literal, Self

from karma.agent.body.skills import Skills
from karma.agent.knowledge import RoomKnowledge
from karma.agent.options import settings_of
from karma.agent.planning.inspector import mend, objection
from karma.agent.planning.planner import Planner, grounded
from karma.agent.planning.program import SKILLS
from karma.agent.planning.prompt import compact, template
from karma.agent.planning.recovery import program_of
from karma.agent.tour import floor_of, position_of
from karma.bench.methods.expert import NoOptions
from karma.errors import ModelError, ProgramError
from karma.household.pieces import base_type
from karma.household.types import in_words, object_types
from karma.household.uses import BASIN_OF, BURNER
from karma.memory.scene_graph import SceneGraph
from karma.plugins.baselines.baseline import PlannerRow, RoomByRoom, request_for
from karma.types.completion import END, Choice, Completion
from karma.types.events import Outcome, Plan, SkillResult
from karma.types.observation import SeenObject
from karma.types.planning import ProgramSpec, Prompt, Skill, SkillCall
from karma.types.roles import LanguageModel, Resources, ScoringModel, World
from karma.types.space import SceneRef
from karma.types.tasks import SubTask

Form = Literal["words", "compact"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Past:
    """An instruction of the sequence and the steps that were taken for it."""

    instruction: str
    steps: tuple[str, ...]


# what is done for an instruction; returns whether it was finished, and the steps taken
Acting = Generator[Plan | SkillResult, None, tuple[bool, tuple[str, ...]]]

_KEEPS_PLACE = ("OpenObject", "CloseObject", "PutObject")  # what was found last stays the place


@dataclass(frozen=True, slots=True, kw_only=True)
class LotaScoreSettings:
    """The numbers of the source."""

    max_steps: int = 25  # of one instruction


class LotaScore:
    """The `lota.score` row.

    `form`: "words", or "compact" for a planner that was trained on it.
    """

    settings_kind: ClassVar[type] = LotaScoreSettings

    def __init__(self, chooser: ScoringModel, form: Form, settings: LotaScoreSettings) -> None:
        self.settings, self.form = settings, form
        self.name = f"LoTa-Bench (modified: scored, {form})"
        self._chooser = chooser
        self._steps = steps_in_words() if form == "words" else steps_in_lines()
        self._texts = tuple(self._steps)

    @classmethod
    def build(cls, resources: Resources, options: Mapping[str, Any]) -> Self:
        """Make the row; KarmaError for a wrong option, ModelError without log-probabilities."""
        settings = settings_of(LotaScoreSettings, options)
        form: Form = "compact" if resources.profile == "compact" else "words"
        return cls(chooser_of(resources.model), form, settings)

    def begin(self, world: World, scene: SceneRef, *, seed: int, folder: Path) -> "LotaEpisode":
        """Start an episode: no steps taken; only the cells of the floor are known."""
        return LotaEpisode(self.act, world, scene)

    def act(self, skills: Skills, instruction: str, history: Sequence[Past]) -> Acting:
        """Take the likeliest step until that is `done` or the steps are used up."""
        begun_with = skills.experience.held
        steps: list[str] = []
        place, finished = "", False
        while len(steps) < self.settings.max_steps and not finished:
            if self.form == "compact":
                prompt = lines_prompt(instruction, begun_with, steps)
            else:
                prompt = words_prompt(history, instruction, steps)
            plan = self._choose(prompt)
            yield plan
            steps.append(plan.completion.text)
            finished = not plan.calls
            for call in plan.calls:
                yield from self._carry_out(skills, call, place)
                place = _place_after(call, place)
        return finished, tuple(steps)

    def _choose(self, prompt: Sequence[str]) -> Plan:
        best = self._chooser.choose(prompt, self._texts, scoring="sum")
        text = self._texts[best.number]
        call = self._steps[text]
        asked = Prompt(stable=prompt[0], changing="".join(prompt[1:]))
        calls = () if call is None else (call,)
        return Plan(prompt=asked, completion=_completion(best, text), calls=calls, names={})

    def _carry_out(self, skills: Skills, call: SkillCall, place: str) -> Iterator[SkillResult]:
        """Do one step; a step that is refused stays in the history like any other."""
        if self.form == "words" and call.skill == "PutObject":
            if not place:
                yield SkillResult(call=call, ok=False, reason="no place was found to put it down")
                return
            call = replace(call, objects=(*call.objects, place))
        calls = (call,) if self.form == "words" else _mended(skills, call)
        for one in calls:
            result = skills.run(one)
            yield result
            if not result.ok:
                return


class LotaGenerate(PlannerRow):
    """The `lota.generate` row: the planner is asked once for each instruction."""

    settings_kind: ClassVar[type] = NoOptions

    def __init__(self, planner: Planner, settings: NoOptions) -> None:
        self.form = "compact" if planner.profile == "compact" else "code"
        self.name = f"LoTa-Bench (modified: generated, {self.form})"
        self._planner = replace(planner, decoding=replace(planner.decoding, attempts=1))

    def begin(self, world: World, scene: SceneRef, *, seed: int, folder: Path) -> "LotaEpisode":
        """Start an episode: no plans made; only the cells of the floor are known."""
        return LotaEpisode(self.act, world, scene)

    def act(self, skills: Skills, instruction: str, history: Sequence[Past]) -> Acting:
        """Ask for a plan and carry out all of it; a line that is refused is passed over."""
        plan = self._ask(skills, instruction, history)
        yield plan
        finished = bool(plan.calls)
        skills.begin_program()
        for call in grounded(plan.calls, plan.names):
            result = skills.run(call)
            yield result
            finished = finished and result.ok
        return finished, (plan.completion.text.rstrip() + "\n",)

    def _ask(self, skills: Skills, instruction: str, history: Sequence[Past]) -> Plan:
        if self.form == "compact":
            return next(self._planner.plan(request_for(instruction, skills.experience.held)))
        prompt, decoding = code_prompt(history, instruction), self._planner.decoding
        spec = ProgramSpec(skills=smart_skills(), objects=named_types())
        completion = self._planner.model.complete(
            prompt,
            spec=None if decoding.constraint == "free" else spec,
            max_tokens=decoding.max_tokens,
            max_seconds=decoding.answer_seconds,
            temperature=decoding.temperature,
            seed=decoding.seed,
            listen=self._planner.listen,
        )
        calls: tuple[SkillCall, ...] = ()
        dropped: tuple[str, ...] = ()
        try:
            found = program_of(completion, smart_skills())
            calls, dropped = tuple(map(_find, found.calls)), found.dropped
            error = "" if calls else "the answer holds no skill call"
        except ProgramError as refused:
            error = str(refused)
        return Plan(
            prompt=prompt, completion=completion, calls=calls, names={}, error=error,
            dropped=dropped,
        )  # fmt: skip


# ----------------------------------------------------------------- an episode of either row


class LotaEpisode(RoomByRoom[RoomKnowledge]):
    """One sequence of instructions, of which only requests and answers are kept.

    `act` carries out one instruction, told the ones before it; of a room only the floor is known.
    """

    def __init__(
        self, act: Callable[[Skills, str, Sequence[Past]], Acting], world: World, scene: SceneRef
    ) -> None:
        super().__init__(world, scene, _floor)
        self._act = act
        self._history: list[Past] = []

    def do(self, subtask: SubTask) -> Iterator[Plan | SkillResult | Outcome]:
        """Carry out one instruction.

        A task by itself is asked for without the ones before it, as in the source.
        """
        if subtask.is_whole:
            self._history.clear()
        skills = Skills(self._world, self._room)
        skills.look()
        finished, steps = yield from self._act(skills, subtask.instruction, self._history)
        self._history.append(Past(instruction=subtask.instruction, steps=steps))
        yield Outcome(finished=finished, resident=(), handled_ids=skills.experience.handled_ids)


def _floor(world: World) -> RoomKnowledge:
    """Return area nodes over the cells that can be stood on."""
    graph = SceneGraph.over(sorted(floor_of(world)), height_m=position_of(world)[1])
    return RoomKnowledge(world, graph)


def chooser_of(
    model: LanguageModel, wanted_by: str = "lota.score", instead: str = "lota.generate"
) -> ScoringModel:
    """Return what scores steps with a model; a message names two rows, with scores and without.

    ModelError if the model tells no log-probabilities.
    """
    if isinstance(model, ScoringModel):
        return model
    raise ModelError(
        f"{model.name}: {wanted_by} needs log-probabilities of whole steps, which this model does"
        f" not tell; take a GGUF file, or the row {instead}"
    )


def _mended(skills: Skills, call: SkillCall) -> tuple[SkillCall, ...]:
    """Return a line with the calls that planners of the compact profile leave out: see `mend`."""
    skills.look()
    seen = {sight.object_type for sight in skills.experience.seen.values()}
    held = skills.experience.held
    known = seen | {base_type(name) for name in seen}
    return mend((call,), known=known, held=base_type(held.object_type) if held else None)


def _place_after(call: SkillCall, place: str) -> str:
    """Return the receptacle found last, which `put down` uses; "" after other steps."""
    if call.skill == "Explore":
        name = call.objects[0]
        return name if name in BASIN_OF or object_types()[name].can("receptacle") else ""
    return place if call.skill in _KEEPS_PLACE else ""


def _find(call: SkillCall) -> SkillCall:
    """Return a walk as a search, which equals the walk where the place is known."""
    return replace(call, skill="Explore") if call.skill == "GoToObject" else call


def _completion(best: Choice, text: str) -> Completion:
    return Completion(
        text=text,
        finish="stop",
        prompt_tokens=best.prompt_tokens,
        reused_tokens=best.reused_tokens,
        completion_tokens=best.completion_tokens,
        first_token_s=best.total_s,
        total_s=best.total_s,
        constrained=True,
        engine=best.engine,
    )


# ----------------------------------------------------------------- forms of prompts
#
# "words" is LoTa-Bench's own form, a dialogue of numbered steps, for any language model. "compact"
# is for planners that were trained on the compact profile: lines of programs. "code" is the whole
# plan in one answer, with SMART-LLM's skills. Object types are the fixed list of
# `karma.household.types`: nothing of a scene.


DONE = " done."  # in words
_PROMPTS = Path(__file__).parent
_NOT_SMART_LLM = ("Explore", "ToggleOn", "ToggleOff")
_VERBS = (
    ("pick up the", "PickupObject"), ("put down the", "PutObject"), ("open the", "OpenObject"),
    ("close the", "CloseObject"), ("slice the", "SliceObject"), ("turn on the", "ToggleOn"),
    ("turn off the", "ToggleOff"), ("break the", "BreakObject"), ("throw away the", "ThrowObject"),
)  # fmt: skip


@cache
def named_types() -> tuple[str, ...]:
    """Return the object types that a step may name; a piece is called as the whole is."""
    return tuple(name for name, kind in object_types().items() if not kind.made_by_slicing)


@cache
def steps_in_words() -> Mapping[str, SkillCall | None]:
    """Return LoTa-Bench's list of steps with the call of each; None ends the instruction.

    Each step ends with the comma that would follow it, so that none begins another. `put down`
    names what is in the hand; its place is what was found last.
    """
    found: dict[str, SkillCall | None] = {DONE: None}
    for name in named_types():
        article = "an" if name[0] in "AEIOU" else "a"
        found[f" find {article} {in_words(name)},"] = SkillCall.of("Explore", name)
    for words, skill in _VERBS:
        for name in named_types():
            probe = "PickupObject" if skill in ("PutObject", "ThrowObject") else skill
            if _possible(SkillCall.of(probe, name)):
                found[f" {words} {in_words(name)},"] = SkillCall.of(skill, name)
    return MappingProxyType(found)


@cache
def steps_in_lines() -> Mapping[str, SkillCall | None]:
    """Return the same list as lines of programs, in which `PutObject` names the place too."""
    calls = [SkillCall.of("GoToObject", name) for name in named_types()]
    carried = [name for name in named_types() if _possible(SkillCall.of("PickupObject", name))]
    for skill in ("PickupObject", "OpenObject", "CloseObject", "SliceObject", "BreakObject",
                  "ToggleOn", "ToggleOff", "SwitchOn", "SwitchOff"):  # fmt: skip
        calls += [c for name in named_types() if _possible(c := SkillCall.of(skill, name))]
    calls += [SkillCall.of("ThrowObject", name) for name in carried]
    calls += [
        put
        for name in carried
        for place in named_types()
        if not objection([put := SkillCall.of("PutObject", name, place)], held=name)
    ]
    return MappingProxyType({END: None, **{f"{call}\n": call for call in calls}})


def _possible(call: SkillCall) -> bool:
    name = call.objects[0]
    if call.skill in ("SwitchOn", "SwitchOff", "ToggleOn", "ToggleOff"):
        return name == BURNER or object_types()[name].can("toggleable")
    return not objection([call], held=None)


def words_prompt(
    history: Sequence[Past], instruction: str, steps: Sequence[str]
) -> tuple[str, ...]:
    """Return the dialogue so far: examples, earlier instructions, this one and its steps."""
    segments = [_text("lota_score.txt")]
    for past in history:
        segments += [_asked(past.instruction), *_numbered(past.steps), "\n"]
    return (*segments, _asked(instruction), *_numbered(steps))


def _asked(instruction: str) -> str:
    return f"Human: {_sentence(instruction)}\nRobot: 1."


def _numbered(steps: Sequence[str]) -> list[str]:
    return [
        step if step == DONE else f"{step} {number}." for number, step in enumerate(steps, start=2)
    ]


def lines_prompt(
    instruction: str, held: SeenObject | None, steps: Sequence[str]
) -> tuple[str, ...]:
    """Return the compact prompt without memory, followed by the program so far.

    Earlier instructions are left out: planners of this profile were never shown any.
    """
    prompt = compact(request_for(instruction, held)).prompt
    return (prompt.stable, prompt.changing, *steps)


def smart_skills() -> tuple[Skill, ...]:
    """Return those of our skills that SMART-LLM has too."""
    return tuple(skill for skill in SKILLS if skill.name not in _NOT_SMART_LLM)


def code_prompt(history: Sequence[Past], instruction: str) -> Prompt:
    """Return the prompt for a whole plan: skills, object types, examples, earlier plans."""
    stable = template(_PROMPTS / "lota_generate.txt").render(
        skills=smart_skills(), objects=named_types()
    )
    past = [
        f"# Task Description: {_sentence(one.instruction)}\n{''.join(one.steps)}\n"
        for one in history
    ]
    asked = f"# Task Description: {_sentence(instruction)}\n"
    return Prompt(stable=stable, changing="".join(past) + asked)


def _sentence(text: str) -> str:
    """Return an instruction with a capital and a full stop."""
    text = " ".join(text.split()).rstrip(".!? ")
    return f"{text[:1].upper()}{text[1:]}."


@cache
def _text(name: str) -> str:
    return (_PROMPTS / name).read_text(encoding="utf-8")
