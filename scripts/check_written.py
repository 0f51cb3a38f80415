"""Play the written sentences: the expert does what each is said to mean, in the first room it can.

    python scripts/check_written.py               # play each in the room that it names
    python scripts/check_written.py --place       # look for that room again, and write it down

`eval/requests/written.jsonl` teaches the planner and gives a real model its examples; what it says
must be so. What no room of ours holds is named by its id, and is to be taken out.
"""

import argparse
import tempfile
from pathlib import Path

import msgspec
from rich.progress import track

from karma import registry
from karma.bench.episode import run_episode
from karma.errors import KarmaError
from karma.files import to_json, write_atomic
from karma.methods.expert import ExpertMethod
from karma.tasks.files import load_tasks
from karma.tasks.requests import SaidRequest, load_said

WRITTEN = Path("eval/requests/written.jsonl")
ROOMS = tuple(
    f"{sort}_{n}" for sort in ("kitchen", "living", "bedroom", "bathroom") for n in range(1, 5)
)


def main() -> None:
    """Play every sentence, and say which could not be done."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--place", action="store_true", help="choose rooms again")
    parser.add_argument("--file", type=Path, default=WRITTEN)
    given = parser.parse_args()
    placed, lost = [], []
    for said in track(load_said(given.file), "playing"):
        rooms = ROOMS if given.place else (said.scene,)
        room = next((room for room in rooms if not said.goals or is_done(said, room)), None)
        if room is None:
            lost.append(said)
        placed.append(msgspec.structs.replace(said, scene=room or said.scene))
    if given.place:
        write_atomic(given.file, b"".join(map(to_json, placed)))
    for said in lost:
        print(f"{said.id}: not done: {said.text!r} {', '.join(said.goals)}")
    print(f"{len(placed) - len(lost)} of {len(placed)} are as written")


def is_done(said: SaidRequest, room: str) -> bool:
    """Return whether the expert does it in a room."""
    line = {
        "id": said.id,
        "kind": "simple",
        "scene": room,
        "subtasks": [{"instruction": said.text, "goals": said.goals}],
    }
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "task.jsonl"
        write_atomic(path, to_json(line))
        try:
            (task,) = load_tasks(path)
        except KarmaError:
            return False
        world = registry.load("worlds", "embedded")()
        record = run_episode(ExpertMethod(), world, task, row="expert", seed=0, folder=Path(folder))
    return not record.error and not any(sub.unmet for sub in record.subtasks)


if __name__ == "__main__":
    main()
