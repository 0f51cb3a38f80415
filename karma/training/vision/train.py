"""Training the nano VLM: crops with their true states, teacher-forced answers, resumable.

Batches are drawn by number from the seed, so a run that was stopped goes on with the same ones.
Rare (type, states) pairs come as often as the square root of their share asks for. A second head,
which is thrown away, tells the states from the tower's features and the type alone: without it the
tower learns next to nothing for the first thousand steps.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from karma.files import write_atomic
from karma.infer.vision.text import STATES
from karma.training.vision.model import (
    FEATURES,
    PAD,
    VisionShape,
    answer_ids,
    new_model,
    pixels,
    prompt_ids,
    words,
)
from karma.training.vision.moments import generator
from karma.training.vision.shards import SPARE, Shard, has_shard

CHECKPOINT = "checkpoint.safetensors"


@dataclass(frozen=True, slots=True, kw_only=True)
class VisionRecipe:
    """All that decides the weights, besides the shards."""

    seed: int = 0
    shape: VisionShape = field(default_factory=VisionShape)
    shards: int = 24
    margin: float = 1.7  # side of a crop over the longer side of the object's box
    batch: int = 128
    steps: int = 8000
    warmup: int = 300
    decay: float = 0.4  # share of the steps in which the learning rate falls to zero
    learning_rate: float = 1.5e-3
    weight_decay: float = 0.05
    aid: float = 3.0  # weight of the second head's loss
    average: float = 0.998  # of the weights that are kept
    bfloat16: bool = True  # arithmetic of training; weights stay in single precision


@dataclass(frozen=True, slots=True, kw_only=True)
class VisionProgress:
    """One line of the training log."""

    step: int
    loss: float
    exact: float | None  # held-out answers right in every word


class Crops:
    """All shards' crops, drawn in balance; item n is batch n: pixels, tokens, targets."""

    def __init__(
        self,
        folder: Path,
        recipe: VisionRecipe,
        numbers: Sequence[int],
        share: tuple[int, int] = (0, 1),
    ) -> None:
        self.recipe, self.share = recipe, share
        self.shards = [Shard(folder, number) for number in numbers if has_shard(folder, number)]
        self.places = [
            (s, r) for s, shard in enumerate(self.shards) for r in range(len(shard.rows))
        ]
        keys = [self._key(place) for place in self.places]
        counts = Counter(keys)
        weights = np.array([counts[key] ** -0.5 for key in keys])
        self.edges: NDArray[np.float64] = np.cumsum(weights / weights.sum())

    def _key(self, place: tuple[int, int]) -> tuple[str, tuple[str, ...]]:
        row = self.shards[place[0]].rows[place[1]]
        return row.object_type, row.states

    def __len__(self) -> int:
        """Return the number of batches of a run."""
        return self.recipe.steps

    def __getitem__(self, step: int) -> dict[str, Any]:
        """Return one process's share of a batch as tensors."""
        rank, workers = self.share
        rng = generator(self.recipe.seed, "batch", str(step), str(rank))
        count = self.recipe.batch // workers
        chosen = np.searchsorted(self.edges, rng.random(count) * self.edges[-1])
        rows = [self._example(self.places[int(one)], rng) for one in chosen]
        return collate(rows)

    def _example(self, place: tuple[int, int], rng: np.random.Generator) -> "Example":
        shard = self.shards[place[0]]
        row, crop = shard.rows[place[1]], shard.picture(place[1])
        kind = row.object_type
        return (
            pixels(_brightened(crop, rng), _window(len(crop), rng))[:, :, :: rng.choice([1, -1])],
            prompt_ids(kind),
            answer_ids(kind, row.states),
            flags(row.states),
        )

    def plain(self, place: tuple[int, int]) -> "Example":
        """Return one crop as it is shown when the model is asked."""
        shard = self.shards[place[0]]
        row, crop = shard.rows[place[1]], shard.picture(place[1])
        edge = len(crop) * (1 - 1 / SPARE) / 2
        box = (edge, edge, len(crop) - edge, len(crop) - edge)
        kind = row.object_type
        return pixels(crop, box), prompt_ids(kind), answer_ids(kind, row.states), flags(row.states)


Example = tuple[NDArray[np.float32], list[int], list[int], list[float]]


def flags(states: Sequence[str]) -> list[float]:
    """Return a 1 for each of the twelve words that is among some."""
    return [float(word in states) for word in STATES]


def _window(side: int, rng: np.random.Generator) -> tuple[float, float, float, float]:
    """Return a part of a stored crop: a little wider or narrower, a little off the middle."""
    scale = float(rng.uniform(0.85, 1.1)) / SPARE
    spare = (1 - scale) / 2
    x, y = np.clip(rng.normal(0, 0.035, 2), -spare, spare)
    left, top = side * (spare + x), side * (spare + y)
    return float(left), float(top), float(left + side * scale), float(top + side * scale)


def _brightened(crop: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    factor = float(rng.uniform(0.85, 1.15))
    bright: NDArray[np.uint8] = np.clip(crop * factor, 0, 255).astype(np.uint8)
    return bright


def collate(rows: Sequence[Example]) -> dict[str, Any]:
    """Turn examples into tensors; targets are -100 except for the answer."""
    import torch

    pad = words().index(PAD)
    longest = max(len(prompt) + len(answer) for _, prompt, answer, _ in rows)
    tokens = np.full((len(rows), longest), pad, dtype=np.int64)
    targets = np.full((len(rows), longest), -100, dtype=np.int64)
    for number, (_, prompt, answer, _) in enumerate(rows):
        whole = prompt + answer
        tokens[number, : len(whole)] = whole
        targets[number, len(prompt) : len(whole)] = answer
    return {
        "pixel_values": torch.from_numpy(np.stack([row[0] for row in rows])),
        "input_ids": torch.from_numpy(tokens),
        "attention_mask": torch.from_numpy((tokens != pad).astype(np.int64)),
        "targets": torch.from_numpy(targets),
        "flags": torch.tensor([row[3] for row in rows]),
    }


def train(
    recipe: VisionRecipe,
    shards: Path,
    held_out: Path,
    folder: Path,
    *,
    device: str = "cpu",
    share: tuple[int, int] = (0, 1),
    every: int = 250,
    stop: int | None = None,
) -> Iterator[VisionProgress]:
    """Train, or go on from the checkpoint in `folder`; yields a line now and then.

    Args:
        recipe: what decides the weights.
        shards: folder of the training crops.
        held_out: folder of crops of other rooms.
        folder: takes the checkpoint.
        device: "cpu" or "cuda".
        share: which of how many processes this is; `torch.distributed` joins several. Only the
            first one examines, keeps checkpoints and yields lines.
        every: steps between lines.
        stop: leave off at this step, to go on later.
    """
    import torch

    torch.manual_seed(recipe.seed)
    model = new_model(recipe.shape, recipe.seed).to(device).train()
    model.set_attn_implementation("eager")  # a sequence of twenty: fused attention is slower
    model.aid = new_aid(recipe).to(device)
    average = {k: v.detach().clone() for k, v in model.state_dict().items()}
    optimizer = torch.optim.AdamW(
        _groups(model, recipe), lr=recipe.learning_rate, betas=(0.9, 0.98)
    )
    first = _resume(folder / CHECKPOINT, model, average, optimizer, device)
    crops = Crops(shards, recipe, range(recipe.shards), share)
    examined = Crops(held_out, recipe, range(recipe.shards))
    loader: Any = torch.utils.data.DataLoader(
        crops,  # type: ignore[arg-type]
        batch_size=None,
        sampler=range(first, recipe.steps if stop is None else stop),
        num_workers=1,
        prefetch_factor=8,
    )
    losses: list[float] = []
    for step, batch in enumerate(loader, start=first):
        for group in optimizer.param_groups:
            group["lr"] = recipe.learning_rate * _share(step, recipe)
        loss, aid = _loss(model, batch, device, recipe.bfloat16)
        optimizer.zero_grad(set_to_none=True)
        (loss + recipe.aid * aid).backward()
        if share[1] > 1:
            _share_gradients(model, share[1])
        torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimizer.step()
        _averaged(average, model, min(recipe.average, (step + 1) / (step + 10)))
        losses.append(loss.item())
        done = step + 1
        if share[0] == 0 and (done % every == 0 or done == recipe.steps):
            exact = exact_share(recipe, average, examined, device, 1500)
            _keep(folder / CHECKPOINT, model, average, optimizer, done)
            yield VisionProgress(step=done, loss=float(np.mean(losses)), exact=exact)
            losses = []


def trained(recipe: VisionRecipe, folder: Path) -> Any:
    """Return the model of the last checkpoint, with its averaged weights."""
    from safetensors.torch import load_file

    found = _part(load_file(folder / CHECKPOINT), "average")
    model = new_model(recipe.shape, recipe.seed)
    model.load_state_dict(without_aid(found))
    return model.eval()


def exact_share(
    recipe: VisionRecipe, weights: dict[str, Any], crops: Crops, device: str, count: int
) -> float | None:
    """Return the share of crops whose answer is right in every word; None without crops."""
    import torch

    if not crops.places:
        return None
    model = new_model(recipe.shape, recipe.seed).to(device)
    model.load_state_dict(without_aid(weights))
    model.eval()
    every = max(1, len(crops.places) // count)
    places, right = crops.places[::every], 0
    for start in range(0, len(places), 128):
        batch = collate([crops.plain(place) for place in places[start : start + 128]])
        targets = batch.pop("targets").to(device)
        del batch["flags"]
        with torch.inference_mode():
            logits = model(**{k: v.to(device) for k, v in batch.items()}).logits
        said, wanted = logits[:, :-1].argmax(-1), targets[:, 1:]
        right += int(((said == wanted) | (wanted == -100)).all(dim=1).sum())
    return right / len(places)


# ------------------------------------------------------------------ parts


def _loss(model: Any, batch: dict[str, Any], device: str, bfloat16: bool) -> Any:
    import torch

    batch = {k: v.to(device, non_blocking=True) for k, v in batch.items()}
    targets, true = batch.pop("targets")[:, 1:], batch.pop("flags")
    with torch.autocast(device, dtype=torch.bfloat16) if bfloat16 else nullcontext():
        found = model(**batch)
        features = found.image_hidden_states.reshape(len(true), -1)
        guessed = _told(model, features, batch["input_ids"][:, FEATURES])
    functions = torch.nn.functional
    answer = functions.cross_entropy(found.logits[:, :-1].float().transpose(1, 2), targets)
    return answer, functions.binary_cross_entropy_with_logits(guessed.float(), true)


def new_aid(recipe: VisionRecipe) -> Any:
    """Return the second head: from features to the twelve words, for each type in its own way."""
    import torch

    with torch.random.fork_rng():
        torch.manual_seed(recipe.seed)
        return torch.nn.Sequential(
            torch.nn.LayerNorm(recipe.shape.hidden * FEATURES),
            torch.nn.Linear(recipe.shape.hidden * FEATURES, 384),
            torch.nn.GELU(),
            torch.nn.Linear(384, len(STATES) * (1 + len(words()))),
        )


def _told(model: Any, features: Any, kinds: Any) -> Any:
    """Return the second head's twelve figures for each crop: those of all types and of its own."""
    found = model.aid(features).unflatten(1, (-1, len(STATES)))
    own = found[range(len(found)), kinds + 1]
    return found[:, 0] + own


def without_aid(weights: dict[str, Any]) -> dict[str, Any]:
    """Return the weights of the model alone."""
    return {name: value for name, value in weights.items() if not name.startswith("aid.")}


def _share_gradients(model: Any, workers: int) -> None:
    """Replace each process's gradients by their mean."""
    import torch

    gradients = [p.grad for p in model.parameters() if p.grad is not None]
    flat = torch.cat([gradient.flatten() for gradient in gradients])
    torch.distributed.all_reduce(flat)
    flat /= workers
    start = 0
    for gradient in gradients:
        gradient.copy_(flat[start : start + gradient.numel()].view_as(gradient))
        start += gradient.numel()


def _groups(model: Any, recipe: VisionRecipe) -> list[dict[str, Any]]:
    """Return the parameters: matrices shrink towards zero, the others do not."""
    flat = [p for p in model.parameters() if p.ndim < 2]
    full = [p for p in model.parameters() if p.ndim >= 2]
    return [
        {"params": full, "weight_decay": recipe.weight_decay},
        {"params": flat, "weight_decay": 0.0},
    ]


def _share(step: int, recipe: VisionRecipe) -> float:
    """Return the learning rate of a step over the highest: up, level, down to nothing."""
    left = (recipe.steps - step) / (recipe.decay * recipe.steps)
    return min(1.0, (step + 1) / recipe.warmup, left)


def _averaged(average: dict[str, Any], model: Any, kept: float) -> None:
    import torch

    with torch.no_grad():
        for name, value in model.state_dict().items():
            if value.dtype.is_floating_point:
                average[name].lerp_(value, 1 - kept)
            else:
                average[name].copy_(value)


def _keep(path: Path, model: Any, average: dict[str, Any], optimizer: Any, step: int) -> None:
    """Write weights, their average and the optimizer's moments; the older file stays until then."""
    from safetensors.torch import save

    moments = optimizer.state_dict()["state"]
    parts = {"model": model.state_dict(), "average": average}
    parts |= {f"moments.{number}": state for number, state in moments.items()}
    whole = {
        f"{part}.{name}": value.detach().cpu().contiguous()
        for part, values in parts.items()
        for name, value in values.items()
    }
    write_atomic(path, save(whole, metadata={"step": str(step)}))


def _resume(path: Path, model: Any, average: dict[str, Any], optimizer: Any, device: str) -> int:
    from safetensors import safe_open
    from safetensors.torch import load_file

    if not path.exists():
        return 0
    found = load_file(path, device=device)
    model.load_state_dict(_part(found, "model"))
    for name, value in _part(found, "average").items():
        average[name].copy_(value)
    state = optimizer.state_dict()
    count = sum(len(group["params"]) for group in state["param_groups"])
    state["state"] = {number: _part(found, f"moments.{number}") for number in range(count)}
    optimizer.load_state_dict(state)
    with safe_open(path, "pt") as saved:
        return int(saved.metadata()["step"])


def _part(found: dict[str, Any], name: str) -> dict[str, Any]:
    return {
        key.removeprefix(f"{name}."): value
        for key, value in found.items()
        if key.startswith(f"{name}.")
    }
