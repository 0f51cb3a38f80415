"""What it saves to keep the states of rooms: a home of four rooms, forty instructions.

    python scripts/bench_rooms.py [--planner karma-nano] [--profile compact] [--task house-0-00]

The same sequence of ALFWorld-R is done four times: keeping the last room only (the reference),
keeping rooms in memory, with an empty folder for states, and once more with what is in it. Records
must be equal. A planner "random" babbles: a tiny Llama, with a context that `full` fits.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import typer
from measuring import table

from karma.agent.journal.header import EPISODES
from karma.agent.journal.run_folder import read_run
from karma.bench.engine.run import Run
from karma.offline.guard import go_offline
from karma.testing import make_llama

TASKS = Path("eval/alfworld_r/tasks.jsonl")
WAYS = {  # what is done: its [run]
    "last room only": "states_memory_mb = 0",
    "rooms in memory": "",
    "and a folder, empty": 'states = "{folder}"',
    "and a folder, filled": 'states = "{folder}"',
}


def row(folder: Path) -> list[float]:
    """Return answers, rooms evaluated, loaded, kept, tokens of prompts, of them run, seconds."""
    run = read_run(folder)
    told = [
        (answer.prompt_tokens or 0, timing)
        for record in run.records
        for sub, times in zip(record.subtasks, run.timings[record.key].subtasks, strict=True)
        for answer, timing in zip(sub.answers, times.answers, strict=True)
    ]
    states = Counter(timing.state for _, timing in told)
    whole = sum(tokens for tokens, _ in told)
    reused = sum(timing.reused_tokens or 0 for _, timing in told)
    seconds = sum(timing.first_token_s or 0.0 for _, timing in told)
    rooms = (states[name] for name in ("evaluated", "loaded", "kept"))
    return [len(told), *rooms, whole, whole - reused, seconds]


def main(planner: str = "karma-nano", profile: str = "compact", task: str = "house-0-00") -> None:
    """Do all four."""
    go_offline()
    said = set()
    with TemporaryDirectory() as name:
        folder = Path(name)
        if planner == "random":
            shape = {"layers": 2, "width": 64, "heads": 4, "kv_heads": 2, "feed_forward": 128}
            planner = str(folder / "random.gguf")
            make_llama(planner, **shape, vocabulary=1024, context=16_384)

        def rows() -> Iterator[Sequence[object]]:
            against = 0.0
            for number, (way, run) in enumerate(WAYS.items()):
                path, done = folder / f"{number}.toml", folder / str(number)
                path.write_text(
                    f'name = "rooms"\ntasks = "{TASKS.resolve()}"\nonly = ["{task}"]\n'
                    '[[rows]]\nname = "KARMA"\noptions = { attempts = 1 }\n'
                    f'[models]\nplanner = "{planner}"\nprofile = "{profile}"\n'
                    f"[run]\n{run.format(folder=folder / 'states')}\n"
                )
                list(Run(path, done).episodes(workers=1))
                found = row(done)
                against = against or found[-1]
                yield way, *found, found[-1] / against
                said.add((done / EPISODES).read_bytes())

        table(
            "kept | answers | rooms evaluated | loaded | kept | prompt tokens | of them run |"
            " s to first tokens | of the last room only",
            rows(),
        )
    print("records are equal" if len(said) == 1 else "RECORDS DIFFER")


if __name__ == "__main__":
    typer.run(main)
