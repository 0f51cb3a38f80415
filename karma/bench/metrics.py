"""What is measured: pure functions of the records; docs/metrics.md has the definitions.

A metric turns an episode into observations: zeros and ones for a rate, one amount for a mean, none
where it is undefined. Its value is the mean of all observations, None (printed "–") without any.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

from karma.bench.records import KINDS, Call, EpisodeRecord, EpisodeTiming, Key, SubTaskRecord
from karma.bench.statistics import Estimate, mean, rate
from karma.household.ids import root_type
from karma.household.pieces import base_type
from karma.household.types import object_types
from karma.infer.hosted.cost import total
from karma.tasks.goals import alternatives, object_names, parse_goal

Need = frozenset[str]  # types of which any will do
Observations = Sequence[float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Episode:
    """A record with its timing, if that is known."""

    record: EpisodeRecord
    timing: EpisodeTiming | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Metric:
    """One column.

    Args:
        key: its name in files.
        title: its name in tables.
        of: an episode's observations.
        is_rate: they are zeros and ones.
        of_memory: undefined for a row that never had a unit in short-term memory.
        digits: after the point.
    """

    key: str
    title: str
    of: Callable[[Episode], Observations]
    is_rate: bool = False
    of_memory: bool = False
    digits: int = 2


# ----------------------------------------------------------------- what an episode shows


def success(episode: Episode) -> Observations:
    """Return whether the task was solved; an error is a failure."""
    return [float(episode.record.success)]


def subtasks_done(episode: Episode) -> Observations:
    """Return for each sub-task whether all its goals held when it ended."""
    return [float(sub.success) for sub in episode.record.subtasks if sub.goals]


def goals_met(episode: Episode) -> Observations:
    """Return for each goal whether it held when its sub-task ended."""
    return [
        float(number >= len(sub.unmet))
        for sub in episode.record.subtasks
        for number in range(len(sub.goals))
    ]


def retrieved(episode: Episode) -> Observations:
    """Return for each sub-task about earlier things whether all of them were recalled (MRA)."""
    return [
        float(all(need & types_of(sub.recalled) for need in related))
        for sub, related in _asked(episode.record)
        if related
    ]


def retrieved_of_held(episode: Episode) -> Observations:
    """Return the same for sub-tasks for which memory held something: of those, all recalled."""
    found = []
    for sub, _ in _asked(episode.record):
        if sub.hits:
            kinds = types_of(sub.recalled)
            there = sum(base_type(kind) in kinds for kind in _wanted(sub.goals))
            found.append(float(there >= sub.hits))
    return found


def hits(episode: Episode) -> Observations:
    """Return for each needed thing whether short-term memory held it, cold start counted (MHR)."""
    return [value for sub, _ in _asked(episode.record) for value in _hits(sub)]


def hits_later(episode: Episode) -> Observations:
    """Return the same for the later half of the sequence."""
    parts = episode.record.subtasks
    later = parts[(len(parts) + 1) // 2 :]
    return [value for sub in later if sub.answers for value in _hits(sub)]


def explorations(episode: Episode) -> Observations:
    """Return how many places were searched."""
    return [float(sum(c.explorations for sub in episode.record.subtasks for c in sub.calls))]


def actions(episode: Episode) -> Observations:
    """Return how many actions the world was asked for."""
    return [float(sum(call.actions for sub in episode.record.subtasks for call in sub.calls))]


def explorations_related(episode: Episode) -> Observations:
    """Return how many places were searched in sub-tasks that come back to something."""
    return [float(sum(call.explorations for call in _related_calls(episode.record)))]


def actions_related(episode: Episode) -> Observations:
    """Return how many actions those took."""
    return [float(sum(call.actions for call in _related_calls(episode.record)))]


def planner_calls(episode: Episode) -> Observations:
    """Return how often the planner was asked; nothing for a row without one."""
    number = sum(len(sub.answers) for sub in episode.record.subtasks)
    return [float(number)] if number else []


def prompt_tokens(episode: Episode) -> Observations:
    """Return what was put to the planner."""
    return _sum(a.prompt_tokens for sub in episode.record.subtasks for a in sub.answers)


def completion_tokens(episode: Episode) -> Observations:
    """Return what the planner said."""
    return _sum(a.completion_tokens for sub in episode.record.subtasks for a in sub.answers)


def cost(episode: Episode) -> Observations:
    """Return what hosted models of all roles cost, in the currency of the price table."""
    return _sum(one.cost for one in episode.record.spent())


def seconds(episode: Episode) -> Observations:
    """Return how long the instructions took by the clock."""
    return [episode.timing.seconds] if episode.timing else []


def first_token_s(episode: Episode) -> Observations:
    """Return how long the planner thought before each answer, where that is known."""
    parts = episode.timing.subtasks if episode.timing else ()
    times = [answer.first_token_s for sub in parts for answer in sub.answers]
    return [time for time in times if time is not None]


def answer_s(episode: Episode) -> Observations:
    """Return how long each answer of the planner took by the clock."""
    parts = episode.timing.subtasks if episode.timing else ()
    return [answer.total_s for sub in parts for answer in sub.answers]


SUCCESS = Metric(key="success", title="SR", of=success, is_rate=True)
RETRIEVED = Metric(key="retrieved", title="MRA", of=retrieved, is_rate=True, of_memory=True)
EXPLORATIONS = Metric(key="explorations", title="places searched", of=explorations, digits=1)
ACTIONS = Metric(key="actions", title="steps", of=actions, digits=0)
EXPLORATIONS_RELATED = Metric(
    key="explorations_related", title="places, related", of=explorations_related
)
ACTIONS_RELATED = Metric(key="actions_related", title="steps, related", of=actions_related)
SECONDS = Metric(key="seconds", title="s", of=seconds)
METRICS = (
    SUCCESS,
    Metric(key="subtasks_done", title="sub-tasks", of=subtasks_done, is_rate=True),
    Metric(key="goals_met", title="goals", of=goals_met, is_rate=True),
    RETRIEVED,
    Metric(
        key="retrieved_of_held",
        title="MRA of held",
        of=retrieved_of_held,
        is_rate=True,
        of_memory=True,
    ),
    Metric(key="hits", title="MHR cold", of=hits, is_rate=True, of_memory=True),
    Metric(key="hits_later", title="MHR steady", of=hits_later, is_rate=True, of_memory=True),
    EXPLORATIONS,
    ACTIONS,
    Metric(key="planner_calls", title="planner calls", of=planner_calls, digits=1),
    Metric(key="prompt_tokens", title="prompt tokens", of=prompt_tokens, digits=0),
    Metric(key="completion_tokens", title="answer tokens", of=completion_tokens, digits=0),
    SECONDS,
    Metric(key="first_token_s", title="s to first token", of=first_token_s, digits=3),
    Metric(key="answer_s", title="s per answer", of=answer_s, digits=3),
    Metric(key="cost", title="cost", of=cost, digits=6),
)


# ----------------------------------------------------------------- what rows show


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """All metrics of one row and kind of task."""

    row: str
    kind: str  # or "all"
    episodes: int
    tasks: int
    seeds: int
    values: Mapping[str, Estimate]  # by the metric's key


def measure(metric: Metric, episodes: Sequence[Episode]) -> Estimate:
    """Return a metric over episodes, with an interval that keeps the seeds of a task together."""
    if metric.of_memory and not any(_has_memory(one.record) for one in episodes):
        return Estimate(value=None)
    groups = list(by_task(metric, episodes).values())
    return rate(groups) if metric.is_rate else mean(groups)


def by_task(metric: Metric, episodes: Iterable[Episode]) -> dict[str, list[float]]:
    """Return the observations of each task, tasks and seeds in order."""
    found: dict[str, list[float]] = {}
    for one in sorted(episodes, key=lambda one: (one.record.task, one.record.seed)):
        found.setdefault(one.record.task, []).extend(metric.of(one))
    return found


def figures(
    records: Sequence[EpisodeRecord], timings: Mapping[Key, EpisodeTiming] | None = None
) -> tuple[Figures, ...]:
    """Return every metric of every row and kind, and of all kinds together.

    Rows stand in the order of the records, kinds in the paper's.
    """
    everything = episodes_of(records, timings)
    lines = []
    for row in dict.fromkeys(record.row for record in records):
        mine = [one for one in everything if one.record.row == row]
        for kind in (*KINDS, "all"):
            if some := [one for one in mine if kind in (one.record.kind, "all")]:
                lines.append(figures_of(row, kind, some))
    return tuple(lines)


def figures_of(row: str, kind: str, episodes: Sequence[Episode]) -> Figures:
    """Return every metric of some episodes."""
    return Figures(
        row=row,
        kind=kind,
        episodes=len(episodes),
        tasks=len({one.record.task for one in episodes}),
        seeds=len({one.record.seed for one in episodes}),
        values={metric.key: measure(metric, episodes) for metric in METRICS},
    )


def episodes_of(
    records: Sequence[EpisodeRecord], timings: Mapping[Key, EpisodeTiming] | None = None
) -> list[Episode]:
    """Return episodes to be measured; what an error kept from being tried is in them as missed."""
    timings = timings or {}
    return [
        Episode(record=record, timing=timings.get(record.key)) for record in _completed(records)
    ]


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


# ----------------------------------------------------------------- what a sub-task needs


@cache
def needs(goals: tuple[str, ...]) -> tuple[Need, ...]:
    """Return the things that can be carried which goals speak of, in order.

    >>> needs(("INSIDE(Apple/Tomato, Fridge): 1", "HOLDON(robot, Mug): 1"))[1]
    frozenset({'Mug'})
    """
    found = (frozenset(map(base_type, group)) for group in _loose(goals))
    return tuple(dict.fromkeys(found))


def related_needs(record: EpisodeRecord) -> list[tuple[Need, ...]]:
    """Return for each sub-task the needs that an earlier one of the same room had too."""
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


def _related_calls(record: EpisodeRecord) -> list[Call]:
    pairs = zip(record.subtasks, related_needs(record), strict=True)
    return [call for sub, related in pairs if related for call in sub.calls]


def _asked(record: EpisodeRecord) -> list[tuple[SubTaskRecord, tuple[Need, ...]]]:
    """Return the sub-tasks in which a planner was asked, with their related needs."""
    pairs = zip(record.subtasks, related_needs(record), strict=True)
    return [(sub, related) for sub, related in pairs if sub.answers]


def _wanted(goals: tuple[str, ...]) -> tuple[str, ...]:
    """Return every type that the goals allow, once: what a record's queries and hits count."""
    return tuple(dict.fromkeys(kind for group in _loose(goals) for kind in group))


@cache
def _loose(goals: tuple[str, ...]) -> tuple[tuple[str, ...], ...]:
    """Return for each name in the goals its alternatives that can be carried, if it has any."""
    known = object_types()
    groups = (
        tuple(root_type(kind) for kind in alternatives(name))
        for text in goals
        for name in object_names(parse_goal(text))
    )
    loose = (
        tuple(kind for kind in group if kind in known and known[kind].can("pickupable"))
        for group in groups
    )
    return tuple(group for group in loose if group)


def _hits(sub: SubTaskRecord) -> list[float]:
    return [float(number < sub.hits) for number in range(sub.queries)]


def _has_memory(record: EpisodeRecord) -> bool:
    return any(sub.hits or sub.recalled for sub in record.subtasks)


def _sum(amounts: Iterable[float | None]) -> Observations:
    found = total(amounts)
    return [] if found is None else [float(found)]
