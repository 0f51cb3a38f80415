"""Measure what memory saves in tool mode, by a player that knows the goals and reads prompts.

    python scripts/measure_tools.py --limit 12

The player (`karma.plugins.training.tool_teacher`) is an upper bound: no language is understood.
Its own ablations differ in memory alone. Control: the same tasks without either memory.
"""

import tempfile
from collections import defaultdict
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import track

from karma.agent.karma import KarmaMethod, KarmaSettings
from karma.agent.planning.planner import Planner
from karma.bench.engine.episode import run_episode
from karma.files import shipped
from karma.goals.files import load_tasks
from karma.loading.models import Models, load_resources
from karma.models.scripted import MetadataVision
from karma.offline.guard import go_offline
from karma.plugins.training.tool_teacher import Lesson, ToolTeacher
from karma.world.sim import EmbeddedWorld

MEMORIES = {
    "both memories": {},
    "without short-term memory": {"short_term": False},
    "without long-term memory": {"long_term": False},
    "neither": {"long_term": False, "short_term": False},
}


def main(
    limit: Annotated[int, typer.Option(help="The first so many tasks of each kind.")] = 100,
) -> None:
    """Run the tasks with and without memory and print the costs."""
    go_offline()
    recall = load_resources(Models(), maps=None, seed=0).recall
    tasks = load_tasks(shipped("eval") / "alfred_l" / "tasks.jsonl")
    by_kind = defaultdict(list)
    for task in tasks:
        by_kind[task.kind].append(task)
    print(f"{'kind':12} {'memory':28} {'tasks':>5} {'solved':>6} {'places':>7} {'steps':>7}")
    with tempfile.TemporaryDirectory() as folder:
        for kind, some in by_kind.items():
            for name, options in MEMORIES.items():
                records = [
                    _record(task, options, recall, Path(folder))
                    for task in track(some[:limit], description=f"{kind}, {name}", transient=True)
                ]
                calls = [
                    call for record in records for sub in record.subtasks for call in sub.calls
                ]
                print(
                    f"{kind:12} {name:28} {len(records):5} {sum(r.success for r in records):6} "
                    f"{sum(c.explorations for c in calls):7} {sum(c.actions for c in calls):7}",
                    flush=True,
                )


def _record(task, options, recall, folder: Path):  # noqa: ANN001, ANN202
    lessons = [
        Lesson(kind=task.kind, text=sub.instruction, goals=sub.goals) for sub in task.subtasks
    ]
    player = ToolTeacher({lesson.text: lesson for lesson in lessons})
    method = KarmaMethod(
        Planner(player, "tools"), recall, MetadataVision(), KarmaSettings(**options), maps=folder
    )
    return run_episode(method, EmbeddedWorld(), task, row="x", seed=0, folder=folder)


if __name__ == "__main__":
    typer.run(main)
