"""Where an episode failed: the step that a reader wants to see first."""

from collections.abc import Collection
from dataclasses import dataclass

from karma.bench.report.story import EpisodeStory, Moment, Part


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
