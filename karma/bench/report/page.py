"""The page of a run: its tables, its plots and replayed episodes."""

from collections.abc import Iterator, Sequence
from typing import Any

import msgspec

from karma.agent.planning.refused import sentence
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
        anchors=anchors,
        key=episode_key,
        conversation=_conversation(turns) if turns else None,
        replays=replays,
        actions=actions,
        same=actions - sum(len(shown.differing) for shown in replays),
        failed=failed,
        sentence=sentence,
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
