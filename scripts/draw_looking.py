"""Draw the tasks that need looking; equal seeds give equal bytes.

    python scripts/draw_looking.py eval/looking

A task is kept when the agent that is told the true states does it: one that it cannot do says
nothing about pictures. So its own success there is 1 by construction. No reader of pictures has a
say in what is kept, nor has the one that reads nothing.
"""

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path

from karma.bench.episode import run_episode
from karma.bench.experiment import Models, load_resources, read_experiment
from karma.contracts import Method, Task
from karma.files import to_json, write_atomic
from karma.methods.karma import KarmaMethod
from karma.offline import go_offline
from karma.tasks.drawing.looking import Drawn, draw_looking
from karma.tasks.files import write_tasks
from karma.world.sim import EmbeddedWorld

EACH = {
    "dirty": 10, "filled": 8, "cooked": 6, "used up": 6, "opened": 6, "on": 6, "drawer": 6,
    "cabinet": 6, "burner": 6,
}  # 60 tasks  # fmt: skip
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
    kept = []
    for kind, wanted in EACH.items():
        found = tried = 0
        for one in drawn(kind, arguments.seed, arguments.folder):
            tried += 1
            place = arguments.folder / "rooms" / f"{one.scene.name}.json"
            write_atomic(place, to_json(one.scene))
            if solved(told, one.task):
                kept.append(one.task)
                found += 1
            else:
                place.unlink()
            if found == wanted:
                break
        print(f"{kind}: {found} tasks of {tried} that were drawn", flush=True)
    write_tasks(arguments.folder / "tasks.jsonl", kept)


def drawn(kind: str, seed: int, folder: Path) -> Iterator[Drawn]:
    """Yield the draws of one kind that came to something, without end."""
    number = 0
    while True:
        one = draw_looking(kind, number, seed, f"{folder}/rooms/{{}}.json")
        number += 1
        if one is not None:
            yield one


def told_the_truth() -> Method:
    """Return the agent that is told the true states, as the experiment has it."""
    row = read_experiment(EXPERIMENT).rows[0]
    resources = load_resources(Models(vision="metadata"), maps=None, seed=0)
    return KarmaMethod.build(resources, row.all_options)


def solved(method: Method, task: Task) -> bool:
    """Return whether the method does a task."""
    with tempfile.TemporaryDirectory() as folder:
        record = run_episode(method, EmbeddedWorld(), task, row="", seed=0, folder=Path(folder))
    return not record.error and not any(sub.unmet for sub in record.subtasks)


if __name__ == "__main__":
    go_offline()
    main()
