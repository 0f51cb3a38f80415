"""Checkpoints of a training: weights and the optimizers' state, replaced whole or not at all."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from karma.errors import FileError
from karma.files import read_json, to_json, write_atomic
from karma.infer.llama.gguf_export import export_llama_gguf
from karma.training.planner.network import new_model
from karma.training.planner.packs import END, PAD, PlannerRecipe
from karma.training.planner.start import started_model


@dataclass(frozen=True, slots=True, kw_only=True)
class _Saved:
    step: int
    tokens: int


def save_checkpoint(
    folder: Path, model: Any, average: Any, optimizers: Sequence[Any], step: int, tokens: int
) -> None:
    """Save weights, averaged weights and optimizer state; the older checkpoint stays until then."""
    from safetensors.torch import save

    state = {f"model.{name}": value for name, value in model.named_parameters()}
    state |= {f"average.{name}": value for name, value in average.named_parameters()}
    for name, value in model.named_parameters():
        for optimizer in optimizers:
            for moment, held in optimizer.state.get(value, {}).items():
                if moment != "step":
                    state[f"{moment}.{name}"] = held
    header = {"step": str(step), "tokens": str(tokens)}
    state = {name: value.detach().cpu().contiguous() for name, value in state.items()}
    write_atomic(folder / "checkpoint.safetensors", save(state, metadata=header))
    write_atomic(folder / "progress.json", to_json(_Saved(step=step, tokens=tokens)))


def resume(folder: Path, model: Any, average: Any, optimizers: Sequence[Any]) -> tuple[int, int]:
    """Load the last checkpoint into models and optimizers; return its step and token count."""
    import torch
    from safetensors import safe_open

    path = folder / "checkpoint.safetensors"
    if not path.exists():
        return 0, 0
    with safe_open(path, "pt") as saved:
        header = saved.metadata()
        step, tokens = int(header["step"]), int(header["tokens"])
        with torch.no_grad():
            for name, value in model.named_parameters():
                value.copy_(saved.get_tensor(f"model.{name}"))
            for name, value in average.named_parameters():
                value.copy_(saved.get_tensor(f"average.{name}"))
        matrices = {value for group in optimizers[0].param_groups for value in group["params"]}
        for name, value in model.named_parameters():
            muon = value in matrices
            moments = ("momentum_buffer",) if muon else ("exp_avg", "exp_avg_sq")
            found = {m: saved.get_tensor(f"{m}.{name}").to(value.device) for m in moments}
            if not muon:
                found["step"] = torch.tensor(float(step))
            optimizers[0 if muon else 1].state[value] = found
    return step, tokens


def last_step(folder: Path) -> int:
    """Return the step of the last checkpoint in a folder, 0 without one."""
    path = folder / "progress.json"
    try:
        return read_json(path, _Saved).step if path.exists() else 0
    except FileError:
        return 0


def load_weights(folder: Path, recipe: PlannerRecipe, *, average: bool = False) -> Any:
    """Return the model of the last checkpoint, float32, in evaluation mode.

    Args:
        folder: of the training.
        recipe: with the vocabulary's size.
        average: the averaged weights instead of the last.

    Raises:
        FileError: there is none.
    """
    import torch
    from safetensors import safe_open

    path = folder / "checkpoint.safetensors"
    if not path.exists():
        raise FileError(path, "no checkpoint", fix="python scripts/train_planner.py")
    model = new_model(recipe)
    kind = "average" if average else "model"
    with safe_open(path, "pt") as saved, torch.no_grad():
        for name, value in model.named_parameters():
            value.copy_(saved.get_tensor(f"{kind}.{name}"))
    return model.eval()


def export_gguf(
    folder: Path, path: Path, dtype: str, *, models: Path, average: bool = False
) -> None:
    """Write the last checkpoint of a folder as GGUF, mixed with the weights that it began with.

    Args:
        folder: of the training.
        path: of the GGUF.
        dtype: of its matrices.
        models: where the recipe's `start` lies.
        average: the averaged weights instead of the last.

    Raises:
        FileError: there is no checkpoint, or no tokenizer.
    """
    import torch
    from tokenizers import Tokenizer

    recipe = read_json(folder / "recipe.json", PlannerRecipe)
    tokenizer = Tokenizer.from_file(str(folder / "tokenizer.json"))
    model = load_weights(folder, recipe, average=average)
    if recipe.start:
        first = dict(started_model(recipe, tokenizer, models / recipe.start).named_parameters())
        with torch.no_grad():
            for name, value in model.named_parameters():
                value.lerp_(first[name], recipe.kept)
    export_llama_gguf(
        model,
        tokenizer,
        path,
        name="karma-nano-planner",
        eos_token=END,
        pad_token=PAD,
        dtype=dtype,  # type: ignore[arg-type]
        licence="Apache-2.0",
        description="(memory, instruction) -> program of skill calls; scripts/train_planner.py",
    )
