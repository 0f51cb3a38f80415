"""Compute metrics as pure functions of records; docs/metrics.md has the definitions.

A metric turns an episode into observations: zeros and ones for a rate, one amount for a mean, none
where it is undefined. Its value is the mean of all observations, None where there are none.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

from karma.bench.figures.statistics import Estimate, mean, rate
from karma.goals.goals import alternatives, object_names, parse_goal
from karma.household.ids import root_type
from karma.household.pieces import base_type
from karma.household.types import types_with
from karma.journal.entries import Answer, Call
from karma.journal.formats import COST_DIGITS
from karma.journal.records import (
    AnswerTiming,
    EpisodeRecord,
    EpisodeTiming,
    Key,
    SubTaskRecord,
)
from karma.types.memory import Tour

Need = frozenset[str]  # types of which any will do


@cache
def needs(goals: tuple[str, ...]) -> tuple[Need, ...]:
    """Return the things that can be carried which goals speak of, in order.

    >>> needs(("INSIDE(Apple/Tomato, Fridge): 1", "HOLDON(robot, Mug): 1"))[1]
    frozenset({'Mug'})
    """
    found = (frozenset(map(base_type, group)) for group in _loose(goals))
    return tuple(dict.fromkeys(found))


def related_needs(record: EpisodeRecord) -> list[tuple[Need, ...]]:
    """Return for each sub-task the needs shared with an earlier sub-task in the same room."""
    spoken: dict[str, set[str]] = {}
    found = []
    for sub in record.subtasks:
        mine, here = needs(sub.goals), spoken.setdefault(sub.scene, set())
        found.append(tuple(need for need in mine if need & here))
        here.update(*mine)
    return found


def types_of(object_ids: Iterable[str]) -> frozenset[str]:
    """Return the types of some ids; pieces count for their whole.

    >>> sorted(types_of(["Apple|+1|+1|+0|AppleSliced_2", "Mug|+0|+1|+0"]))
    ['Apple', 'Mug']
    """
    return frozenset(base_type(root_type(object_id)) for object_id in object_ids)


def wanted_types(goals: tuple[str, ...]) -> tuple[str, ...]:
    """Return every type that the goals allow, once; queries and hits of a record count these."""
    return tuple(dict.fromkeys(kind for group in _loose(goals) for kind in group))


@cache
def _loose(goals: tuple[str, ...]) -> tuple[tuple[str, ...], ...]:
    """Return for each name in the goals its alternatives that can be carried, if it has any."""
    groups = (
        tuple(root_type(kind) for kind in alternatives(name))
        for text in goals
        for name in object_names(parse_goal(text))
    )
    loose = (tuple(k for k in group if k in types_with("pickupable")) for group in groups)
    return tuple(group for group in loose if group)


Observations = Sequence[float]


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedEpisode:
    """A record with its timing, if that is known."""

    record: EpisodeRecord
    timing: EpisodeTiming | None = None
    tours: Mapping[str, tuple[Tour, int]] = field(default_factory=dict)  # by room: the first tour
    # that its row's map of it is from, and how many instructions the row was asked in it


Amount = Callable[[TimedEpisode], Observations]


@dataclass(frozen=True, slots=True)
class Metric:
    """A column of a table."""

    key: str  # its name in files
    title: str  # its name in tables
    of: Amount  # an episode's observations
    digits: int = 2  # after the point
    is_rate: bool = False  # they are zeros and ones
    only: Callable[[EpisodeRecord], bool] | None = None  # undefined unless an episode has this:
    # a method without a planner has no planner calls, rather than 0
    both_solved: bool = False  # of a saving: only of pairs that both solved


# ----------------------------------------------------------------- what an episode shows


def _of_calls(amount: Callable[[Call], int], *, related: bool = False) -> Amount:
    """Return a sum over skill calls; `related`: of sub-tasks that come back to something."""

    def of(episode: TimedEpisode) -> Observations:
        subtasks: Iterable[SubTaskRecord] = episode.record.subtasks
        if related:
            pairs = zip(subtasks, related_needs(episode.record), strict=True)
            subtasks = (sub for sub, needs in pairs if needs)
        return [float(sum(amount(call) for sub in subtasks for call in sub.calls))]

    return of


explorations = _of_calls(lambda call: call.explorations)  # places searched
actions = _of_calls(lambda call: call.actions)  # that the world was asked for
explorations_related = _of_calls(lambda call: call.explorations, related=True)
actions_related = _of_calls(lambda call: call.actions, related=True)


def seconds(episode: TimedEpisode) -> Observations:
    """Return how long the instructions took by the clock."""
    return [episode.timing.seconds] if episode.timing else []


def _goals_met(episode: TimedEpisode) -> Observations:
    return [
        float(number >= len(sub.unmet))
        for sub in episode.record.subtasks
        for number in range(len(sub.goals))
    ]


def _retrieved(episode: TimedEpisode) -> Observations:
    return [
        float(all(need & types_of(sub.recalled) for need in related))
        for sub, related in zip(episode.record.subtasks, related_needs(episode.record), strict=True)
        if sub.answers and related
    ]


def _hits(subtasks: Iterable[SubTaskRecord]) -> Observations:
    """Return for each thing that a planner needed whether short-term memory held it."""
    asked = (sub for sub in subtasks if sub.answers)
    return [float(number < sub.hits) for sub in asked for number in range(sub.queries)]


def _tours(episode: TimedEpisode, amount: Callable[[Tour], int]) -> Observations:
    tours = episode.record.tours
    return [float(sum(map(amount, tours)))] if tours else []


def _sum(amounts: Iterable[float | None]) -> Observations:
    """Return a sum; nothing where a part of it is not known."""
    found = list(amounts)
    return [] if None in found else [float(sum(one for one in found if one is not None))]


def _answers(episode: TimedEpisode) -> list[Answer]:
    return [answer for sub in episode.record.subtasks for answer in sub.answers]


def _times(episode: TimedEpisode) -> list[AnswerTiming]:
    """Return how long each answer of the planner took, where that is known."""
    parts = episode.timing.subtasks if episode.timing else ()
    return [answer for sub in parts for answer in sub.answers]


# ----------------------------------------------------------------- which rows have what


def _remembers(record: EpisodeRecord) -> bool:
    """Return whether short-term memory ever held or brought anything."""
    return any(sub.hits or sub.recalled for sub in record.subtasks)


def _plans(record: EpisodeRecord) -> bool:
    return any(sub.answers for sub in record.subtasks)


def _is_hosted(record: EpisodeRecord) -> bool:
    return bool(record.spent())


# ----------------------------------------------------------------- the columns, by docs/metrics.md


METRICS = (
    Metric("success", "SR", lambda one: [float(one.record.success)], is_rate=True),
    Metric(
        "success_to_do", "SR to do", is_rate=True, only=lambda one: not one.to_do,
        of=lambda one: [float(one.record.success)] if one.record.to_do else [],
    ),
    Metric(
        "subtasks_done", "sub-tasks", is_rate=True,
        of=lambda one: [float(sub.success) for sub in one.record.subtasks if sub.goals],
    ),
    Metric("goals_met", "goals", _goals_met, is_rate=True),
    Metric(
        "refused", "refused", is_rate=True,
        only=lambda one: any(sub.refused for sub in one.subtasks),
        of=lambda one: [float(s.refused is not None) for s in one.record.subtasks if s.answers],
    ),
    Metric(
        "timed_out", "timed out", is_rate=True, only=lambda one: one.timed_out,
        of=lambda one: [float(answer.finish == "time") for answer in _answers(one)],
    ),
    Metric("retrieved", "MRA", _retrieved, is_rate=True, only=_remembers),
    Metric(
        "hits", "MHR cold", is_rate=True, only=_remembers,
        of=lambda one: _hits(one.record.subtasks),
    ),
    Metric(
        "hits_later", "MHR steady", is_rate=True, only=_remembers,
        of=lambda one: _hits(one.record.subtasks[(len(one.record.subtasks) + 1) // 2 :]),
    ),
    Metric("explorations", "places searched", explorations, digits=1),
    Metric("actions", "steps", actions, digits=0),
    Metric(
        "tour_places", "places of tour", lambda one: _tours(one, lambda t: t.places), digits=1
    ),
    Metric(
        "tour_actions", "steps of tour", lambda one: _tours(one, lambda t: t.actions), digits=0
    ),
    Metric(  # 0: an error came before the first prompt
        "planner_calls", "planner calls", digits=1, only=_plans,
        of=lambda one: [float(len(_answers(one)))],
    ),
    Metric(
        "prompt_tokens", "prompt tokens", digits=0, only=_plans,
        of=lambda one: _sum(answer.prompt_tokens for answer in _answers(one)),
    ),
    Metric(
        "completion_tokens", "answer tokens", digits=0, only=_plans,
        of=lambda one: _sum(answer.completion_tokens for answer in _answers(one)),
    ),
    Metric("seconds", "s", seconds),
    Metric(
        "first_token_s", "s to first token", digits=3,
        of=lambda one: [t.first_token_s for t in _times(one) if t.first_token_s is not None],
    ),
    Metric("answer_s", "s per answer", lambda one: [t.total_s for t in _times(one)], digits=3),
    Metric(
        "hosted_requests", "requests", digits=1, only=_is_hosted,
        of=lambda one: [float(sum(spent.requests for spent in one.record.spent()))],
    ),
    Metric(
        "hosted_tokens", "hosted tokens", digits=0, only=_is_hosted,
        of=lambda one: _sum(
            n for role in one.record.spent() for n in (role.prompt_tokens, role.completion_tokens)
        ),
    ),
    Metric(
        "cost", "cost", digits=COST_DIGITS, only=_is_hosted,
        of=lambda one: _sum(spent.cost for spent in one.record.spent()),
    ),
)  # fmt: skip
SUCCESS = METRICS[0]


# ----------------------------------------------------------------- over several episodes


def measure(metric: Metric, episodes: Sequence[TimedEpisode]) -> Estimate:
    """Return a metric over episodes, with an interval that keeps the seeds of a task together."""
    if metric.only is not None and not any(metric.only(episode.record) for episode in episodes):
        return Estimate(value=None)
    groups = list(by_task(metric, episodes).values())
    return rate(groups) if metric.is_rate else mean(groups)


def by_task(metric: Metric, episodes: Iterable[TimedEpisode]) -> dict[str, list[float]]:
    """Return the observations of each task, tasks and seeds in order."""
    found: dict[str, list[float]] = {}
    for one in sorted(episodes, key=lambda one: (one.record.task, one.record.seed)):
        found.setdefault(one.record.task, []).extend(metric.of(one))
    return found


def episodes_of(
    records: Sequence[EpisodeRecord], timings: Mapping[Key, EpisodeTiming] | None = None
) -> list[TimedEpisode]:
    """Return episodes to be measured; sub-tasks after an error count as failed.

    Tasks that nobody can be judged by are not among them.
    """
    timings, complete = timings or {}, _completed(records)
    tours = {
        row: _tours_of(complete, row) for row in dict.fromkeys(record.row for record in records)
    }
    return [
        TimedEpisode(record=one, timing=timings.get(one.key), tours=tours[one.row])
        for one in complete
        if not one.unjudged
    ]


def _tours_of(records: Sequence[EpisodeRecord], row: str) -> dict[str, tuple[Tour, int]]:
    """Return the first tour of each room that a row has, and its instructions in the room."""
    mine = [record for record in records if record.row == row]
    asked = Counter(room for record in mine for room in record.rooms)
    tours = {tour.scene: tour for record in mine for tour in record.tours}
    return {room: (tour, asked[room]) for room, tour in tours.items()}


def _completed(records: Sequence[EpisodeRecord]) -> list[EpisodeRecord]:
    """Return records whose error ended them with the sub-tasks that other records have of the task.

    No planner was asked in those, nothing was done, and no goal held.
    """
    longest: dict[str, tuple[SubTaskRecord, ...]] = {}
    for record in records:
        if len(record.subtasks) > len(longest.get(record.task, ())):
            longest[record.task] = record.subtasks
    return [
        replace(record, subtasks=(*record.subtasks, *map(_undone, rest)))
        if record.error and (rest := longest.get(record.task, ())[len(record.subtasks) :])
        else record
        for record in records
    ]


def _undone(sub: SubTaskRecord) -> SubTaskRecord:
    return replace(
        sub,
        unmet=sub.goals,
        finished=False,
        answers=(),
        calls=(),
        queries=0,
        hits=0,
        hosted=(),
    )
