"""Train the nano VLM: crops of generated rooms, weights, files and held-out figures; resumes.

    python scripts/train_vlm.py draw                       # crops of 960 rooms, once
    python scripts/train_vlm.py train                      # about 67 minutes on 2 cores
    python scripts/train_vlm.py export models/nano-vlm
    python scripts/train_vlm.py evaluate models/nano-vlm   # macro-F1 in rooms it never saw

Rooms come from the generator with seeds of their own; those of the scene files and of the held-out
seed stay out.
"""

import hashlib
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from karma.children import forking, starting
from karma.files import read_json, to_json, write_atomic
from karma.infer.vision.transformers import ASKING, Asking, TransformersVision
from karma.training.vision.model import save
from karma.training.vision.score import Clock, examine, held_out_rooms, score
from karma.training.vision.shards import has_shard, write_shard
from karma.training.vision.train import VisionRecipe, train, trained

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "runs" / "vlm"
Folder = Annotated[Path, typer.Option(help="Crops, recipe and checkpoint.")]
SEED, HELD_OUT_SEED = 4001, 9001  # of rooms

app = typer.Typer(add_completion=False, no_args_is_help=True)
console = Console()


@app.command()
def draw(
    folder: Folder = FOLDER,
    shards: int = VisionRecipe().shards,
    first: Annotated[int, typer.Option(help="Which of several processes this is.")] = 0,
    every: Annotated[int, typer.Option(help="How many processes draw.")] = 1,
) -> None:
    """Draw the crops that training and its checks read; what is there is kept."""
    margin = VisionRecipe().margin
    held_out = folder / "held-out"
    if first == 0 and not has_shard(held_out, 0):
        console.print(f"held-out: {write_shard(held_out, 0, seed=HELD_OUT_SEED, margin=margin)}")
    for number in range(first, shards, every):
        if not has_shard(folder / "shards", number):
            rows = write_shard(folder / "shards", number, seed=SEED, margin=margin)
            console.print(f"shard {number}: {rows} crops")


@app.command("train")
def train_command(
    folder: Folder = FOLDER,
    steps: int = VisionRecipe().steps,
    batch: int = VisionRecipe().batch,
    shards: int = VisionRecipe().shards,
    seed: int = 0,
    device: str = "cpu",
    workers: Annotated[int, typer.Option(help="Processes of one thread each.")] = 2,
) -> None:
    """Train, or go on training from the last checkpoint."""
    import torch

    recipe = replace(VisionRecipe(), seed=seed, steps=steps, batch=batch, shards=shards)
    write_atomic(folder / "recipe.json", to_json(recipe, indent=2))
    if workers == 1:
        train_share(0, 1, folder, recipe, device)
    else:
        with tempfile.TemporaryDirectory() as meeting:
            arguments = (workers, folder, recipe, device, f"file://{meeting}/point")
            way = forking().get_start_method()
            with starting():
                torch.multiprocessing.start_processes(
                    train_share, arguments, nprocs=workers, start_method=way
                )


def train_share(
    rank: int, workers: int, folder: Path, recipe: VisionRecipe, device: str, meeting: str = ""
) -> None:
    """Train as one of several processes; each step's crops are shared out among them."""
    import torch

    torch.set_num_threads(1)
    if workers > 1:
        torch.distributed.init_process_group(
            "gloo", init_method=meeting, rank=rank, world_size=workers
        )
    begun = time.monotonic()
    lines = train(
        recipe,
        folder / "shards",
        folder / "held-out",
        folder,
        device=device,
        share=(rank, workers),
    )
    for line in lines:
        exact = "–" if line.exact is None else f"{line.exact:.4f}"
        minutes = (time.monotonic() - begun) / 60
        console.print(
            f"step {line.step}/{recipe.steps}  loss {line.loss:.4f}  held-out {exact}  "
            f"{minutes:.1f} min"
        )


@app.command()
def export(path: Path, folder: Folder = FOLDER) -> None:
    """Write the last checkpoint as a folder that transformers reads."""
    recipe = read_json(folder / "recipe.json", VisionRecipe)
    save(trained(recipe, folder), path)
    asking = Asking(
        profile="compact", crop=recipe.margin, outline=True, max_tokens=16, attempts=1, threads=1
    )
    write_atomic(path / ASKING, to_json(asking, indent=2))
    console.print("files of the manifest's entry:", highlight=False)
    for file in sorted(path.iterdir()):
        file.chmod(0o644)
        digest, size = hashlib.sha256(file.read_bytes()).hexdigest(), file.stat().st_size
        line = f'  {{ path = "{path.name}/{file.name}", bytes = {size}, sha256 = "{digest}" }},'
        console.print(line, markup=False, highlight=False, soft_wrap=True)


@app.command()
def evaluate(path: Path, frames: int = 320, seed: int = 0) -> None:
    """Print held-out figures of a folder; `karma vlm eval` shows more of them."""
    vision, clock = TransformersVision(path), Clock()
    places = held_out_rooms((), seed)
    asked = list(examine(vision, places, frames=frames, seed=seed, clock=clock))
    found = score(asked, model=vision.name, seed=seed, clock=clock)
    for word, line in found.words.items():
        console.print(f"{word:10} true of {line.support:5}  F1 {_figure(line.f1)}")
    console.print(
        f"macro-F1 {_figure(found.macro_f1)}  accuracy {_figure(found.accuracy)}  "
        f"large {_figure(found.large.value)}  {_figure(found.ms_per_frame)} ms per frame"
    )


def _figure(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"


if __name__ == "__main__":
    app()
