"""Compute metrics as pure functions of records; docs/metrics.md has the definitions.

A metric turns an episode into observations: zeros and ones for a rate, one amount for a mean, none
where it is undefined. Its value is the mean of all observations, None where there are none.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

from karma.agent.goals.goals import alternatives, object_names, parse_goal
from karma.bench.figures.statistics import Estimate, mean, rate
from karma.household.ids import root_type
from karma.household.pieces import base_type
from karma.household.types import types_with
from karma.journal.formats import COST_DIGITS
from karma.journal.records import (
    Answer,
    AnswerTiming,
    Call,
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Metric:
    """A column of a table."""

    key: str  # its name in files
    title: str  # its name in tables
    says: str  # what it is, in few words
    of: Amount  # an episode's observations
    only: Callable[[EpisodeRecord], bool] | None = None  # undefined unless an episode has this:
    # a row without a planner has no planner calls, rather than 0
    is_rate: bool = False  # they are zeros and ones
    is_solved: bool = False  # of a saving: of pairs that both solved; who gives up searches little
    digits: int = 2  # after the point


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


def _retrieved_of_held(episode: TimedEpisode) -> Observations:
    found = []
    for sub in episode.record.subtasks:
        if sub.answers and sub.hits:
            kinds = types_of(sub.recalled)
            there = sum(base_type(kind) in kinds for kind in wanted_types(sub.goals))
            found.append(float(there >= sub.hits))
    return found


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


# ----------------------------------------------------------------- the columns

METRICS = (
    Metric(
        key="success", title="SR", is_rate=True,
        says="tasks of which every goal of every instruction held when that instruction ended",
        of=lambda one: [float(one.record.success)],  # an error is a failure
    ),
    Metric(
        key="success_to_do", title="SR to do", is_rate=True, only=lambda one: not one.to_do,
        says="the same of the tasks whose goals did not all hold when they began",
        of=lambda one: [float(one.record.success)] if one.record.to_do else [],
    ),
    Metric(
        key="subtasks_done", title="sub-tasks", is_rate=True,
        says="instructions all of whose goals held at their end",
        of=lambda one: [float(sub.success) for sub in one.record.subtasks if sub.goals],
    ),
    Metric(
        key="goals_met", title="goals", of=_goals_met, is_rate=True,
        says="goals that held at the end of their instruction",
    ),
    Metric(
        key="refused", title="refused", is_rate=True,
        only=lambda one: any(sub.refused for sub in one.subtasks),
        says="instructions that the planner would not carry out",
        of=lambda one: [float(s.refused is not None) for s in one.record.subtasks if s.answers],
    ),
    Metric(
        key="timed_out", title="timed out", only=lambda one: one.timed_out, is_rate=True,
        says="answers of the planner that the clock cut off",
        of=lambda one: [float(answer.finish == "time") for answer in _answers(one)],
    ),
    Metric(
        key="retrieved", title="MRA", of=_retrieved, only=_remembers, is_rate=True,
        says="of the instructions that come back to a thing, those with its unit in the prompt",
    ),
    Metric(
        key="retrieved_of_held", title="MRA of held", of=_retrieved_of_held, only=_remembers,
        is_rate=True, says="the same where memory held something that was needed",
    ),
    Metric(
        key="hits", title="MHR cold", only=_remembers, is_rate=True,
        says="of the things that instructions need, those in short-term memory, cold start "
        "included",
        of=lambda one: _hits(one.record.subtasks),
    ),
    Metric(
        key="hits_later", title="MHR steady", only=_remembers, is_rate=True,
        says="the same over the later half of each sequence",
        of=lambda one: _hits(one.record.subtasks[(len(one.record.subtasks) + 1) // 2 :]),
    ),
    Metric(
        key="explorations", title="places searched", of=explorations, digits=1,
        says="area nodes visited and containers opened in search of things",
    ),
    Metric(
        key="actions", title="steps", of=actions, digits=0,
        says="actions that the world was asked for",
    ),
    Metric(
        key="tour_places", title="places of tour", digits=1,
        says="places looked around from on the first tour of the room, which made its map",
        of=lambda one: _tours(one, lambda tour: tour.places),
    ),
    Metric(
        key="tour_actions", title="steps of tour", digits=0,
        says="actions of that tour; in no other figure but those with the tour",
        of=lambda one: _tours(one, lambda tour: tour.actions),
    ),
    Metric(
        key="planner_calls", title="planner calls", only=_plans, digits=1,
        says="answers asked of the planner",
        of=lambda one: [float(len(_answers(one)))],  # 0: an error came before the first prompt
    ),
    Metric(
        key="prompt_tokens", title="prompt tokens", only=_plans, digits=0,
        says="tokens put to the planner",
        of=lambda one: _sum(answer.prompt_tokens for answer in _answers(one)),
    ),
    Metric(
        key="completion_tokens", title="answer tokens", only=_plans, digits=0,
        says="tokens that it answered",
        of=lambda one: _sum(answer.completion_tokens for answer in _answers(one)),
    ),
    Metric(key="seconds", title="s", of=seconds, says="seconds by the clock"),
    Metric(
        key="first_token_s", title="s to first token", digits=3,
        says="seconds before an answer of the planner begins",
        of=lambda one: [t.first_token_s for t in _times(one) if t.first_token_s is not None],
    ),
    Metric(
        key="answer_s", title="s per answer", digits=3,
        says="seconds of an answer of the planner",
        of=lambda one: [answer.total_s for answer in _times(one)],
    ),
    Metric(
        key="hosted_requests", title="requests", only=_is_hosted, digits=1,
        says="requests to hosted models of all roles",
        of=lambda one: [float(sum(spent.requests for spent in one.record.spent()))],
    ),
    Metric(
        key="hosted_tokens", title="hosted tokens", only=_is_hosted, digits=0,
        says="tokens of hosted models of all roles, both ways",
        of=lambda one: _sum(
            n for role in one.record.spent() for n in (role.prompt_tokens, role.completion_tokens)
        ),
    ),
    Metric(
        key="cost", title="cost", only=_is_hosted, digits=COST_DIGITS,
        says="of hosted models of all roles, in the currency of the price table",
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
        recalled=(),
        queries=0,
        hits=0,
        hosted=(),
    )
