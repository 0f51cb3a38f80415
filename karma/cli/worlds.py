"""`karma world` and `karma tasks`: rooms, recorded episodes, and what is to be done there."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from statistics import mean
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import msgspec
import typer
from rich.markup import escape
from rich.table import Table

from karma.agent.journal.formats import figure_text, percent_text
from karma.cli.progress import bar
from karma.cli.shared import Json, argument, console, option, tell, write_json
from karma.errors import FileError, KarmaError
from karma.files import below, to_json, write_atomic

if TYPE_CHECKING:
    from karma.bench.engine.run import Run
    from karma.bench.engine.task_check import TaskFinding
    from karma.plugins.alfred.replay.facts import Files
    from karma.plugins.alfred.replay.replay import TrialResult
    from karma.plugins.alfred.replay.trial import Trial

T = TypeVar("T")
_NAMED = 5  # tasks in a warning
_OR_NONE = 'default below $KARMA_SHARED or ../shared; "none" = without.'
Several = Annotated[list[Path], typer.Argument(help="Files, also gzipped.")]
Layouts = Annotated[str | None, typer.Option(help=f"ALFRED's reachable cells; {_OR_NONE}")]
Dumps = Annotated[str | None, typer.Option(help=f"AI2-THOR 5.0.0's rooms at reset; {_OR_NONE}")]
Fixed = Annotated[str | None, typer.Option(help=f"Fixed objects of ALFRED's rooms; {_OR_NONE}")]
Receptacles = Annotated[str | None, typer.Option(help=f"Their receptacles; {_OR_NONE}")]
Spots = Annotated[str | None, typer.Option(help=f"Labelled positions in them; {_OR_NONE}")]
Assets = Annotated[Path | None, typer.Option(help="Boxes of ProcTHOR's assets, for houses.")]
Only = Annotated[list[str] | None, typer.Option(help="Names to take: FloorPlan1, or a trial's id.")]


def world_list(json: Json = None) -> None:
    """List the scenes that ship with the project."""
    from karma.world.core import scene

    table = Table("scene", "room", "objects", "cells", "source")
    rows = []
    for path in sorted(scene.SCENES.glob("*.json")):
        one = scene.load(path)
        row = {"scene": one.name, "room": one.room, "objects": len(one.objects)}
        rows.append({**row, "cells": len(one.reachable), "source": one.source})
        table.add_row(*map(str, rows[-1].values()))
    console.print(table)
    write_json(json, rows)


def world_show(
    scene: str = argument(..., "A scene's name or file."),
    out: Path | None = option(None, "PNG to write; default NAME.png."),
) -> None:
    """Draw a room from above."""
    from karma.world.core import scene as scenes
    from karma.world.render.top_down import draw_top_down

    one = scenes.load(scene)
    path = out or below(".", f"{one.name}.png", source=scene)
    draw_top_down(one, path)
    console.print(escape(f"{path}: {one.name}, {one.room}, {len(one.objects)} objects"))


def world_import(
    files: Several,
    alfred: bool = option(False, "FILES are ALFRED's trials.", "--alfred"),
    out: Path = option(Path("runs/scenes"), "Folder for the scene files."),
    layouts: Layouts = None,
    dumps: Dumps = None,
    fixed: Fixed = None,
    receptacles: Receptacles = None,
    spots: Spots = None,
    assets: Assets = None,
    only: Only = None,
    json: Json = None,
) -> None:
    """Turn AI2-THOR metadata dumps, or with --alfred ALFRED's trials, into scene files.

    Cells for dumps are computed from the boxes unless --layouts is given. A file of ProcTHOR's
    houses is known by its keys; things have their type's usual size unless --assets is given.
    """
    if alfred:
        from karma.plugins.alfred.replay.facts import side_files

        side = side_files(
            layouts=layouts, dumps=dumps, fixed=fixed, receptacles=receptacles, spots=spots
        )
        rows = _import_trials(files, side, only, out)
    else:
        rows = [row for path in files for row in _import_dump(path, layouts, assets, only, out)]
    console.print(escape(f"{len(rows)} scenes in {out}"))
    write_json(json, rows)


def world_floors(
    dump: Path = argument(..., "AI2-THOR's rooms at reset, also gzipped."),
    layouts: Path = option(..., "ALFRED's reachable cells."),
    json: Json = None,
) -> None:
    """Hold the floor that importing works out from boxes against recorded cells."""
    from karma.plugins.thor_tools.importing.scenes import floor_scores

    scores = list(_shown(floor_scores(dump, layouts), "rooms"))
    table = Table("scene", "computed", "recorded", "both", "precision", "recall")
    for one in scores:
        shares = (figure_text(one.precision), figure_text(one.recall))
        table.add_row(one.scene, *map(str, (one.computed, one.recorded, one.both)), *shares)
    console.print(table)
    if not scores:
        raise FileError(dump, f"no room has cells in {layouts}", fix="give it other layouts")
    precision, recall = (mean(getattr(one, n) for one in scores) for n in ("precision", "recall"))
    worst = min(scores, key=lambda one: one.precision * one.recall)
    console.print(
        f"{len(scores)} rooms: precision {precision:.3f}, recall {recall:.3f}; worst: {worst.scene}"
        f" ({worst.precision:.2f}, {worst.recall:.2f})"
    )
    write_json(json, scores)


def _import_dump(
    dump: Path, layouts: str | None, assets: Path | None, only: list[str] | None, out: Path
) -> list[dict[str, Any]]:
    from karma.plugins.thor_tools.importing.procthor import holds_houses, import_houses
    from karma.plugins.thor_tools.importing.scenes import import_dump

    rows = []
    if houses := holds_houses(dump):
        scenes = import_houses(dump, assets=assets, only=only)
    else:
        scenes = import_dump(dump, layouts=None if layouts == "none" else layouts, only=only)
    for scene in _shown(scenes, f"importing {dump.name}"):
        path = below(out, f"{scene.name}.json", source=dump)
        write_atomic(path, to_json(scene))
        row = {"scene": scene.name, "objects": len(scene.objects), "path": str(path)}
        rows.append({**row, "source": scene.source})
        if "cells added" in scene.source or (houses and "; " in scene.source):
            console.print(escape(f"{scene.name}: {scene.source.partition('; ')[2]}"))
    return rows


def _import_trials(
    files: Sequence[Path], side: "Files", only: list[str] | None, out: Path
) -> list[dict[str, Any]]:
    from karma.plugins.alfred.replay.replay import fitted

    chosen, facts = _trials(files, only, side)
    rows = []
    for trial in _shown(chosen, "importing"):
        scene = fitted(trial, facts[trial.scene.floor_plan])
        path = below(out, f"{trial.id}.json")
        write_atomic(path, to_json(scene))
        row = {"scene": scene.name, "trial": trial.id, "objects": len(scene.objects)}
        rows.append({**row, "cells": len(scene.reachable), "path": str(path)})
    return rows


def _trials(
    files: Sequence[Path], ids: Iterable[str] | None, side: "Files", limit: int | None = None
) -> "tuple[list[Trial], Any]":
    """Return the trials of these ids, or all, and their rooms' facts; KarmaError for no such id."""
    from karma.plugins.alfred.replay.facts import gather
    from karma.plugins.alfred.replay.trial import read_trials

    trials = [trial for path in files for trial in read_trials(path)]
    wanted = {trial.id for trial in trials} if ids is None else set(ids)
    if missing := sorted(wanted - {trial.id for trial in trials}):
        more = f", nor {len(missing) - 1} more" * (len(missing) > 1)
        raise KarmaError(
            f"no trial {missing[0]!r} in the files given{more}\n"
            f"  To fix: leave --only or --ids out, or take e.g. {trials[0].id}"
        )
    chosen = [trial for trial in trials if trial.id in wanted][:limit]
    plans = {trial.scene.floor_plan for trial in chosen}
    return chosen, gather((one for one in trials if one.scene.floor_plan in plans), side)


def _shown(items: Iterable[T], text: str, total: int | None = None) -> Iterator[T]:
    """Return the items, with a bar on a terminal while they are taken."""
    with bar(passing=True) as progress:
        yield from progress.track(items, total=total, description=escape(text))


# ----------------------------------------------------------------- replay


def world_replay(
    files: Several,
    events: bool = option(False, "FILES are recorded sessions.", "--events"),
    layouts: Layouts = None,
    dumps: Dumps = None,
    fixed: Fixed = None,
    receptacles: Receptacles = None,
    spots: Spots = None,
    ids: Path | None = option(None, "JSON: replay these trials only."),
    only: Only = None,
    mutate: int | None = option(None, "Seed: leave out one action of each trial.", min=0),
    strict: bool = option(False, "What boxes hide from view is not handled.", "--strict"),
    limit: int | None = option(None, "Replay the first N only.", min=1),
    workers: int = option(1, "Processes.", min=1),
    json: Json = None,
) -> None:
    """Replay ALFRED's demonstrations, or with --events sessions of AI2-THOR, and compare.

    The last line is the count: trials and how many were as recorded (with --mutate: how many of
    the mutilated ones were caught), or recordings, compared flags, and the share that is equal.
    """
    from karma.plugins.alfred.replay.facts import side_files

    side = side_files(
        layouts=layouts, dumps=dumps, fixed=fixed, receptacles=receptacles, spots=spots
    )
    if events:
        _replay_events(files, side.layouts, json)
        return
    from karma.plugins.alfred.replay.replay import replay_all
    from karma.plugins.alfred.replay.trial import read_ids

    wanted = [*(only or ()), *(read_ids(ids) if ids else ())]
    chosen, facts = _trials(files, wanted if only or ids else None, side, limit)
    results: list[TrialResult] = []
    replays = replay_all(chosen, facts, mutate=mutate, strict=strict, workers=workers)
    for result in _shown(replays, "replaying", len(chosen)):
        results.append(result)
        if result.ok == (mutate is not None):
            tell(_trial_line(result))
    ok = sum(result.ok for result in results)
    handled, unseen = sum(r.handled for r in results), sum(r.unseen for r in results)
    good = {"ok": ok} if mutate is None else {"caught": len(results) - ok, "seed": mutate}
    figures = {"trials": len(results), **good, "handled": handled, "unseen": unseen}
    write_json(json, {**figures, "results": results})
    if mutate is None:
        share = f" ({percent_text((handled - unseen) / handled, 1)} %)" if handled else ""
        tell(f"actions on objects {handled}, in view {handled - unseen}{share}")
        tell(f"trials {len(results)}, ok {ok}")
    else:
        tell(f"trials {len(results)}, caught {len(results) - ok}")


def _trial_line(result: "TrialResult") -> str:
    where = f"{result.id} {result.scene}"
    if result.ok:
        return f"{where}: not caught without action {result.deleted}"
    at = "" if result.step is None else f" action {result.step}"
    return f"{where}{at}: {result.reason}"


def _replay_events(files: Sequence[Path], layouts: Path | None, json: Path | None) -> None:
    from karma.plugins.thor_tools.recorded import replay_events, total_rate

    reports = [
        replay_events(path, layouts=layouts) for path in _shown(files, "replaying", len(files))
    ]
    table = Table("recording", "steps", "compared", "equal", "%", "visible %", "changed %")
    table.columns[0].overflow = "fold"
    for one in reports:
        table.add_row(
            escape(Path(one.path).name), str(one.steps), str(one.compared),
            str(one.equal), _percent(one.rate), _percent(one.seen.rate),
            _percent(one.changes.rate),
        )  # fmt: skip
        for gap in one.differences:
            what = f"step {gap.step} {gap.action}: {gap.object_id or 'agent'} {gap.field}"
            cause = f" ({gap.cause})" if gap.cause else ""
            said = f"{gap.ours!r}, AI2-THOR {gap.theirs!r}{cause}"
            tell(f"{Path(one.path).name} {what} is {said}")
    console.print(table)
    whole = (
        {"rate": one.rate, "causes": one.causes, **msgspec.to_builtins(one)} for one in reports
    )
    write_json(json, list(whole))
    flags = sum(one.compared for one in reports)
    tell(f"events {len(reports)}, flags {flags}, equal {_percent(total_rate(reports))} %")


def _percent(share: float | None) -> str:
    """Return a share in percent, rounded down, so that only all is 100."""
    return figure_text(None if share is None else int(share * 10_000) / 100)


# ----------------------------------------------------------------- task files


def tasks_check(
    file: Path = argument(..., "A task file, e.g. eval/alfred_l/tasks.jsonl."),
    quick: bool = option(False, "Only what the rooms tell; the expert does not try.", "--quick"),
    world: str = option("embedded", "Name of the world."),
    json: Json = None,
) -> None:
    """Look for tasks that are done already, that name nothing, or that nobody can do; exit 1.

    A goal that is true beside others, or after other work, is only mentioned: it may be meant so.
    """
    from tempfile import TemporaryDirectory

    from karma import registry
    from karma.agent.goals.files import load_tasks, task_lines
    from karma.bench.engine.task_check import findings, quick_findings

    tasks, make = load_tasks(file), registry.load("worlds", world)
    lines = task_lines(file)
    found: list[TaskFinding] = []
    with TemporaryDirectory() as folder, bar(passing=True) as progress:
        for task in progress.track(tasks, description="tasks"):
            found += quick_findings([task], make) if quick else findings(task, make, Path(folder))
    for one in found:
        tell(f"{file}:{lines[one.task]}: {'' if one.serious else 'note: '}{one}")
    write_json(json, found)
    _end_tasks(file, len(tasks), found, quick)


def _end_tasks(file: Path, number: int, found: Sequence["TaskFinding"], quick: bool) -> None:
    bad = [one for one in found if one.serious]
    if not bad:
        how = "the expert did not try" if quick else "the expert solves all"
        tell(f"{file}: {number} tasks, nothing wrong ({how})")
        return
    counts = Counter(one.what for one in bad)
    said = ", ".join(f"{times} × {what}" for what, times in counts.items())
    tasks = len({one.task for one in bad})
    raise KarmaError(
        f"{file}: {tasks} of {number} tasks measure less than they seem to: {said}\n"
        "  To fix: the lines above; docs/tasks.md says what goals mean"
    )


def warn_of_tasks(run: "Run", told: set[tuple[str, ...]] | None = None) -> None:
    """Say before a run's first episode which of its tasks measure less than they seem to.

    It is silent about a run that has begun, and about tasks in `told`, which takes these.
    """
    from karma import registry
    from karma.bench.engine.task_check import quick_findings

    if run.records or not run.left:
        return
    if told is not None:
        these = (run.experiment.world, *(task.id for task in run.tasks))
        if these in told:
            return
        told.add(these)
    try:
        found = list(quick_findings(run.tasks, registry.load("worlds", run.experiment.world)))
    except KarmaError:  # the episodes will say it of each task
        return
    ids: dict[str, list[str]] = {}
    for one in found:
        if one.serious and one.task not in ids.setdefault(one.what, []):
            ids[one.what].append(one.task)
    for what, tasks in ids.items():
        said = ", ".join(tasks[:_NAMED]) + (" ..." if len(tasks) > _NAMED else "")
        tell(f"tasks: {what}: {len(tasks)} of {len(run.tasks)}: {said}", style="yellow")
    if ids and run.experiment.tasks:
        tell(f"  more: karma tasks check {run.experiment.tasks}")
