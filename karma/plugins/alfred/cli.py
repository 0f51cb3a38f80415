"""`karma world replay` and `import-trials`: ALFRED's demonstrations."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from karma.cli.parameters import option
from karma.cli.progress import track
from karma.cli.shared import Json, console, tell, write_json
from karma.errors import KarmaError
from karma.files import below, to_json, write_atomic
from karma.journal.formats import percent_text

if TYPE_CHECKING:
    from karma.plugins.alfred.replay.facts import Files
    from karma.plugins.alfred.replay.replay import TrialResult
    from karma.plugins.alfred.replay.trial import Trial

_OR_NONE = 'default below $KARMA_SHARED or ../shared; "none" = without.'
Several = Annotated[list[Path], typer.Argument(help="Files, also gzipped.")]
Layouts = Annotated[str | None, typer.Option(help=f"ALFRED's reachable cells; {_OR_NONE}")]
Dumps = Annotated[str | None, typer.Option(help=f"AI2-THOR 5.0.0's rooms at reset; {_OR_NONE}")]
Fixed = Annotated[str | None, typer.Option(help=f"Fixed objects of ALFRED's rooms; {_OR_NONE}")]
Receptacles = Annotated[str | None, typer.Option(help=f"Their receptacles; {_OR_NONE}")]
Spots = Annotated[str | None, typer.Option(help=f"Labelled positions in them; {_OR_NONE}")]
Only = Annotated[list[str] | None, typer.Option(help="Ids of the trials to take.")]


def import_trials(
    files: Several,
    out: Path = option(Path("runs/scenes"), "Folder for the scene files."),
    layouts: Layouts = None,
    dumps: Dumps = None,
    fixed: Fixed = None,
    receptacles: Receptacles = None,
    spots: Spots = None,
    only: Only = None,
    json: Json = None,
) -> None:
    """Turn ALFRED's trials into scene files."""
    from karma.plugins.alfred.replay.facts import side_files

    side = side_files(
        layouts=layouts, dumps=dumps, fixed=fixed, receptacles=receptacles, spots=spots
    )
    rows = _import_trials(files, side, only, out)
    console.print(escape(f"{len(rows)} scenes in {out}"))
    write_json(json, rows)


def _import_trials(
    files: Sequence[Path], side: "Files", only: list[str] | None, out: Path
) -> list[dict[str, Any]]:
    from karma.plugins.alfred.replay.replay import fitted

    chosen, facts = _trials(files, only, side)
    rows = []
    for trial in track(chosen, "importing"):
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


def world_replay(
    files: Several,
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
    """Replay ALFRED's demonstrations and compare.

    The last line is the count: trials and how many were as recorded (with --mutate: how many of
    the mutilated ones were caught).
    """
    from karma.plugins.alfred.replay.facts import side_files

    side = side_files(
        layouts=layouts, dumps=dumps, fixed=fixed, receptacles=receptacles, spots=spots
    )
    from karma.plugins.alfred.replay.replay import replay_all
    from karma.plugins.alfred.replay.trial import read_ids

    wanted = [*(only or ()), *(read_ids(ids) if ids else ())]
    chosen, facts = _trials(files, wanted if only or ids else None, side, limit)
    results: list[TrialResult] = []
    replays = replay_all(chosen, facts, mutate=mutate, strict=strict, workers=workers)
    for result in track(replays, "replaying", len(chosen)):
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
