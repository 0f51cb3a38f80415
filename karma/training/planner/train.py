"""Training the nano planner: steps over packs, resumable; the loss counts program tokens only."""

import copy
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from karma.tasks.drawing.several import SEVERAL
from karma.training.planner.checkpoints import resume, save_checkpoint
from karma.training.planner.network import Batch, collate, forward, new_model
from karma.training.planner.packs import Data, PlannerRecipe, draw_pack
from karma.training.planner.ranks import add_up, matrices, others, share_moments
from karma.training.planner.samples import TrainingExample

PART = 10  # packs that are computed at once
HORIZON = 200  # steps that the averaged weights look back over


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOut:
    """How well weights do on held-out examples, teacher-forced."""

    loss: float  # mean over the programs' tokens
    exact: float  # share of programs right to the letter


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannerProgress:
    """One line of the training log."""

    step: int
    loss: float
    tokens: int  # of all processes
    last: Mapping[str, HeldOut]  # of the last weights by group of requests, "all" among them
    average: Mapping[str, HeldOut]  # of the averaged ones


def held_out_score(
    model: Any, tokenizer: Any, packs: Sequence[Sequence[TrainingExample]]
) -> HeldOut:
    """Return loss, and share of programs whose every token is the most likely one."""
    import torch

    right = total = count = 0
    loss = 0.0
    device = str(model.device)
    with torch.no_grad():
        for start in range(0, len(packs), PART):
            batch = collate(packs[start : start + PART], tokenizer).to(device)
            logits, targets = forward(model, batch)
            loss += float(torch.nn.functional.cross_entropy(logits, targets, reduction="sum"))
            count += len(targets)
            good = (logits.argmax(-1) == targets).tolist()
            program: list[bool] = []
            for hit, target in zip(good, targets.tolist(), strict=True):
                program.append(hit)
                if target == 0:
                    right, total, program = right + all(program), total + 1, []
    return HeldOut(loss=loss / count, exact=right / total)


def group_of(example: TrainingExample) -> str:
    """Return what the log counts an example under: refused, several, hinted, said or asked."""
    if example.kind.startswith("refuse"):
        return "refused"
    if example.kind == SEVERAL:
        return SEVERAL
    if "\n#words " in example.changing:
        return "hinted"
    return "said" if example.kind in ("alfred", "step") else "asked"


def by_group(packs: Sequence[Sequence[TrainingExample]]) -> dict[str, list[list[TrainingExample]]]:
    """Return the packs by group of requests, one example each; "all" as they are."""
    found: dict[str, list[list[TrainingExample]]] = {"all": [list(pack) for pack in packs]}
    for example in (example for pack in packs for example in pack):
        found.setdefault(group_of(example), []).append([example])
    return found


def exact_by_kind(
    folder: Path, model: Any, examples: Sequence[TrainingExample]
) -> Iterator[tuple[str, int, float]]:
    """Yield kind of request, examples of it, and the share that is right to the letter."""
    from tokenizers import Tokenizer

    tokenizer = Tokenizer.from_file(str(folder / "tokenizer.json"))
    for kind in sorted({example.kind for example in examples}):
        singles = [[example] for example in examples if example.kind == kind]
        yield kind, len(singles), held_out_score(model, tokenizer, singles).exact


def train(
    recipe: PlannerRecipe,
    data: Data,
    held_out: Sequence[Sequence[TrainingExample]],
    tokenizer: Any,
    folder: Path,
    *,
    first: Any = None,
    device: str = "cpu",
    every: int = 100,
    share: tuple[int, int] = (0, 1),
) -> Iterator[PlannerProgress]:
    """Train from the first weights or from the last checkpoint in `folder`; yields the log.

    Args:
        recipe: everything that decides the weights.
        data: training rooms and phrases.
        held_out: packs of rooms and phrases that `data` does not contain.
        tokenizer: of `corpus`, or of the GGUF to start from.
        folder: takes checkpoint.safetensors and progress.json.
        first: the model to begin with, by default random weights.
        device: "cpu" or "cuda".
        every: steps between checkpoints.
        share: (rank, number) of this process among those that train together; with more than one,
            torch.distributed is up, and only rank 0 writes and yields.
    """
    model = (first or new_model(recipe)).to(device)
    average = copy.deepcopy(model)
    optimizers = _optimizers(model, recipe)
    step, seen = resume(folder, model, average, optimizers)
    watched = by_group(held_out)
    rank, number_of = share
    losses: list[float] = []
    while step < recipe.steps:
        for group in (group for one in optimizers for group in one.param_groups):
            group["lr"] = recipe.learning_rate * rate_share(recipe, step)
        names = [(str(step), str(number)) for number in range(rank, recipe.packs, number_of)]
        packs = [draw_pack(recipe, data, "train", *name) for name in names]
        batches = [collate(part, tokenizer).to(device) for part in _of_a_size(packs)]
        seen += sum(int((batch.tokens != 1).sum()) for batch in batches) * number_of
        losses.append(_step(model, optimizers, batches, share, half=recipe.half))
        _follow(average, model, step)
        step += 1
        if step % every == 0 or step == recipe.steps:
            share_moments(optimizers[0], share)
            if rank:
                continue
            save_checkpoint(folder, model, average, optimizers, step, seen)
            last, averaged = (
                {name: held_out_score(one, tokenizer, some) for name, some in watched.items()}
                for one in (model, average)
            )
            yield PlannerProgress(
                step=step, loss=float(np.mean(losses)), tokens=seen, last=last, average=averaged
            )
            losses = []


def _follow(average: Any, model: Any, step: int) -> None:
    """Move the averaged weights towards the last ones; early on they look back over fewer steps."""
    import torch

    share = max(1 / HORIZON, 1 / (step + 1))
    with torch.no_grad():
        for mean, value in zip(average.parameters(), model.parameters(), strict=True):
            mean.lerp_(value, share)


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
    batches: Sequence[Batch],
    share: tuple[int, int],
    *,
    half: bool,
) -> float:
    """Take one step on the mean loss of all batches' targets; returns it."""
    import torch

    count = sum(int((batch.targets != -100).sum()) for batch in batches)
    total = 0.0
    model.zero_grad()
    for batch in batches:
        logits, targets = forward(model, batch, half=half)
        loss = torch.nn.functional.cross_entropy(logits, targets, reduction="sum") / count
        (loss / share[1]).backward()  # type: ignore[no-untyped-call]
        total += float(loss.detach())
    add_up([value.grad for value in model.parameters()], share)
    torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)  # their length does not matter to Muon
    for matrix in others(optimizers[0], share):
        matrix.grad = None  # Muon leaves it alone
    for one in optimizers:
        one.step()
    with torch.no_grad():
        for matrix in others(optimizers[0], share):
            matrix.zero_()
        add_up([value for value in matrices(optimizers[0])], share)
    return total


def rate_share(recipe: PlannerRecipe, step: int) -> float:
    """Return the share of the learning rate: warm up, stay, fall to zero over the last steps.

    While it stays, nothing depends on `steps`: a run can be prolonged, or made to fall at once.
    """
    if step < recipe.warmup:
        return (step + 1) / recipe.warmup
    return min(1.0, (recipe.steps - step) / max(1, recipe.decay))
