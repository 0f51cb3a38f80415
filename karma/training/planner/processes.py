"""Training in one process or several of one thread each; each step's packs are shared out."""

import tempfile
import time
from dataclasses import replace
from pathlib import Path

from karma.children import forking, starting
from karma.files import to_json, write_atomic
from karma.tasks.drawing.phrases import our_book
from karma.training.planner.checkpoints import last_step
from karma.training.planner.packs import PlannerRecipe
from karma.training.planner.sources import Sources, held_out_packs
from karma.training.planner.train import PlannerProgress, train

WATCHED_PACKS = 48  # held-out packs that the log counts right programs in


def train_in_processes(
    sources: Sources, recipe: PlannerRecipe, *, device: str, workers: int
) -> None:
    """Train, or go on from the last checkpoint in the sources' folder.

    Args:
        sources: their `say` takes the log; a function of a module where there are several workers.
        recipe: without the vocabulary's size, which the tokenizer decides.
        device: "cpu" or "cuda".
        workers: processes.
    """
    import torch

    sources.folder.mkdir(parents=True, exist_ok=True)
    tokenizer = sources.tokenizer(recipe, sources.data(recipe))
    recipe = replace(recipe, vocabulary=tokenizer.get_vocab_size())
    sources.first_model(recipe, tokenizer)  # what it needs is made once, here
    write_atomic(sources.folder / "recipe.json", to_json(recipe, indent=2))
    if workers == 1:
        _train_share(0, 1, sources, recipe, device)
        return
    with tempfile.TemporaryDirectory() as meeting:
        arguments = (workers, sources, recipe, device, Path(meeting) / "point")
        way = forking(__name__).get_start_method()
        with starting():
            torch.multiprocessing.start_processes(  # type: ignore[attr-defined,no-untyped-call]
                _train_share, arguments, nprocs=workers, start_method=way
            )


def _train_share(
    rank: int,
    workers: int,
    sources: Sources,
    recipe: PlannerRecipe,
    device: str,
    meeting: Path | None = None,
) -> None:
    """Train as one of several processes, which meet at a file."""
    import torch

    torch.set_num_threads(1)
    if workers > 1:
        torch.distributed.init_process_group(
            "gloo", init_method=f"file://{meeting}", rank=rank, world_size=workers
        )
    data = sources.data(recipe)
    tokenizer = sources.tokenizer(recipe, data)
    if rank == 0 and (done := last_step(sources.folder)):
        sources.say(f"going on from step {done}")
    start = time.monotonic()
    for line in train(
        recipe,
        data,
        held_out_packs(recipe, our_book().part(held_out=True), WATCHED_PACKS, data.hints),
        tokenizer,
        sources.folder,
        first=sources.first_model(recipe, tokenizer),
        device=device,
        share=(rank, workers),
    ):
        sources.say(_told(line, (time.monotonic() - start) / 60))


def _told(line: PlannerProgress, minutes: float) -> str:
    """Return a line of the log: of the last weights, then of the averaged ones."""
    held_out = "  ".join(
        f"{name} {one.exact:.3f}/{line.average[name].exact:.3f}" for name, one in line.last.items()
    )
    return (
        f"step {line.step}  loss {line.loss:.4f}  "
        f"held-out {line.last['all'].loss:.4f}/{line.average['all'].loss:.4f}  exact: {held_out}  "
        f"tokens {line.tokens / 1e6:.1f}M  {minutes:.1f} min"
    )
