"""Do a sweep over six models, two profiles and twelve tasks; kill it twice; resume; export it.

Four planners have random weights in the architectures of real families, two are the trained ones of
models/nano/. Prints what was done when, and ends with the table.
"""

import argparse
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

from karma.bench.export import exported
from karma.bench.sweep_folder import TABLE, read_sweep
from karma.files import write_atomic
from karma.journal.header import CELLS, EPISODES
from karma.journal.records import read_records
from karma.testing import make_planner

ROOT = Path(__file__).resolve().parents[1]
KARMA = (sys.executable, "-P", "-c", "from karma.cli import app; app()", "eval")
FAMILIES = ("llama3", "qwen2.5", "gemma3", "mistral")
TRAINED = ("planner.gguf", "start.gguf")
EXPERIMENT = """
name = "show_sweep"
tasks = "{root}/eval/alfred_l/tasks.jsonl"
only = ["simple-0[1-4]", "composite-0[1-4]", "complex-0[1-4]"]

[[rows]]
name = "KARMA"
options.attempts = 1

[models]
max_tokens = {tokens}

[[grid]]
models.planner = {planners}
models.profile = ["compact", "full"]
"""


def main() -> int:
    """Run it; returns the exit code of the sweep."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("runs/show_sweep"))
    parser.add_argument("--kills", type=int, default=2)
    parser.add_argument("--tokens", type=int, default=48, help="of an answer at most")
    parser.add_argument("--seed", type=int, default=0, help="of when it is killed")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    path = options.out / "sweep.toml"
    path.write_text(experiment(options.out.absolute() / "models", options.tokens))
    folder = options.out / "run"
    total, draw = 2 * (len(FAMILIES) + len(TRAINED)) * 12, random.Random(options.seed)
    command = (*KARMA, str(path), "--out", str(folder))
    for number in range(options.kills):
        wanted = draw.randrange(
            total * number // options.kills, total * (number + 1) // options.kills
        )
        killed_after(command, folder, max(wanted, 1))
    begun = time.monotonic()
    code = subprocess.call(command)
    print(f"resumed and ended after {time.monotonic() - begun:.0f} s with code {code}")
    for form, name in (("parquet", "episodes.parquet"), ("junit", "junit.xml")):
        data = exported(folder, form)
        write_atomic(options.out / name, data)
        print(f"{options.out / name}: {len(data)} bytes")
    print(f"{len(read_sweep(folder).cells)} cells, {done(folder)} episodes: {folder / TABLE}")
    return code


def experiment(models: Path, tokens: int) -> str:
    """Make the models with random weights, and return the experiment."""
    made = [models / f"{family}-random.gguf" for family in FAMILIES]
    for seed, (family, place) in enumerate(zip(FAMILIES, made, strict=True)):
        if not place.exists():
            place.parent.mkdir(parents=True, exist_ok=True)
            make_planner(place, family, seed)
    trained = [ROOT / "models" / "nano" / name for name in TRAINED]
    planners = [str(place) for place in (*made, *trained)]
    return EXPERIMENT.format(root=ROOT, tokens=tokens, planners=planners)


def killed_after(command: tuple[str, ...], folder: Path, wanted: int) -> None:
    """Go on with the sweep until so many episodes are done, then kill it."""
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, start_new_session=True)
    while done(folder) < wanted and process.poll() is None:
        time.sleep(0.05)
    process.send_signal(signal.SIGKILL)
    process.wait()
    print(f"killed after {done(folder)} episodes", flush=True)


def done(folder: Path) -> int:
    """Return how many episodes are done."""
    return sum(len(read_records(place)) for place in folder.glob(f"{CELLS}/*/{EPISODES}"))


if __name__ == "__main__":
    sys.exit(main())
