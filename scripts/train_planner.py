"""Train the nano planner: tokenizer, weights, GGUF and held-out figures; resumes where it stopped.

    python scripts/train_planner.py train --steps 5500        # about an hour on 2 cores
    python scripts/train_planner.py export models/nano/planner.gguf
    python scripts/train_planner.py evaluate models/nano/planner.gguf

Rooms come from the generator (seeds of their own) and, where the reference data lies beside the
project, from AI2-THOR floor plans; phrasing from our phrase book and ALFRED's annotators. The test
tasks' rooms and their (object, receptacle) pairs stay out.
"""

import os
import tempfile
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from karma import registry
from karma.files import read_json, to_json, write_atomic
from karma.seeds import stream
from karma.training import rooms
from karma.training.phrases import Book, our_book, with_alfred
from karma.training.recollections import Room
from karma.training.samples import Example, draw
from karma.training.train import (
    END,
    PAD,
    Data,
    Recipe,
    exact_share,
    first_embeddings,
    last_step,
    load_weights,
    make_tokenizer,
    train,
)

ROOT = Path(__file__).parents[1]
SHARED = Path(os.environ.get("KARMA_SHARED", ROOT.parent / "shared"))
TASKS = (ROOT / "eval" / "alfred_l" / "tasks.jsonl",)
Folder = Annotated[Path, typer.Option(help="Checkpoints, tokenizer and rooms.")]
FOLDER = ROOT / "runs" / "planner"

app = typer.Typer(add_completion=False, no_args_is_help=True)
console = Console()


def gather_rooms(folder: Path, recipe: Recipe, generated: int) -> list[Room]:
    """Return the training rooms, made once and kept in the folder."""
    path = folder / "rooms.json"
    if path.exists():
        return read_json(path, list[Room])
    console.print(f"making {generated} rooms ...")
    found = list(rooms.generated_rooms(generated, recipe.seed + 77))
    dumps = SHARED / "data" / "thor5" / "scenes.jsonl.gz"
    if dumps.exists():
        layouts = SHARED / "data" / "alfred" / "layouts.json.gz"
        found += rooms.imported_rooms(dumps, layouts, recipe.seed)
    else:
        console.print(f"no floor plans at {dumps}: generated rooms only")
    write_atomic(path, to_json(found))
    return found


def gather_book() -> Book:
    """Return our phrases, with ALFRED's where the demonstrations lie beside the project."""
    path = SHARED / "data" / "alfred" / "train.jsonl.gz"
    if path.exists():
        return with_alfred(our_book(), path)
    console.print(f"no demonstrations at {path}: our own phrases only")
    return our_book()


def held_out_packs(recipe: Recipe, book: Book, count: int) -> list[list[Example]]:
    """Return packs over rooms and phrasings that training never sees."""
    found = list(rooms.generated_rooms(24, recipe.seed + 78))
    packs = []
    for number in range(count):
        rng = stream(recipe.seed, "planner", "held-out", str(number))
        room = found[int(rng.integers(len(found)))]
        mapped = bool(rng.random() < recipe.mapped)
        packs.append([draw(rng, room, book, mapped=mapped) for _ in range(recipe.examples)])
    return packs


def gather_tokenizer(folder: Path, recipe: Recipe, data: Data) -> Any:
    """Return the tokenizer, trained once and kept in the folder."""
    from tokenizers import Tokenizer

    path = folder / "tokenizer.json"
    if not path.exists():
        console.print("training the tokenizer ...")
        write_atomic(path, make_tokenizer(recipe, data, 1500).to_str().encode())
    return Tokenizer.from_file(str(path))


def gather_embeddings(folder: Path, recipe: Recipe, tokenizer: Any) -> Any:
    """Return the token embeddings to start from, made once and kept in the folder."""
    from safetensors.numpy import load, save

    path = folder / "embeddings.safetensors"
    if not path.exists():
        console.print("embedding the vocabulary ...")
        found = first_embeddings(recipe, tokenizer, registry.load("embedders", "minilm")())
        write_atomic(path, save({"tokens": found}))
    return load(path.read_bytes())["tokens"]


@app.command("train")
def train_command(
    folder: Folder = FOLDER,
    steps: int = 8000,
    seed: int = 0,
    device: str = "cpu",
    workers: Annotated[int, typer.Option(help="Processes of one thread each.")] = 2,
    generated: int = 300,
) -> None:
    """Train, or go on training from the last checkpoint."""
    import torch

    folder.mkdir(parents=True, exist_ok=True)
    recipe = Recipe(seed=seed, steps=steps)
    book = gather_book()
    data = gather_data(folder, recipe, book, generated)
    gather_embeddings(folder, recipe, gather_tokenizer(folder, recipe, data))
    if workers == 1:
        train_share(0, 1, folder, recipe, device, generated)
    else:
        with tempfile.TemporaryDirectory() as meeting:
            arguments = (workers, folder, recipe, device, generated, f"file://{meeting}/point")
            torch.multiprocessing.spawn(train_share, arguments, nprocs=workers)


def gather_data(folder: Path, recipe: Recipe, book: Book, generated: int) -> Data:
    """Return rooms and phrases of the training side."""
    return Data(
        rooms=gather_rooms(folder, recipe, generated),
        book=book.part(held_out=False),
        excluded=rooms.asked_pairs(TASKS),
    )


def train_share(
    rank: int,
    workers: int,
    folder: Path,
    recipe: Recipe,
    device: str,
    generated: int,
    meeting: str = "",
) -> None:
    """Train as one of several processes; each step's examples are shared out among them."""
    import torch

    torch.set_num_threads(1)
    if workers > 1:
        torch.distributed.init_process_group(
            "gloo", init_method=meeting, rank=rank, world_size=workers
        )
    book = gather_book()
    data = gather_data(folder, recipe, book, generated)
    tokenizer = gather_tokenizer(folder, recipe, data)
    recipe = replace(recipe, vocabulary=tokenizer.get_vocab_size())
    write_atomic(folder / "recipe.json", to_json(recipe, indent=2))
    held_out = held_out_packs(recipe, book.part(held_out=True), 60)
    if rank == 0 and (done := last_step(folder)):
        console.print(f"going on from step {done}")
    start = time.monotonic()
    lines = train(
        recipe,
        data,
        held_out,
        tokenizer,
        folder,
        device=device,
        share=(rank, workers),
        embeddings=gather_embeddings(folder, recipe, tokenizer),
    )
    for line in lines:
        seconds = time.monotonic() - start
        console.print(
            f"step {line.step}/{recipe.steps}  loss {line.loss:.4f}  held-out {line.exact:.3f}  "
            f"tokens {line.tokens * workers / 1e6:.1f}M  {seconds / 60:.1f} min"
        )


@app.command()
def export(
    path: Path,
    folder: Folder = FOLDER,
    dtype: str = "F16",
) -> None:
    """Write the last checkpoint as GGUF."""
    from tokenizers import Tokenizer

    from karma.infer.gguf_export import export_llama_gguf

    recipe = read_json(folder / "recipe.json", Recipe)
    export_llama_gguf(
        load_weights(folder, recipe),
        Tokenizer.from_file(str(folder / "tokenizer.json")),
        path,
        name="karma-nano-planner",
        eos_token=END,
        pad_token=PAD,
        dtype=dtype,  # type: ignore[arg-type]
        licence="Apache-2.0",
        description="(memory, instruction) -> program of skill calls; scripts/train_planner.py",
    )
    console.print(f"{path}  {path.stat().st_size / 1e6:.1f} MB")


@app.command()
def evaluate(folder: Folder = FOLDER, packs: int = 100, seed: int = 1) -> None:
    """Print held-out figures of the last checkpoint by kind of request, teacher-forced."""
    from tokenizers import Tokenizer

    recipe = replace(read_json(folder / "recipe.json", Recipe), seed=seed)
    model = load_weights(folder, recipe)
    tokenizer = Tokenizer.from_file(str(folder / "tokenizer.json"))
    examples = [
        example
        for pack in held_out_packs(recipe, gather_book().part(held_out=True), packs)
        for example in pack
    ]
    for kind, count in sorted(Counter(example.kind for example in examples).items()):
        singles = [[example] for example in examples if example.kind == kind]
        share = exact_share(model, tokenizer, singles, "cpu")
        console.print(f"{kind:12} {count:4}  exact {share:.3f}")


if __name__ == "__main__":
    app()
