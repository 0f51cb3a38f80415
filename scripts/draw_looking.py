"""Draw the tasks that need looking; equal seeds give equal bytes.

    python scripts/draw_looking.py eval/looking

Twins are kept when the agent that is told the true states does both: what it cannot do says
nothing about pictures, and what it does by luck it does in one of the two. So its own success there
is 1 by construction. No reader of pictures has a say in what is kept, nor has the one that reads
nothing.
"""

import argparse
import tempfile
from pathlib import Path

from karma.bench.episode import run_episode
from karma.bench.experiment_file import read_experiment
from karma.contracts import Method, Task
from karma.files import to_json, write_atomic
from karma.loading.models import Models, load_resources
from karma.methods.karma import KarmaMethod
from karma.offline import go_offline
from karma.tasks.drawing.looking import Drawn, draw_twins
from karma.tasks.files import write_tasks
from karma.world.sim import EmbeddedWorld

EACH = {
    "dirty": 5, "filled": 4, "cooked": 3, "used up": 3, "opened": 3, "on": 3, "drawer": 3,
    "cabinet": 3, "burner": 3,
}  # pairs of twins: 60 tasks  # fmt: skip
EXPERIMENT = Path("eval/looking.toml")  # its first row is told the true states


def main() -> None:
    """Draw tasks of every kind, with a room each."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    told = told_the_truth()
    kept: list[Task] = []
    for kind, wanted in EACH.items():
        found = number = 0
        while found < wanted:
            twins = draw_twins(kind, number, arguments.seed, f"{arguments.folder}/rooms/{{}}.json")
            number += 1
            if twins and all(solved(told, twin) for twin in twins):
                kept += [twin.task for twin in twins]
                found += 1
            else:
                for twin in twins:
                    Path(twin.task.scene.path).unlink(missing_ok=True)
        print(f"{kind}: {found} pairs of {number} draws", flush=True)
    write_tasks(arguments.folder / "tasks.jsonl", kept)


def told_the_truth() -> Method:
    """Return the agent that is told the true states, as the experiment has it."""
    row = read_experiment(EXPERIMENT).rows[0]
    resources = load_resources(Models(vision="metadata"), maps=None, seed=0)
    return KarmaMethod.build(resources, row.all_options)


def solved(method: Method, twin: Drawn) -> bool:
    """Write a task's room and return whether the method does the task."""
    write_atomic(Path(twin.task.scene.path), to_json(twin.scene))
    with tempfile.TemporaryDirectory() as folder:
        record = run_episode(
            method, EmbeddedWorld(), twin.task, row="", seed=0, folder=Path(folder)
        )
    return not record.error and not any(sub.unmet for sub in record.subtasks)


if __name__ == "__main__":
    go_offline()
    main()
