"""The page of a run: its tables, its plots, who solved which task, and replayed episodes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec

from karma.bench.figures.compare import rows_of
from karma.bench.figures.failures import Failure
from karma.bench.figures.tables import Result, Sheet, main_sheets, sheets
from karma.bench.report.html import fill
from karma.bench.report.plots import plots_of
from karma.bench.report.replay import EpisodeReplay, episode_key
from karma.journal.formats import UNKNOWN, plural
from karma.journal.records import SAID, EpisodeRecord, Turn, read_turns
from karma.journal.run_folder import RunData

Facts = tuple[tuple[str, tuple[tuple[str, str], ...]], ...]  # groups of names and values
SHOWN_INSTRUCTIONS = 12  # of a task in the list


def render(run: RunData, result: Result, replays: Sequence[EpisodeReplay]) -> str:
    """Return the page of a run as HTML."""
    is_talk = all(record.kind == SAID for record in run.records)
    turns = read_turns(run.folder)
    first = main_sheets(result)
    anchors = {episode_key(shown.record): f"episode-{n}" for n, shown in enumerate(replays)}
    failed = next((shown for shown in replays if shown.first_failed is not None), None)
    actions = sum(shown.actions for shown in replays)
    return fill(
        "page.html.j2",
        title=run.header.name,
        size=_size(run.records),
        is_talk=is_talk,
        first_sheets=() if is_talk else first,
        other_sheets=() if is_talk else [*sheets(result)[len(first) :], *_failed(result.failures)],
        plots=() if is_talk else list(plots_of(result)),
        rows=rows_of(run.records),
        tasks=_tasks(run.records),
        anchors=anchors,
        key=episode_key,
        conversation=_conversation(turns) if turns else None,
        replays=replays,
        actions=actions,
        same=actions - sum(len(shown.differing) for shown in replays),
        failed=failed,
        facts=facts_of(run.header),
    )


def _size(records: Sequence[EpisodeRecord]) -> str:
    parts = (
        (len(records), "episode"),
        (len(rows_of(records)), "method"),
        (len({record.task for record in records}), "task"),
        (len({record.seed for record in records}), "seed"),
    )
    return ", ".join(plural(number, word) for number, word in parts)


def _failed(failures: Sequence[Failure]) -> Iterator[Sheet]:
    lines = tuple(
        (case.row, case.task, str(case.seed), case.instruction, case.cause, case.why)
        for case in failures
        if case.is_first
    )
    if lines:
        yield Sheet(
            title="First failure of each episode that failed",
            caption="Causes by the rules of docs/metrics.md.",
            head=("method", "task", "seed", "instruction", "cause", "why"),
            lines=lines,
        )


def _conversation(turns: Sequence[Turn]) -> Sheet:
    return Sheet(
        title="Conversation",
        caption="",
        head=("request", "status", "answer"),
        lines=tuple(
            (turn.said, turn.status, "\n".join(text for _, text in turn.lines)) for turn in turns
        ),
    )


# ----------------------------------------------------------------- who solved which task


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskCell:
    """Result of a method on a task; `shown` is the first failed episode, or the first episode."""

    text: str
    shown: EpisodeRecord | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskLine:
    """Results of all methods on a task."""

    task: str
    kind: str
    instructions: str
    unjudged: str  # why nobody can be judged by it
    cells: tuple[TaskCell, ...]  # in the order of the methods


def _tasks(records: Sequence[EpisodeRecord]) -> list[TaskLine]:
    """Return a line per task, in order of appearance."""
    by_task: dict[str, list[EpisodeRecord]] = {}
    for record in records:
        by_task.setdefault(record.task, []).append(record)
    rows = rows_of(records)
    return [_task(mine, rows) for mine in by_task.values()]


def _task(records: Sequence[EpisodeRecord], rows: Sequence[str]) -> TaskLine:
    longest = max(records, key=lambda record: len(record.subtasks))
    words = [sub.instruction for sub in longest.subtasks]
    shown = " ".join(words[:SHOWN_INSTRUCTIONS])
    more = len(words) > SHOWN_INSTRUCTIONS
    return TaskLine(
        task=longest.task,
        kind=longest.kind,
        instructions=f"{len(words)} instructions: {shown} …" if more else shown,
        unjudged=longest.unjudged,
        cells=tuple(_cell([record for record in records if record.row == row]) for row in rows),
    )


def _cell(records: Sequence[EpisodeRecord]) -> TaskCell:
    judged = [record for record in records if not record.unjudged]
    if not judged:
        return TaskCell(text=UNKNOWN)
    failed = [record for record in judged if not record.success]
    shown = next(iter(failed or judged))
    if len(judged) > 1:
        text = f"{len(judged) - len(failed)}/{len(judged)}"
    elif len(shown.subtasks) > SHOWN_INSTRUCTIONS:
        done = sum(sub.success for sub in shown.subtasks)
        text = f"{done} of {len(shown.subtasks)}"
    else:
        text = "✗" if failed else "✓"
    return TaskCell(text=text, shown=shown)


# ----------------------------------------------------------------- the run


def facts_of(run_header: Any) -> Facts:
    """Return the facts of a run's header: groups of names and values."""
    header: dict[str, Any] = msgspec.to_builtins(run_header)
    groups = {name: value for name, value in header.items() if isinstance(value, dict) and value}
    plain = {name: value for name, value in header.items() if not isinstance(value, dict)}
    return tuple(
        (group, tuple((name, _text(value)) for name, value in values.items()))
        for group, values in {"run": plain, **groups}.items()
    )


def _text(value: Any) -> str:
    if value is None:
        return UNKNOWN
    return ("no", "yes")[value] if isinstance(value, bool) else str(value)
