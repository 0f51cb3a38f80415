"""Training the nano planner: steps over packs, resumable; the loss counts program tokens only."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from karma.training.planner.checkpoints import resume, save_checkpoint
from karma.training.planner.network import collate, forward, new_model
from karma.training.planner.packs import Data, PlannerRecipe, draw_pack
from karma.training.planner.samples import TrainingExample

PART = 3  # packs that are computed at once


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannerProgress:
    """One line of the training log."""

    step: int
    loss: float
    tokens: int
    exact: float | None  # held-out programs right to the letter, teacher-forced


def exact_share(
    model: Any, tokenizer: Any, packs: Sequence[Sequence[TrainingExample]], device: str
) -> float:
    """Return the share of programs whose every token is the most likely one, teacher-forced."""
    import torch

    right = total = 0
    with torch.no_grad():
        for start in range(0, len(packs), 4):
            batch = _to(collate(packs[start : start + 4], tokenizer), device)
            logits, targets = forward(model, batch)
            good = (logits.argmax(-1) == targets).tolist()
            program: list[bool] = []
            for hit, target in zip(good, targets.tolist(), strict=True):
                program.append(hit)
                if target == 0:
                    right, total, program = right + all(program), total + 1, []
    return right / total


def exact_by_kind(
    folder: Path, model: Any, examples: Sequence[TrainingExample]
) -> Iterator[tuple[str, int, float]]:
    """Yield kind of request, examples of it, and the share that is right to the letter."""
    from tokenizers import Tokenizer

    tokenizer = Tokenizer.from_file(str(folder / "tokenizer.json"))
    for kind in sorted({example.kind for example in examples}):
        singles = [[example] for example in examples if example.kind == kind]
        yield kind, len(singles), exact_share(model, tokenizer, singles, "cpu")


def train(
    recipe: PlannerRecipe,
    data: Data,
    held_out: Sequence[Sequence[TrainingExample]],
    tokenizer: Any,
    folder: Path,
    *,
    device: str = "cpu",
    every: int = 200,
    share: tuple[int, int] = (0, 1),
    embeddings: NDArray[np.float32] | None = None,
) -> Iterator[PlannerProgress]:
    """Train from scratch or from the last checkpoint in `folder`; yields the log as it grows.

    Args:
        recipe: everything that decides the weights.
        data: training rooms and phrases.
        held_out: packs of rooms and phrases that `data` does not contain.
        tokenizer: of `corpus`.
        folder: takes checkpoint.safetensors and progress.json.
        device: "cpu" or "cuda".
        every: steps between checkpoints.
        share: (rank, number) of this process among those that train together; with more than one,
            torch.distributed is up, and only rank 0 writes and yields.
        embeddings: see `new_model`.
    """
    model = new_model(recipe, embeddings).to(device)
    optimizers = _optimizers(model, recipe)
    step, seen = resume(folder, model, optimizers)
    rank, number_of = share
    losses: list[float] = []
    while step < recipe.steps:
        for group in (group for one in optimizers for group in one.param_groups):
            group["lr"] = recipe.learning_rate * _schedule(recipe, step)
        names = [(str(step), str(number)) for number in range(rank, recipe.packs, number_of)]
        packs = [draw_pack(recipe, data, "train", *name) for name in names]
        batches = [_to(collate(part, tokenizer), device) for part in _of_a_size(packs)]
        seen += sum(int((batch["tokens"] != 1).sum()) for batch in batches)
        losses.append(_step(model, optimizers, batches, number_of, half=recipe.half))
        step += 1
        if rank == 0 and (step % every == 0 or step == recipe.steps):
            exact = exact_share(model, tokenizer, held_out, device)
            save_checkpoint(folder, model, optimizers, step, seen)
            yield PlannerProgress(step=step, loss=float(np.mean(losses)), tokens=seen, exact=exact)
            losses = []


def _optimizers(model: Any, recipe: PlannerRecipe) -> tuple[Any, ...]:
    """Return Muon for the layers' matrices (Jordan, 2024) and AdamW for the rest, at one rate."""
    import torch

    table = model.model.embed_tokens.weight
    layers = [value for value in model.parameters() if value.ndim == 2 and value is not table]
    rest = [value for value in model.parameters() if value.ndim != 2 or value is table]
    rate, decay = recipe.learning_rate, recipe.weight_decay
    return (
        torch.optim.Muon(layers, lr=rate, weight_decay=decay, adjust_lr_fn="match_rms_adamw"),
        torch.optim.AdamW(rest, lr=rate, betas=(0.9, 0.95), weight_decay=decay),
    )


def _of_a_size(
    packs: Sequence[Sequence[TrainingExample]],
) -> list[Sequence[Sequence[TrainingExample]]]:
    """Return packs in parts of like length, the shorter first: less padding, smaller attention."""
    ordered = sorted(packs, key=lambda pack: sum(len(one.changing) for one in pack))
    return [ordered[start : start + PART] for start in range(0, len(ordered), PART)]


def _step(
    model: Any,
    optimizers: Sequence[Any],
    batches: Sequence[dict[str, Any]],
    number_of: int,
    *,
    half: bool,
) -> float:
    """Take one step on the mean loss of all batches' targets; returns it."""
    import torch

    count = sum(int((batch["targets"] != -100).sum()) for batch in batches)
    total = 0.0
    model.zero_grad()
    for batch in batches:
        logits, targets = forward(model, batch, half=half)
        loss = torch.nn.functional.cross_entropy(logits, targets, reduction="sum") / count
        loss.backward()  # type: ignore[no-untyped-call]
        total += float(loss.detach())
    if number_of > 1:
        flat = torch.cat([value.grad.flatten() for value in model.parameters()])
        torch.distributed.all_reduce(flat)
        start = 0
        for value in model.parameters():
            size = value.numel()
            value.grad.copy_(flat[start : start + size].view_as(value) / number_of)
            start += size
    torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
    for one in optimizers:
        one.step()
    return total


def _schedule(recipe: PlannerRecipe, step: int) -> float:
    """Warm up, stay, decay: so that `steps` can still be changed on the way."""
    if step < recipe.warmup:
        return (step + 1) / recipe.warmup
    left = (recipe.steps - step) / max(1, int(recipe.decay * recipe.steps))
    return min(1.0, left)


def _to(batch: dict[str, Any], device: str) -> dict[str, Any]:
    return {name: tensor.to(device) for name, tensor in batch.items()}
