"""What it saves to keep the states of rooms: a home of four rooms, forty instructions.

    python scripts/bench_rooms.py [--planner karma-nano] [--profile compact] [--task house-0-00]

The same sequence of ALFWorld-R is done four times: keeping the last room only, keeping rooms in
memory, with an empty folder for states, and once more with what is in it. Records must be equal.
A planner "random" babbles: a tiny Llama in its family's tokens, with a context that `full` fits.
"""

import argparse
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

from karma.bench.run import Run
from karma.journal.header import EPISODES
from karma.journal.records import AnswerTiming, read_records
from karma.journal.run_folder import read_run
from karma.offline import go_offline
from karma.testing import make_llama

TASKS = Path("eval/alfworld_r/tasks.jsonl")
WAYS = {  # what is done: its [run]
    "last room only": "states_memory_mb = 0",
    "rooms in memory": "",
    "and a folder, empty": 'states = "{folder}"',
    "and a folder, filled": 'states = "{folder}"',
}


def experiment(path: Path, options: argparse.Namespace, run: str) -> Path:
    """Write the experiment."""
    planner = options.planner
    if planner == "random":
        planner = str(path.parent / "random.gguf")
        shape = {"layers": 2, "width": 64, "heads": 4, "kv_heads": 2, "feed_forward": 128}
        make_llama(planner, **shape, vocabulary=1024, context=16_384)
    path.write_text(
        f'name = "rooms"\ntasks = "{TASKS.resolve()}"\nonly = ["{options.task}"]\n'
        '[[rows]]\nname = "KARMA"\noptions = { attempts = 1 }\n'
        f'[models]\nplanner = "{planner}"\nprofile = "{options.profile}"\n[run]\n{run}\n'
    )
    return path


def row(name: str, folder: Path) -> str:
    """Return a line of the table."""
    timings = read_run(folder).timings
    told: list[tuple[int, AnswerTiming]] = [
        (answer.prompt_tokens or 0, timing)
        for record in read_records(folder / EPISODES)
        for sub, times in zip(record.subtasks, timings[record.key].subtasks, strict=True)
        for answer, timing in zip(sub.answers, times.answers, strict=True)
    ]
    states = Counter(timing.state for _, timing in told)
    whole = sum(tokens for tokens, _ in told)
    run = whole - sum(timing.reused_tokens or 0 for _, timing in told)
    seconds = sum(timing.first_token_s or 0.0 for _, timing in told)
    cells = [name, len(told), states["evaluated"], states["loaded"], states["kept"], whole, run]
    return f"| {' | '.join(map(str, cells))} | {seconds:.1f} |"


def main() -> None:
    """Do all four."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--planner", default="karma-nano")
    parser.add_argument("--profile", default="compact")
    parser.add_argument("--task", default="house-0-00")
    options = parser.parse_args()
    print(
        "| kept | answers | rooms evaluated | loaded | kept | prompt tokens | of them run |"
        " s to first tokens |\n" + "|---" * 8 + "|"
    )
    said = set()
    with TemporaryDirectory() as folder:
        for number, (name, run) in enumerate(WAYS.items()):
            path = Path(folder) / f"{number}.toml"
            done = Path(folder) / str(number)
            states = Path(folder) / "states"
            list(
                Run(experiment(path, options, run.format(folder=states)), done).episodes(workers=1)
            )
            print(row(name, done), flush=True)
            said.add((done / EPISODES).read_bytes())
    print("records are equal" if len(said) == 1 else "RECORDS DIFFER")


if __name__ == "__main__":
    go_offline()
    main()
