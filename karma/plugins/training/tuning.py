"""Tune the weights of a GGUF on examples: a LoRA adapter, which `gguf_files` puts back into a GGUF.

One recipe for karma-mini and for a lab's own sentences. Training is transformers' Trainer, the
adapter peft's (Hu et al. 2021); ours is only what goes in: the tokens are those that llama.cpp will
make of the same prompt, and the loss counts the answer's alone.
"""

import json
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from karma.errors import FileError, ModelError
from karma.files import LARGEST_LOG, read_bytes, to_json, unpack, write_atomic
from karma.models.llama.gguf_files import gguf_reader
from karma.plugins.training.gguf_tokenizer import read_gguf_tokenizer

_MATRICES = ("q_proj", "k_proj", "v_proj", "o_proj", "gate_proj", "up_proj", "down_proj")
_IGNORED = -100  # a label that the loss leaves out
ADAPTER, ADAPTER_CONFIG = "adapter_model.safetensors", "adapter_config.json"  # peft's own names


@dataclass(frozen=True, slots=True, kw_only=True)
class TuningRecipe:
    """Parameters of the adapter and its training."""

    seed: int = 0
    rank: int = 24  # of the update of each matrix; 24 of SmolLM2-135M are 14.7 MB
    alpha: int = 48  # the update counts alpha / rank times
    rate: float = 2e-3  # learning rate at its highest; it falls to zero
    warmup: int = 60  # steps in which it rises
    steps: int = 0  # 0: once over the examples
    tokens: int = 32_768  # a step, padding counted
    every: int = 500  # steps between checkpoints


@dataclass(frozen=True, slots=True, kw_only=True)
class EncodedExample:
    """An example as tokens: prompt, answer and end token."""

    tokens: tuple[int, ...]
    prompt: int  # so many of them are the prompt


def tune_file(
    weights: Path,
    examples: Path,
    folder: Path,
    recipe: TuningRecipe,
    *,
    watched: Path | None = None,
) -> dict[str, float]:
    """Tune a GGUF on a file of examples; see `tune`.

    FileError if a file cannot be read, or a line is no example; ModelError if transformers
    cannot read the weights, or peft is not installed.
    """
    if find_spec("peft") is None:
        fix = 'pip install "karma-offline[training]", or `make setup`'
        raise ModelError(f"tuning needs peft, which is not installed\n  To fix: {fix}")
    tokenizer, end = read_gguf_tokenizer(weights), end_token(weights)
    given = encode(read_examples(examples), tokenizer, end)
    kept = encode(read_examples(watched), tokenizer, end) if watched is not None else []
    return tune(
        base_model(weights),
        batches_of(given, recipe.tokens, recipe.seed),
        folder,
        recipe,
        watched=batches_of(kept, recipe.tokens // 4, 0) if kept else (),
    )


def end_token(weights: Path) -> int:
    """Return the token that ends an answer of a GGUF."""
    return int(gguf_reader(weights).fields["tokenizer.ggml.eos_token_id"].contents())


def read_examples(path: Path) -> Iterator[tuple[str, str, str]]:
    """Yield (stable prompt, changing prompt, answer) of each line of a JSONL file.

    A line is `{"prompt": [STABLE, CHANGING], "answer": TEXT}`; other keys are left alone.
    FileError if it is missing, or a line is not so; names the line.
    """
    data = read_bytes(path, most=LARGEST_LOG)
    if path.suffix == ".gz":
        data = unpack(data, path=path, most=LARGEST_LOG)
    for number, line in enumerate(data.splitlines(), start=1):
        try:
            found = json.loads(line)
            (stable, changing), answer = found["prompt"], found["answer"]
        except (ValueError, KeyError, TypeError) as error:
            shape = '{"prompt": [STABLE, CHANGING], "answer": TEXT}'
            raise FileError(path, f"line {number} is no {shape}: {error!r}") from error
        yield stable, changing, answer


def encode(
    examples: Iterator[tuple[str, str, str]], tokenizer: Any, end: int
) -> list[EncodedExample]:
    """Return examples as tokens, each part split for itself, as `LlamaModel` does."""
    found = []
    rooms: dict[str, list[int]] = {}
    for stable, changing, answer in examples:
        if stable not in rooms:
            rooms[stable] = tokenizer.encode(stable).ids
        prompt = [*rooms[stable], *tokenizer.encode(changing).ids]
        tokens = (*prompt, *tokenizer.encode(answer).ids, end)
        found.append(EncodedExample(tokens=tokens, prompt=len(prompt)))
    return found


def batches_of(
    examples: Sequence[EncodedExample], tokens: int, seed: int
) -> list[Sequence[EncodedExample]]:
    """Return examples in batches of like length, padded to at most so many tokens, shuffled."""
    draw = random.Random(seed)
    ordered = sorted(examples, key=lambda example: (len(example.tokens), draw.random()))
    batches: list[Sequence[EncodedExample]] = []
    batch: list[EncodedExample] = []
    for example in ordered:
        if batch and (len(batch) + 1) * len(example.tokens) > tokens:
            batches.append(batch)
            batch = []
        batch.append(example)
    batches.append(batch)
    draw.shuffle(batches)
    return batches


def collate(batch: Sequence[EncodedExample]) -> dict[str, Any]:
    """Return a batch as tensors, padded on the right, where causal attention ignores it.

    Logits are wanted, and labels given, from where the first answer begins: a vocabulary of 49,152
    is most of what a step of a small model costs.
    """
    import torch

    width = max(len(example.tokens) for example in batch)
    first = min(example.prompt for example in batch) - 1
    tokens = np.zeros((len(batch), width), np.int64)
    labels = np.full((len(batch), width), _IGNORED, np.int64)
    for row, example in enumerate(batch):
        tokens[row, : len(example.tokens)] = example.tokens
        labels[row, example.prompt : len(example.tokens)] = example.tokens[example.prompt :]
    return {
        "input_ids": torch.from_numpy(tokens),
        "labels": torch.from_numpy(labels[:, first:]),
        "logits_to_keep": torch.arange(first, width),
    }


def base_model(path: Path) -> Any:
    """Return a GGUF's weights as a transformers model in float32; llama and qwen2.

    ModelError if transformers cannot read it.
    """
    import torch
    from transformers import AutoModelForCausalLM

    try:
        read = AutoModelForCausalLM.from_pretrained(
            path.parent, gguf_file=path.name, dtype=torch.float32
        )
    except (OSError, ValueError, KeyError) as error:
        raise ModelError(f"{path}: transformers cannot read it: {error}") from error
    config = {k: v for k, v in read.config.to_dict().items() if k != "quantization_config"}
    model = type(read)(type(read.config).from_dict(config))  # a plain model, which can be trained
    model.load_state_dict(read.state_dict())
    model.tie_weights()
    return model


def tune(
    model: Any,
    batches: Sequence[Sequence[EncodedExample]],
    folder: Path,
    recipe: TuningRecipe,
    *,
    watched: Sequence[Sequence[EncodedExample]] = (),
) -> dict[str, float]:
    """Train an adapter, or go on from the last checkpoint in the folder, and write it there.

    `folder` takes the adapter in half precision, checkpoints and the log; `watched` batches are not
    trained on.

    Returns:
        Loss and share of answers right to the letter, of what is watched.
    """
    import torch
    from peft import LoraConfig, get_peft_model
    from transformers import Trainer, TrainingArguments
    from transformers.trainer_utils import get_last_checkpoint

    gpu = torch.cuda.is_available()
    half = gpu or _has_bfloat16()
    torch.manual_seed(recipe.seed)
    lora = LoraConfig(r=recipe.rank, lora_alpha=recipe.alpha, target_modules=list(_MATRICES))
    adapted = get_peft_model(model, lora)
    adapted.config.use_cache = False
    folder.mkdir(parents=True, exist_ok=True)
    arguments = TrainingArguments(
        output_dir=str(folder),
        per_device_train_batch_size=1,  # each is a whole batch already
        max_steps=recipe.steps or len(batches),
        learning_rate=recipe.rate,
        lr_scheduler_type="cosine",
        warmup_steps=recipe.warmup,
        adam_beta2=0.98,
        max_grad_norm=1.0,
        bf16=half,
        tf32=gpu or None,
        use_cpu=not gpu,
        optim="adamw_torch_fused" if gpu else "adamw_torch",
        logging_steps=20,
        save_steps=recipe.every,
        save_total_limit=1,
        save_only_model=False,
        dataloader_num_workers=4 if gpu else 0,
        remove_unused_columns=False,
        report_to=[],
        seed=recipe.seed,
    )
    trainer = Trainer(
        model=adapted, args=arguments, train_dataset=list(batches), data_collator=_only
    )
    trainer.train(resume_from_checkpoint=get_last_checkpoint(str(folder)))
    found = score(adapted, watched, half=half) if watched else {}
    _write_adapter(adapted, folder)
    write_atomic(folder / "tuning.json", to_json(trainer.state.log_history, indent=1))
    return found


def _has_bfloat16() -> bool:
    """Return whether the processor multiplies in bfloat16; elsewhere that is ten times slower."""
    try:
        return "avx512_bf16" in Path("/proc/cpuinfo").read_text()
    except OSError:
        return False


def _only(batch: Sequence[Sequence[EncodedExample]]) -> dict[str, Any]:
    return collate(batch[0])


def score(
    model: Any, batches: Sequence[Sequence[EncodedExample]], *, half: bool
) -> dict[str, float]:
    """Return the mean loss of answers' tokens, and the share of answers whose every token leads."""
    import torch

    model.eval()
    loss, tokens, right, total = 0.0, 0, 0, 0
    for batch in batches:
        given = {name: value.to(model.device) for name, value in collate(batch).items()}
        with torch.no_grad(), torch.autocast(model.device.type, torch.bfloat16, enabled=half):
            kept = given["logits_to_keep"]
            found = model(input_ids=given["input_ids"], logits_to_keep=kept)
        logits = found.logits[:, :-1].float()
        labels = given["labels"][:, 1:]
        counted = labels != _IGNORED
        loss += float(
            torch.nn.functional.cross_entropy(logits[counted], labels[counted], reduction="sum")
        )
        tokens += int(counted.sum())
        right += int(((logits.argmax(-1) == labels) | ~counted).all(-1).sum())
        total += len(batch)
    return {"loss": loss / tokens, "exact": right / total, "examples": float(total)}


def _write_adapter(adapted: Any, folder: Path) -> None:
    """Write the adapter as peft reads it, in half precision."""
    import torch
    from peft import get_peft_model_state_dict
    from safetensors.torch import save

    state = get_peft_model_state_dict(adapted)
    halves = {
        name: value.detach().cpu().to(torch.float16).contiguous() for name, value in state.items()
    }
    write_atomic(folder / ADAPTER, save(halves))
    config = adapted.peft_config["default"]
    config.base_model_name_or_path = None  # no hub id is ever resolved
    kept = {"peft_type": "LORA", "task_type": "CAUSAL_LM", "r": config.r,
            "lora_alpha": config.lora_alpha, "target_modules": sorted(_MATRICES),
            "base_model_name_or_path": None}  # fmt: skip
    write_atomic(folder / ADAPTER_CONFIG, to_json(kept, indent=2))
