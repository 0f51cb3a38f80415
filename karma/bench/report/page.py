"""A run as one HTML page: everything inline, nothing fetched, all text escaped."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec

from karma.agent.journal.formats import UNKNOWN, figure_text
from karma.agent.journal.records import SAID, Turn, read_turns
from karma.agent.journal.run_folder import RunData
from karma.bench.figures.columns import COLUMNS
from karma.bench.figures.compare import rows_of
from karma.bench.figures.failures import Failure
from karma.bench.figures.metrics import Metric
from karma.bench.figures.tables import Result, Sheet, sheets, size_words
from karma.bench.report.episodes import EpisodeReplay
from karma.bench.report.html import Frames, fill, script_data
from karma.bench.report.results import (
    Plot,
    ResultLine,
    TaskLine,
    bar_plot,
    cause_plot,
    columns,
    episode_key,
    result_lines,
    success_plot,
    task_lines,
)
from karma.bench.report.room import RoomPlan
from karma.bench.report.story import endings

_OF_PLANS = ("recalled", "prompt", "program", "error", "refused")  # fields that the script reads


@dataclass(frozen=True, slots=True, kw_only=True)
class Page:
    """What the template says."""

    title: str
    episodes: int
    seeds: int
    rows: tuple[str, ...]
    caption: str
    columns: tuple[Metric, ...]
    lines: tuple[ResultLine, ...]
    plots: tuple[Plot, ...]
    sheets: tuple[Sheet, ...]  # the tables that stand in papers
    failures: Mapping[tuple[str, str, int], Failure]  # the first of each failed episode
    tasks: tuple[TaskLine, ...]
    has_long: bool  # whether a task has too many instructions to tell them all
    facts: tuple[tuple[str, tuple[tuple[str, str], ...]], ...]  # groups of names and values
    replays: Mapping[str, EpisodeReplay]
    rooms: tuple[RoomPlan, ...]
    cut: tuple[EpisodeReplay, ...]  # of which not all instructions can be stepped through
    actions: int  # that were done again
    same: int  # of those, as logged
    first_task: str  # the first that failed, in the page's order; "" if none did
    first: EpisodeReplay | None  # the first episode that failed and can be stepped through
    is_talk: bool  # which nobody judges
    turns: tuple[Turn, ...]  # of a conversation


def render(page: Page, frames: Frames) -> str:
    """Return the page as HTML."""
    return fill(
        "page.html.j2",
        columns=len(page.rows),
        letters=min(40, max(len(line.task) for line in page.tasks)),
        page=page,
        data=script_data([_replay_data(one, page.turns) for one in page.replays.values()]),
        frames=script_data(frames.uris()),
        figure=figure_text,
        key=episode_key,
    )


def _replay_data(one: EpisodeReplay, turns: Sequence[Turn]) -> dict[str, Any]:
    """Return one replay as the script reads it."""
    done = {turn.instruction for turn in turns if turn.status == "done"} if turns else None
    steps = one.steps
    differing = frozenset(one.replay.differing)
    maps = list(dict.fromkeys(part.map_text for part in one.story.parts))
    moments = []
    for number in steps:
        told = msgspec.to_builtins(one.story.moments[number])
        told |= msgspec.to_builtins(one.replay.sights[number])
        del told["action"]
        moments.append(told | {"differs": number in differing})
    return {
        "key": episode_key(one.record),
        "row": one.record.row,
        "task": one.record.task,
        "seed": one.record.seed,
        "success": None if one.record.unjudged else one.record.success,
        "error": one.record.error,
        "trouble": one.trouble,
        "opens_at": one.opens_at,
        "failed": msgspec.to_builtins(one.failed),
        "room": one.story.scene,
        "areas": {name: msgspec.to_builtins(room.areas) for name, room in one.rooms.items()},
        "maps": maps,
        "parts": [_told_part(one, number, maps, done) for number in range(len(one.story.parts))],
        "moments": columns_of(moments),
    }


def columns_of(rows: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, list[Any]]]:
    """Return rows as columns: each different value once, and for each row which it has.

    >>> columns_of([{"ok": True}, {"ok": False}, {"ok": True}])
    {'ok': {'values': [True, False], 'at': [0, 1, 0]}}
    """
    packed: dict[str, dict[str, list[Any]]] = {}
    for name in rows[0] if rows else ():
        values: dict[str, Any] = {repr(row[name]): row[name] for row in rows}
        number = {text: n for n, text in enumerate(values)}
        at = [number[repr(row[name])] for row in rows]
        packed[name] = {"values": list(values.values()), "at": at}
    return packed


def _told_part(
    one: EpisodeReplay, number: int, maps: list[str], done: Collection[int | None] | None
) -> dict[str, Any]:
    """Return one instruction as the script reads it; in few words where it is not shown.

    `done`: those of a conversation that were; None where goals are judged.
    """
    part = one.story.parts[number]
    said = {
        "instruction": part.instruction,
        "scene": part.scene,
        "met": number in done if done is not None else part.after is not None and not part.unmet,
        "shown": number in one.shown,
    }
    if number not in one.shown:
        return said
    records = one.record.subtasks
    goals = records[number].goals if number < len(records) else ()
    if not goals and number < len(one.goals):
        goals = one.goals[number]
    return {
        **msgspec.to_builtins(part),
        **said,
        "map_text": maps.index(part.map_text),
        "plans": [{key: getattr(plan, key) for key in _OF_PLANS} for plan in part.plans],
        "changes": part.changes,
        "goals": goals,
        "endings": endings(part),
    }


# ----------------------------------------------------------------- from a run to a page


def page_of(run: RunData, result: Result, replays: Sequence[EpisodeReplay]) -> Page:
    """Return what the page of a run says."""
    records = run.records
    lines = task_lines(records)
    actions = sum(one.replay.actions for one in replays)
    by_key = {episode_key(one.record): one for one in replays}
    failed = [
        cell.shown
        for line in lines
        for cell in line.cells
        if cell.shown is not None and not cell.shown.success
    ]
    to_step = (by_key[episode_key(one)] for one in failed if episode_key(one) in by_key)
    return Page(
        title=run.header.name,
        episodes=len(records),
        seeds=len({record.seed for record in records}),
        rows=rows_of(records),
        caption=_caption(result),
        columns=columns(result.figures),
        lines=result_lines(result.figures),
        plots=(
            success_plot(result.figures),
            cause_plot(rows_of(records), result.failures),
            bar_plot("Places searched per episode", _over_all(result, "explorations")),
            bar_plot("World steps per episode", _over_all(result, "actions")),
            _last_plot(result),
        ),
        sheets=tuple(sheets(result)),
        failures={(one.row, one.task, one.seed): one for one in result.failures if one.is_first},
        tasks=lines,
        has_long=any(line.is_long for line in lines),
        facts=tuple(facts_of(run.header)),
        replays=by_key,
        rooms=tuple({name: room for one in replays for name, room in one.rooms.items()}.values()),
        cut=tuple(one for one in replays if len(one.shown) < len(one.story.parts)),
        actions=actions,
        same=actions - sum(len(one.replay.differing) for one in replays),
        first_task=failed[0].task if failed else "",
        first=next(to_step, None),
        is_talk=all(record.kind == SAID for record in records),
        turns=read_turns(run.folder),
    )


def _last_plot(result: Result) -> Plot:
    """Return what tells memories apart in sequences, and else what answers were asked for."""
    if all(line.kind in ("sequence", "all") for line in result.figures):
        hits = _over_all(result, "hits_later")
        percent = [(row, None if share is None else 100 * share) for row, share in hits]
        return bar_plot("Memory hits, % (MHR steady)", percent)
    return bar_plot("Planner calls per episode", _over_all(result, "planner_calls"))


def _over_all(result: Result, key: str) -> list[tuple[str, float | None]]:
    return [(line.row, line.values[key].value) for line in result.figures if line.kind == "all"]


def _caption(result: Result) -> str:
    lines = [line for line in result.figures if line.kind == "all"]
    return (
        f"{size_words(lines)}. SR: {COLUMNS['success'].says}; an episode that broke off counts. "
        "Small figures: 95 % intervals that "
        "keep the seeds of a task together. Amounts are means per episode."
    )


def facts_of(run_header: Any) -> Iterator[tuple[str, tuple[tuple[str, str], ...]]]:
    """Yield what the run depends on: groups of names and values."""
    header: dict[str, Any] = msgspec.to_builtins(run_header)
    groups = {name: value for name, value in header.items() if isinstance(value, dict)}
    yield "run", tuple((n, _cell_text(value)) for n, value in header.items() if n not in groups)
    for group, facts in groups.items():
        if facts:
            yield group, tuple((name, _cell_text(value)) for name, value in facts.items())


def _cell_text(value: Any) -> str:
    if value is None:
        return UNKNOWN
    return ("no", "yes")[value] if isinstance(value, bool) else str(value)
