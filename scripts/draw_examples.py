"""Draw what a planner is tuned on: prompts and answers, one a line; then `karma models tune`.

    python scripts/draw_examples.py runs/mini --packs 90000

Writes `examples.jsonl.gz`, and `watched.jsonl.gz` in forms and words that training has not, with
sentences of ALFRED's training trials that are kept out. What it reads, and what stays out, says
`karma.training.planner.sources`.
"""

import argparse
import gzip
import multiprocessing
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

from rich.progress import track
from train_planner import sources

from karma.files import to_json
from karma.offline import go_offline
from karma.seeds import stream
from karma.tasks.drawing.phrases import our_book
from karma.tasks.requests import load_said
from karma.training.planner.packs import Data, PlannerRecipe, draw_pack
from karma.training.planner.samples import TrainingExample, draw_alfred
from karma.training.planner.sources import held_out_packs

WRITTEN = Path("eval/requests/written.jsonl")
RECIPE = PlannerRecipe(
    seed=37, start="nano/start.gguf", refused=0.11, near_misses=0.08, written=0.16,
    alfred=(0.45, 0.50), steps_said=0.10,
)  # fmt: skip
AT_ONCE = 500  # packs that a worker draws at a time
WATCHED = 200  # packs, and sentences of ALFRED's, to watch


def main() -> None:
    """Draw both files."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--elsewhere", type=float, default=0.25, help="see PlannerRecipe")
    parser.add_argument("--packs", type=int, default=90_000)
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    data = _material(given.folder)
    _write(given.folder / "watched.jsonl.gz", map(_line, _watched(given.folder, data)))
    parts = [(given.folder, first) for first in range(0, given.packs, AT_ONCE)]
    with multiprocessing.get_context("fork").Pool(given.workers) as pool:
        drawn = track(pool.imap(_drawn, parts), "drawing", total=len(parts))
        _write(given.folder / "examples.jsonl.gz", (line for part in drawn for line in part))


@cache
def _material(folder: Path) -> Data:
    return replace(sources(folder).data(RECIPE), written=load_said(WRITTEN))


def _drawn(part: tuple[Path, int]) -> list[bytes]:
    folder, first = part
    data = _material(folder)
    packs = (draw_pack(RECIPE, data, "train", str(n)) for n in range(first, first + AT_ONCE))
    return [_line(example) for pack in packs for example in pack]


def _watched(folder: Path, data: Data) -> Iterator[TrainingExample]:
    for pack in held_out_packs(
        replace(RECIPE, written=0.0), our_book().part(held_out=True), WATCHED, data.hints
    ):
        yield from pack
    kept_out = sources(folder).sentences(held_out=True)
    rng = stream(RECIPE.seed, "watched")
    for number in range(WATCHED):
        example = draw_alfred(rng, data.rooms[number], kept_out, mapped=False)
        if example is not None:
            yield example


def _line(example: TrainingExample) -> bytes:
    prompt = [example.stable, example.changing]
    return to_json({"kind": example.kind, "prompt": prompt, "answer": example.program})


def _write(path: Path, lines: Iterator[bytes]) -> None:
    with gzip.open(path, "wb", compresslevel=4) as file:
        for line in lines:
            file.write(line)


if __name__ == "__main__":
    go_offline()
    main()
