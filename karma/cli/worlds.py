"""`karma world` and `karma tasks`: scenes, and tasks that measure nothing."""

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

from rich.markup import escape
from rich.table import Table

from karma.cli.parameters import argument, option
from karma.cli.shared import Json, console, tell, write_json
from karma.errors import KarmaError
from karma.files import below

if TYPE_CHECKING:
    from karma.bench.engine.run import Run
    from karma.bench.engine.task_check import TaskFinding

_NAMED = 5  # tasks in a warning
PICTURE_PX = 900  # sides of a picture of a room


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
    from karma.agent.seeing.picture_states import png
    from karma.files import write_atomic
    from karma.world.core import scene as scenes
    from karma.world.core.state import Settings, begin
    from karma.world.render.picture import camera_above, render

    one = scenes.load(scene)
    path = out or below(".", f"{one.name}.png", source=scene)
    state = begin(one, Settings())
    write_atomic(path, png(render(state, camera_above(state), PICTURE_PX, PICTURE_PX).rgb))
    console.print(escape(f"{path}: {one.name}, {one.room}, {len(one.objects)} objects"))


def tasks_check(
    file: Path = argument(..., "A task file, e.g. eval/alfred_l/tasks.jsonl."),
    world: str = option("embedded", "Name of the world."),
    json: Json = None,
) -> None:
    """Look for tasks that are done already or that name nothing; exit 1.

    A goal that is true beside others, or after other work, is only mentioned: it may be meant so.
    """
    from karma import registry
    from karma.bench.engine.task_check import findings
    from karma.goals.files import load_tasks, task_lines

    tasks, lines = load_tasks(file), task_lines(file)
    found: list[TaskFinding] = list(findings(tasks, registry.load("worlds", world)))
    for one in found:
        tell(f"{file}:{lines[one.task]}: {'' if one.serious else 'note: '}{one}")
    write_json(json, found)
    bad = [one for one in found if one.serious]
    if not bad:
        tell(f"{file}: {len(tasks)} tasks, nothing wrong")
        return
    counts = Counter(one.what for one in bad)
    said = ", ".join(f"{times} × {what}" for what, times in counts.items())
    raise KarmaError(
        f"{file}: {len({one.task for one in bad})} of {len(tasks)} tasks measure less than they "
        f"seem to: {said}\n  To fix: the lines above; docs/tasks.md says what goals mean"
    )


def warn_of_tasks(run: "Run") -> None:
    """Say before a run's first episode which of its tasks measure less than they seem to."""
    from karma import registry
    from karma.bench.engine.task_check import findings

    if run.records or not run.left:
        return
    try:
        found = list(findings(run.tasks, registry.load("worlds", run.experiment.world)))
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
