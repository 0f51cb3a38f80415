"""What is measured: pure functions of the records; docs/metrics.md has the definitions.

A metric turns an episode into observations: zeros and ones for a rate, one amount for a mean, none
where it is undefined. Its value is the mean of all observations, None where there are none.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from karma.bench.needs import Need, related_needs, types_of, wanted_types
from karma.bench.statistics import Estimate, mean, rate
from karma.contracts import Tour
from karma.household.pieces import base_type
from karma.journal.formats import COST_DIGITS
from karma.journal.records import Call, EpisodeRecord, EpisodeTiming, Key, SubTaskRecord

Observations = Sequence[float]


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedEpisode:
    """A record with its timing, if that is known."""

    record: EpisodeRecord
    timing: EpisodeTiming | None = None
    tours: Mapping[str, tuple[Tour, int]] = field(default_factory=dict)  # by room: the first tour
    # that its row's map of it is from, and how many instructions the row was asked in it

    @property
    def calls(self) -> list[Call]:
        """All skill calls, in order."""
        return [call for sub in self.record.subtasks for call in sub.calls]


@dataclass(frozen=True, slots=True, kw_only=True)
class Metric:
    """One column.

    Args:
        key: its name in files.
        title: its name in tables.
        says: what it is, in few words.
        of: an episode's observations.
        only: undefined unless one of the episodes has this: a row without a planner has no
            planner calls, rather than 0.
        is_rate: they are zeros and ones.
        digits: after the point.
    """

    key: str
    title: str
    says: str
    of: Callable[[TimedEpisode], Observations]
    only: Callable[[EpisodeRecord], bool] | None = None
    is_rate: bool = False
    digits: int = 2


# ----------------------------------------------------------------- which rows have what


def remembers(record: EpisodeRecord) -> bool:
    """Return whether short-term memory ever held or brought anything."""
    return any(sub.hits or sub.recalled for sub in record.subtasks)


def plans(record: EpisodeRecord) -> bool:
    """Return whether a planner was asked."""
    return any(sub.answers for sub in record.subtasks)


def refuses(record: EpisodeRecord) -> bool:
    """Return whether a request was refused."""
    return any(sub.refused for sub in record.subtasks)


def is_timed_out(record: EpisodeRecord) -> bool:
    """Return whether the clock cut off an answer."""
    return record.timed_out


def is_done_before(record: EpisodeRecord) -> bool:
    """Return whether all goals held when the task began."""
    return not record.to_do


def is_hosted(record: EpisodeRecord) -> bool:
    """Return whether hosted models were asked."""
    return bool(record.spent())


# ----------------------------------------------------------------- what an episode shows


def success(episode: TimedEpisode) -> Observations:
    """Return whether the task was solved; an error is a failure."""
    return [float(episode.record.success)]


def success_to_do(episode: TimedEpisode) -> Observations:
    """Return the same for a task of which something was still to be done when it began."""
    return success(episode) if episode.record.to_do else []


def subtasks_done(episode: TimedEpisode) -> Observations:
    """Return for each sub-task whether all its goals held when it ended."""
    return [float(sub.success) for sub in episode.record.subtasks if sub.goals]


def goals_met(episode: TimedEpisode) -> Observations:
    """Return for each goal whether it held when its sub-task ended."""
    return [
        float(number >= len(sub.unmet))
        for sub in episode.record.subtasks
        for number in range(len(sub.goals))
    ]


def refused(episode: TimedEpisode) -> Observations:
    """Return for each instruction that a planner was asked to carry out whether it refused."""
    asked = (sub for sub in episode.record.subtasks if sub.answers)
    return [float(sub.refused is not None) for sub in asked]


def timed_out(episode: TimedEpisode) -> Observations:
    """Return for each answer of the planner whether the clock cut it off."""
    return [float(a.finish == "time") for sub in episode.record.subtasks for a in sub.answers]


def retrieved(episode: TimedEpisode) -> Observations:
    """Return for each sub-task about earlier things whether all of them were recalled (MRA)."""
    return [
        float(all(need & types_of(sub.recalled) for need in related))
        for sub, related in _asked(episode.record)
        if related
    ]


def retrieved_of_held(episode: TimedEpisode) -> Observations:
    """Return the same for sub-tasks for which memory held something: of those, all recalled."""
    found = []
    for sub, _ in _asked(episode.record):
        if sub.hits:
            kinds = types_of(sub.recalled)
            there = sum(base_type(kind) in kinds for kind in wanted_types(sub.goals))
            found.append(float(there >= sub.hits))
    return found


def hits(episode: TimedEpisode) -> Observations:
    """Return for each needed thing whether short-term memory held it, cold start counted (MHR)."""
    return [value for sub, _ in _asked(episode.record) for value in _hits(sub)]


def hits_later(episode: TimedEpisode) -> Observations:
    """Return the same for the later half of the sequence."""
    parts = episode.record.subtasks
    later = parts[(len(parts) + 1) // 2 :]
    return [value for sub in later if sub.answers for value in _hits(sub)]


def explorations(episode: TimedEpisode) -> Observations:
    """Return how many places were searched."""
    return [float(sum(call.explorations for call in episode.calls))]


def actions(episode: TimedEpisode) -> Observations:
    """Return how many actions the world was asked for."""
    return [float(sum(call.actions for call in episode.calls))]


def explorations_related(episode: TimedEpisode) -> Observations:
    """Return how many places were searched in sub-tasks that come back to something."""
    return [float(sum(call.explorations for call in _related_calls(episode.record)))]


def actions_related(episode: TimedEpisode) -> Observations:
    """Return how many actions those took."""
    return [float(sum(call.actions for call in _related_calls(episode.record)))]


def tour_places(episode: TimedEpisode) -> Observations:
    """Return how many places were looked around from to make the maps that the episode used."""
    return _tours(episode, lambda tour: tour.places)


def tour_actions(episode: TimedEpisode) -> Observations:
    """Return how many actions that took."""
    return _tours(episode, lambda tour: tour.actions)


def planner_calls(episode: TimedEpisode) -> Observations:
    """Return how often the planner was asked; 0 where an error came before the first prompt."""
    return [float(sum(len(sub.answers) for sub in episode.record.subtasks))]


def prompt_tokens(episode: TimedEpisode) -> Observations:
    """Return what was put to the planner."""
    return _sum(a.prompt_tokens for sub in episode.record.subtasks for a in sub.answers)


def completion_tokens(episode: TimedEpisode) -> Observations:
    """Return what the planner said."""
    return _sum(a.completion_tokens for sub in episode.record.subtasks for a in sub.answers)


def hosted_requests(episode: TimedEpisode) -> Observations:
    """Return how often hosted models of all roles were asked."""
    return [float(sum(one.requests for one in episode.record.spent()))]


def hosted_tokens(episode: TimedEpisode) -> Observations:
    """Return the tokens of hosted models of all roles, both ways."""
    spent = episode.record.spent()
    return _sum(n for one in spent for n in (one.prompt_tokens, one.completion_tokens))


def cost(episode: TimedEpisode) -> Observations:
    """Return what hosted models of all roles cost, in the currency of the price table."""
    return _sum(one.cost for one in episode.record.spent())


def seconds(episode: TimedEpisode) -> Observations:
    """Return how long the instructions took by the clock."""
    return [episode.timing.seconds] if episode.timing else []


def first_token_s(episode: TimedEpisode) -> Observations:
    """Return how long the planner thought before each answer, where that is known."""
    parts = episode.timing.subtasks if episode.timing else ()
    times = [answer.first_token_s for sub in parts for answer in sub.answers]
    return [time for time in times if time is not None]


def answer_s(episode: TimedEpisode) -> Observations:
    """Return how long each answer of the planner took by the clock."""
    parts = episode.timing.subtasks if episode.timing else ()
    return [answer.total_s for sub in parts for answer in sub.answers]


def _related_calls(record: EpisodeRecord) -> list[Call]:
    pairs = zip(record.subtasks, related_needs(record), strict=True)
    return [call for sub, related in pairs if related for call in sub.calls]


def _asked(record: EpisodeRecord) -> list[tuple[SubTaskRecord, tuple[Need, ...]]]:
    """Return the sub-tasks in which a planner was asked, with their related needs."""
    pairs = zip(record.subtasks, related_needs(record), strict=True)
    return [(sub, related) for sub, related in pairs if sub.answers]


def _hits(sub: SubTaskRecord) -> list[float]:
    return [float(number < sub.hits) for number in range(sub.queries)]


def _tours(episode: TimedEpisode, amount: Callable[[Tour], int]) -> Observations:
    tours = episode.record.tours
    return [float(sum(map(amount, tours)))] if tours else []


def _sum(amounts: Iterable[float | None]) -> Observations:
    """Return a sum; nothing where a part of it is not known."""
    found = list(amounts)
    return [] if None in found else [float(sum(one for one in found if one is not None))]


# ----------------------------------------------------------------- the columns

SUCCESS = Metric(
    key="success", title="SR", of=success, is_rate=True,
    says="tasks of which every goal of every instruction held when that instruction ended",
)  # fmt: skip
EXPLORATIONS = Metric(
    key="explorations", title="places searched", of=explorations, digits=1,
    says="area nodes visited and containers opened in search of things",
)  # fmt: skip
ACTIONS = Metric(
    key="actions", title="steps", of=actions, digits=0, says="actions that the world was asked for"
)
SECONDS = Metric(key="seconds", title="s", of=seconds, says="seconds by the clock")
METRICS = (
    SUCCESS,
    Metric(
        key="success_to_do", title="SR to do", of=success_to_do, only=is_done_before, is_rate=True,
        says="the same of the tasks whose goals did not all hold when they began",
    ),
    Metric(
        key="subtasks_done", title="sub-tasks", of=subtasks_done, is_rate=True,
        says="instructions all of whose goals held at their end",
    ),
    Metric(
        key="goals_met", title="goals", of=goals_met, is_rate=True,
        says="goals that held at the end of their instruction",
    ),
    Metric(
        key="refused", title="refused", of=refused, only=refuses, is_rate=True,
        says="instructions that the planner would not carry out",
    ),
    Metric(
        key="timed_out", title="timed out", of=timed_out, only=is_timed_out, is_rate=True,
        says="answers of the planner that the clock cut off",
    ),
    Metric(
        key="retrieved", title="MRA", of=retrieved, only=remembers, is_rate=True,
        says="of the instructions that come back to a thing, those with its unit in the prompt",
    ),
    Metric(
        key="retrieved_of_held", title="MRA of held", of=retrieved_of_held, only=remembers,
        is_rate=True, says="the same where memory held something that was needed",
    ),
    Metric(
        key="hits", title="MHR cold", of=hits, only=remembers, is_rate=True,
        says="of the things that instructions need, those in short-term memory, cold start "
        "included",
    ),
    Metric(
        key="hits_later", title="MHR steady", of=hits_later, only=remembers, is_rate=True,
        says="the same over the later half of each sequence",
    ),
    EXPLORATIONS,
    ACTIONS,
    Metric(
        key="tour_places", title="places of tour", of=tour_places, digits=1,
        says="places looked around from on the first tour of the room, which made its map",
    ),
    Metric(
        key="tour_actions", title="steps of tour", of=tour_actions, digits=0,
        says="actions of that tour; in no other figure but those with the tour",
    ),
    Metric(
        key="planner_calls", title="planner calls", of=planner_calls, only=plans, digits=1,
        says="answers asked of the planner",
    ),
    Metric(
        key="prompt_tokens", title="prompt tokens", of=prompt_tokens, only=plans, digits=0,
        says="tokens put to the planner",
    ),
    Metric(
        key="completion_tokens", title="answer tokens", of=completion_tokens, only=plans,
        digits=0, says="tokens that it answered",
    ),
    SECONDS,
    Metric(
        key="first_token_s", title="s to first token", of=first_token_s, digits=3,
        says="seconds before an answer of the planner begins",
    ),
    Metric(
        key="answer_s", title="s per answer", of=answer_s, digits=3,
        says="seconds of an answer of the planner",
    ),
    Metric(
        key="hosted_requests", title="requests", of=hosted_requests, only=is_hosted, digits=1,
        says="requests to hosted models of all roles",
    ),
    Metric(
        key="hosted_tokens", title="hosted tokens", of=hosted_tokens, only=is_hosted, digits=0,
        says="tokens of hosted models of all roles, both ways",
    ),
    Metric(
        key="cost", title="cost", of=cost, only=is_hosted, digits=COST_DIGITS,
        says="of hosted models of all roles, in the currency of the price table",
    ),
)  # fmt: skip


# ----------------------------------------------------------------- over several episodes


def measure(metric: Metric, episodes: Sequence[TimedEpisode]) -> Estimate:
    """Return a metric over episodes, with an interval that keeps the seeds of a task together."""
    if metric.only is not None and not any(metric.only(one.record) for one in episodes):
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
    """Return episodes to be measured; what an error kept from being tried is in them as missed.

    Tasks that nobody can be judged by are not among them.
    """
    timings, complete = timings or {}, _completed(records)
    tours = {row: _tours_of(complete, row) for row in dict.fromkeys(one.row for one in records)}
    return [
        TimedEpisode(record=one, timing=timings.get(one.key), tours=tours[one.row])
        for one in complete
        if not one.unjudged
    ]


def unjudged(records: Iterable[EpisodeRecord]) -> dict[str, str]:
    """Return the tasks that are in no figure, and why nobody can be judged by them."""
    return {one.task: one.unjudged for one in records if one.unjudged}


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
