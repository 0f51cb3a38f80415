"""A step log told as moments that a reader can step through, and where the episode failed."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from karma.agent.journal import steps
from karma.contracts import MemoryUnit
from karma.household.ids import is_id, type_of
from karma.memory.short_term import line_key

Change = Literal["added", "changed", "left"]
MomentKind = Literal["start", "enter", "subtask", "plan", "action", "skill", "outcome"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Done:
    """One skill call and how it went."""

    text: str
    ok: bool
    reason: str
    object_ids: tuple[str, ...]
    plan: int  # number of the program it is of, -1 without any


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """One instruction: what was known, asked, answered and done."""

    instruction: str
    scene: str  # the room that it plays in
    before: tuple[MemoryUnit, ...]  # short-term memory when it came
    after: tuple[MemoryUnit, ...] | None = None  # None when the episode broke off
    finished: bool = False
    unmet: tuple[str, ...] = ()
    map_text: str = ""  # long-term memory as the prompt has it
    plans: tuple[steps.Planned, ...] = ()
    calls: tuple[Done, ...] = ()

    @property
    def changes(self) -> Mapping[str, Change]:
        """What the instruction did to short-term memory, by the key of its lines."""
        return changes(self.before, self.before if self.after is None else self.after)


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """One thing that happened."""

    kind: MomentKind
    text: str = ""
    ok: bool = True
    error: str = ""
    part: int = -1  # number of the instruction, also of the one that a room is entered for
    plan: int = -1  # the last program of it so far
    call: int = -1  # the skill call that is being carried out
    action: steps.Action | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeStory:
    """One episode as its step log tells it."""

    scene: str  # where it begins
    parts: tuple[Part, ...]
    moments: tuple[Moment, ...]

    @property
    def scenes(self) -> tuple[str, ...]:
        """The rooms in the order in which they are entered."""
        entered = (moment.text for moment in self.moments if moment.kind == "enter")
        return tuple(dict.fromkeys((self.scene, *entered)))


def changes(before: Sequence[MemoryUnit], after: Sequence[MemoryUnit]) -> dict[str, Change]:
    """Return what became of each unit that is not as it was; those that left come last."""
    old, new = ({unit_key(unit): unit for unit in units} for units in (before, after))
    found: dict[str, Change] = {}
    for key, unit in new.items():
        if key not in old:
            found[key] = "added"
        elif unit != old[key]:
            found[key] = "changed"
    found.update({key: "left" for key in old if key not in new})
    return found


def unit_key(unit: MemoryUnit) -> str:
    """Return what names a unit among those of all rooms."""
    return line_key(unit.object_id, unit.scene)


def told(lines: Iterable[steps.Step]) -> EpisodeStory:
    """Return the story of one log; one that breaks off is told as far as it goes."""
    teller = _Teller()
    for line in lines:
        teller.add(line)
    return EpisodeStory(
        scene=teller.scene, parts=tuple(teller.parts), moments=tuple(teller.attributed())
    )


class _Teller:
    """The story so far."""

    def __init__(self) -> None:
        self.scene = self._here = ""
        self.parts: list[Part] = []
        self.moments: list[Moment] = []
        self._map = ""

    def add(self, line: steps.Step) -> None:
        """Take in one line."""
        match line:
            case steps.Start():
                self.scene = self._here = line.scene
                self._moment("start", line.scene)
            case steps.Enter():
                self._here = line.scene
                self._moment("enter", line.scene)
            case steps.Instruction():
                self.parts.append(
                    Part(
                        instruction=line.instruction,
                        scene=self._here,
                        before=line.memory,
                        map_text=self._map,
                    )
                )
                self._moment("subtask", line.instruction)
            case steps.Map():
                self._map = line.text
                self._change(map_text=line.text)
            case steps.Planned():
                self._plan(line)
            case steps.Action():
                self._moment("action", label(line), ok=line.ok, error=line.error, action=line)
            case steps.SkillStep():
                self._skill(line)
            case steps.Ended():
                self._change(after=line.memory, finished=line.finished, unmet=line.unmet)
                self._moment("outcome", ok=not line.unmet, error="; ".join(line.unmet))

    def attributed(self) -> list[Moment]:
        """Return the moments; each action knows its skill call, each door its instruction."""
        found: list[Moment] = []
        call, part = -1, len(self.parts) - 1
        for moment in reversed(self.moments):
            if moment.kind == "skill":
                call = moment.call
            elif moment.kind != "action":
                call = -1
            if moment.kind == "enter":
                moment = replace(moment, part=part, plan=-1)
            part = moment.part
            found.append(replace(moment, call=call))
        return found[::-1]

    def _plan(self, line: steps.Planned) -> None:
        self._change(plans=(*self._part.plans, line))
        self._moment("plan", "program", ok=not line.error, error=line.error)

    def _skill(self, line: steps.SkillStep) -> None:
        done = Done(
            text=line.call, ok=line.ok, reason=line.reason, object_ids=line.object_ids,
            plan=len(self._part.plans) - 1,
        )  # fmt: skip
        self._change(calls=(*self._part.calls, done))
        number = len(self._part.calls) - 1
        self._moment("skill", line.call, ok=line.ok, error=line.reason, call=number)

    @property
    def _part(self) -> Part:
        if not self.parts:
            self.parts.append(Part(instruction="", scene=self._here, before=()))
        return self.parts[-1]

    def _change(self, **fields: Any) -> None:
        if self.parts or "map_text" not in fields:
            self.parts[-1:] = [replace(self._part, **fields)]

    def _moment(self, kind: MomentKind, text: str = "", **fields: Any) -> None:
        part, plan = len(self.parts) - 1, len(self.parts[-1].plans) - 1 if self.parts else -1
        self.moments.append(Moment(kind=kind, text=text, part=part, plan=plan, **fields))


def label(line: steps.Action) -> str:
    """Return an action in few words: its name and what it is done to."""
    words = [line.action]
    for name, value in line.arguments.items():
        if isinstance(value, str) and is_id(value):
            words.append(type_of(value))
        elif isinstance(value, float):
            words.append(f"{name}={value:.2f}")
        elif not isinstance(value, dict | list):
            words.append(f"{name}={value}")
    return " ".join(words)


@dataclass(frozen=True, slots=True, kw_only=True)
class FailedAt:
    """One moment of a story, and what went wrong there."""

    moment: int
    part: int  # number of the instruction, -1 before the first
    words: str


def failed_at(story: EpisodeStory, shown: Collection[int]) -> FailedAt | None:
    """Return where the first of the shown instructions that failed was first refused anything.

    That is an answer without a program or a skill call that was refused; where nothing was, the
    end of the instruction. None where no shown instruction failed.
    """
    for number, part in enumerate(story.parts):
        if number in shown and (part.after is None or part.unmet):
            return _in_part(story, number, part)
    return None


def broke_off_at(story: EpisodeStory, moments: int) -> FailedAt:
    """Return the last of so many moments, for an episode that broke off between instructions."""
    last = moments - 1
    words = "nothing was refused; here the episode broke off"
    return FailedAt(moment=last, part=story.moments[last].part, words=words)


def _in_part(story: EpisodeStory, number: int, part: Part) -> FailedAt:
    last = 0
    for at, moment in enumerate(story.moments):
        if moment.part != number:
            continue
        last = at
        if words := _refused(moment, part):
            return FailedAt(moment=at, part=number, words=words)
    how = "the episode broke off" if part.after is None else "it ended with goals unmet"
    return FailedAt(moment=last, part=number, words=f"nothing was refused; here {how}")


def _refused(moment: Moment, part: Part) -> str:
    """Return what was refused at a moment, "" where nothing was."""
    if moment.kind == "skill" and not moment.ok:
        return f"{moment.text} failed: {moment.error}"
    if moment.kind != "plan":
        return ""
    plan = part.plans[moment.plan]
    if plan.refused:
        return f"the planner refused: {plan.refused}"
    return f"the answer was no program: {plan.error}" if plan.error else ""


def endings(part: Part) -> tuple[str, ...]:
    """Return for each attempt at an instruction why it ended."""
    return tuple(_ending(part, number) for number in range(len(part.plans)))


def _ending(part: Part, number: int) -> str:
    plan, is_last = part.plans[number], number == len(part.plans) - 1
    calls = [call for call in part.calls if call.plan == number]
    if plan.refused:
        return f"the planner refused: {plan.refused}"
    if plan.error:
        return f"no program: {plan.error}"
    if calls and not calls[-1].ok:
        return f"{calls[-1].text} failed: {calls[-1].reason}"
    if is_last and part.after is None:
        return "the episode broke off"
    if is_last and not part.finished:
        return "stopped before the program's end"
    left = f", with {len(part.unmet)} of its goals unmet" if is_last and part.unmet else ""
    return f"the program ran to its end{left}"
