"""A run as one HTML page: everything inline, nothing fetched, all text escaped."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec

from karma.bench.causes import Cause, Failure, count
from karma.bench.run_folder import RunData
from karma.bench.tables import Result, Sheet, figure_text, sheets, size_words
from karma.report.episodes import EpisodeReplay, episode_key
from karma.report.frames import Frames
from karma.report.html import fill, script_data
from karma.report.plots import Plot, bar_plot, cause_plot, success_plot
from karma.report.results import Column, Line, columns, rates, result_lines
from karma.report.room import RoomPlan
from karma.report.tasks import TaskLine, rows_of, task_lines


@dataclass(frozen=True, slots=True, kw_only=True)
class Page:
    """What the template says."""

    title: str
    episodes: int
    seeds: int
    rows: tuple[str, ...]
    caption: str
    columns: tuple[Column, ...]
    lines: tuple[Line, ...]
    plots: tuple[Plot, ...]
    sheets: tuple[Sheet, ...]  # the tables that stand in papers
    failures: Mapping[tuple[str, str, int], Failure]  # the first of each failed episode
    tasks: tuple[TaskLine, ...]
    facts: tuple[tuple[str, tuple[tuple[str, str], ...]], ...]  # groups of names and values
    replays: Mapping[str, EpisodeReplay]
    rooms: tuple[RoomPlan, ...]
    actions: int  # that were done again
    same: int  # of those, as logged


def render(page: Page, frames: Frames) -> str:
    """Return the page as HTML.

    Args:
        page: what it says.
        frames: the pictures that the replays name by number.
    """
    return fill(
        "page.html.j2",
        columns=len(page.rows),
        letters=min(40, max(len(line.task) for line in page.tasks)),
        page=page,
        data=script_data([_told(one) for one in page.replays.values()]),
        frames=script_data(frames.uris()),
        figure=figure_text,
        key=episode_key,
    )


def _told(one: EpisodeReplay) -> dict[str, Any]:
    """Return one replay as the script reads it."""
    goals = [part.goals for part in one.record.subtasks]
    parts = [
        {
            **msgspec.to_builtins(part),
            "changes": part.changes,
            "goals": goals[number] if number < len(goals) else (),
        }
        for number, part in enumerate(one.story.parts)
    ]
    moments = []
    for number, (moment, sight) in enumerate(
        zip(one.story.moments, one.replay.sights, strict=True)
    ):
        told = {**msgspec.to_builtins(moment), **msgspec.to_builtins(sight)}
        del told["action"]
        moments.append(told | {"differs": number in one.replay.differing})
    return {
        "key": episode_key(one.record),
        "row": one.record.row,
        "task": one.record.task,
        "seed": one.record.seed,
        "success": one.record.success,
        "error": one.record.error,
        "trouble": one.trouble,
        "room": one.room.scene,
        "areas": msgspec.to_builtins(one.areas),
        "parts": parts,
        "moments": moments,
    }


# ----------------------------------------------------------------- from a run to a page


def page_of(run: RunData, result: Result, replays: Sequence[EpisodeReplay]) -> Page:
    """Return what the page of a run says.

    Args:
        run: the run.
        result: what the tables of it are made of.
        replays: the episodes that can be stepped through.
    """
    records = run.records
    actions = sum(one.replay.actions for one in replays)
    return Page(
        title=run.header.name,
        episodes=len(records),
        seeds=len({record.seed for record in records}),
        rows=rows_of(records),
        caption=_caption(result),
        columns=columns(result),
        lines=result_lines(result),
        plots=(
            success_plot(rates(result)),
            cause_plot(_causes(result, rows_of(records))),
            bar_plot("Places searched per episode", _over_all(result, "explorations")),
            bar_plot("World steps per episode", _over_all(result, "actions")),
            bar_plot("Planner calls per episode", _over_all(result, "planner_calls")),
        ),
        sheets=tuple(sheets(result)),
        failures={(one.row, one.task, one.seed): one for one in result.failures if one.is_first},
        tasks=task_lines(records),
        facts=tuple(_facts(run)),
        replays={episode_key(one.record): one for one in replays},
        rooms=tuple({one.room.scene: one.room for one in replays}.values()),
        actions=actions,
        same=actions - sum(len(one.replay.differing) for one in replays),
    )


def _causes(result: Result, rows: Sequence[str]) -> dict[str, Mapping[Cause, int]]:
    return {
        row: count((one for one in result.failures if one.row == row), first_only=True)
        for row in rows
    }


def _over_all(result: Result, key: str) -> list[tuple[str, float | None]]:
    return [(line.row, line.values[key].value) for line in result.figures if line.kind == "all"]


def _caption(result: Result) -> str:
    lines = [line for line in result.figures if line.kind == "all"]
    return (
        f"{size_words(lines)}. SR: tasks of which every goal of every instruction held when that "
        "instruction ended; an episode that broke off counts. Small figures: 95 % intervals that "
        "keep the seeds of a task together. Amounts are means per episode."
    )


def _facts(run: RunData) -> Iterator[tuple[str, tuple[tuple[str, str], ...]]]:
    """Yield what the run depends on: groups of names and values."""
    header: dict[str, Any] = msgspec.to_builtins(run.header)
    groups = {name: value for name, value in header.items() if isinstance(value, dict)}
    yield "run", tuple((n, _plain(value)) for n, value in header.items() if n not in groups)
    for group, facts in groups.items():
        if facts:
            yield group, tuple((name, _plain(value)) for name, value in facts.items())


def _plain(value: Any) -> str:
    if value is None:
        return "–"
    return ("no", "yes")[value] if isinstance(value, bool) else str(value)
