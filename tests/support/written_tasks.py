"""Task files as tests write them."""

from pathlib import Path

from karma.files import to_json


def write_tasks(path, tasks):
    """Write tasks as `load_tasks` reads them."""
    Path(path).write_bytes(b"".join(to_json(_row(task)) for task in tasks))


def _row(task):
    subtasks = [
        {"instruction": sub.instruction,
         "goals": [str(goal).removesuffix(": 1") for goal in sub.goals],
         "scene": "" if sub.scene in (None, task.scene) else sub.scene.source}
        for sub in task.subtasks
    ]  # fmt: skip
    return {"id": task.id, "kind": task.kind, "scene": task.scene.source, "subtasks": subtasks}
