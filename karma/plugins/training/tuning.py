"""Tune the weights of a GGUF on examples: a LoRA adapter, which `gguf_files` puts back into a GGUF.

One recipe for karma-mini, tool mode and a lab's own examples. Training is transformers' Trainer,
the adapter peft's (Hu et al. 2021). The project's own part is the input: tokens are those of the
same prompts at inference, by the same code, and the loss counts answers alone.
"""

import json
import random
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from karma.errors import FileError, ModelError
from karma.files import LARGEST_LOG, read_bytes, to_json, unpack, write_atomic
from karma.models.llama.model import LlamaModel
from karma.models.llama.opening import LlamaOptions
from karma.types.planning import Prompt

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
    every: int = 200  # steps between checkpoints
    minutes: float = 0.0  # after which it stops at a checkpoint; 0: no bound


class Turn(NamedTuple):
    """A message of the user and the answer; the loss leaves out an answer that does not count."""

    user: str
    answer: str
    counts: bool = True


Chat = tuple[str, Sequence[Turn]]  # system message, turns


@dataclass(frozen=True, slots=True, kw_only=True)
class EncodedExample:
    """An example as tokens, and from where to where its answers go, end tokens included."""

    tokens: tuple[int, ...]
    answers: tuple[tuple[int, int], ...]


def tune_file(
    weights: Path,
    examples: Path,
    folder: Path,
    recipe: TuningRecipe,
    *,
    watched: Path | None = None,
    plain: bool = False,
) -> dict[str, float]:
    """Tune a GGUF on a file of chats, `plain` without its chat template; see `tune`.

    FileError if a file cannot be read, or a line is no chat; ModelError if the weights cannot be
    read or have no chat template, or peft is not installed.
    """
    begun_s = time.monotonic()
    if find_spec("peft") is None:
        fix = 'pip install "karma-offline[training]", or `make setup`'
        raise ModelError(f"tuning needs peft, which is not installed\n  To fix: {fix}")
    model = LlamaModel(weights, chat=not plain, options=LlamaOptions(gpu_layers=0))
    given = list(encode(read_chats(examples), model))
    seen = list(encode(read_chats(watched), model)) if watched is not None else []
    model.close()
    if not given:
        raise FileError(examples, "there is no answer to learn in it")
    return tune(
        base_model(weights),
        batches_of(given, recipe.tokens, recipe.seed),
        folder,
        recipe,
        watched=batches_of(seen, recipe.tokens // 4, 0) if seen else (),
        begun_s=begun_s,
    )


def read_chats(path: Path) -> Iterator[Chat]:
    """Yield the chats of a JSONL file: `{"messages": [...]}`, as OpenAI's fine-tuning has them.

    After an optional system message users and assistants take turns; an answer with `"weight": 0`
    is not to be learned. FileError if the file is missing, or a line is not such; names the line.
    """
    data = read_bytes(path, most=LARGEST_LOG)
    if path.suffix == ".gz":
        data = unpack(data, path=path, most=LARGEST_LOG)
    for number, line in enumerate(data.splitlines(), start=1):
        try:
            messages = json.loads(line)["messages"]
            has_system = messages[0]["role"] == "system"
            users, answers = messages[has_system::2], messages[has_system + 1 :: 2]
            roles = [message["role"] for message in messages[has_system:]]
            if roles != ["user", "assistant"] * len(answers) or not answers:
                raise ValueError(f"roles {roles}")
            turns = [
                Turn(user["content"], answer["content"], bool(answer.get("weight", 1)))
                for user, answer in zip(users, answers, strict=True)
            ]
        except (ValueError, LookupError, TypeError) as error:
            shape = '{"messages": [...]}'
            raise FileError(path, f"line {number} is no {shape}: {error!r}") from error
        yield messages[0]["content"] if has_system else "", turns


def encode(chats: Iterable[Chat], model: LlamaModel) -> Iterator[EncodedExample]:
    """Yield chats as tokens: those of which the model's prompts and answers consist.

    Where the template writes an earlier answer otherwise than it was given, what follows is an
    example of its own.
    """
    for stable, turns in chats:
        tokens: list[int] = []
        answers: list[tuple[int, int]] = []
        for number, turn in enumerate(turns):
            earlier = tuple((one.user, one.answer) for one in turns[:number])
            prompt = Prompt(stable=stable, turns=earlier, changing=turn.user)
            before = list(chain(*model.segments(prompt)))
            if before[: len(tokens)] != tokens and answers:
                yield EncodedExample(tokens=tuple(tokens), answers=tuple(answers))
                answers = []
            tokens = [*before, *model.gguf.tokens(turn.answer), model.gguf.end_token]
            if turn.counts:
                answers.append((len(before), len(tokens)))
        if answers:
            yield EncodedExample(tokens=tuple(tokens), answers=tuple(answers))


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
    first = min(example.answers[0][0] for example in batch) - 1
    tokens = np.zeros((len(batch), width), np.int64)
    labels = np.full((len(batch), width), _IGNORED, np.int64)
    for row, example in enumerate(batch):
        tokens[row, : len(example.tokens)] = example.tokens
        for start, stop in example.answers:
            labels[row, start:stop] = example.tokens[start:stop]
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
    begun_s: float | None = None,
) -> dict[str, float]:
    """Train an adapter, or resume from the last checkpoint in the folder, and write it there.

    `folder` takes the adapter in half precision, checkpoints and the log; `watched` batches are not
    trained on. `begun_s`: when the recipe's minutes began, by the monotonic clock; None: now.

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
    adapted = get_peft_model(model.to(torch.bfloat16) if gpu else model, lora)  # adapter: float32
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
        model=adapted, args=arguments, train_dataset=list(batches), data_collator=_only,
        callbacks=[_clock(time.monotonic() if begun_s is None else begun_s, recipe.minutes)],
    )  # fmt: skip
    trainer.train(resume_from_checkpoint=get_last_checkpoint(str(folder)))
    found = score(adapted, watched, half=half) if watched else {}
    _write_adapter(adapted, folder)
    write_atomic(folder / "tuning.json", to_json(trainer.state.log_history, indent=1))
    return found


def _clock(begun_s: float, minutes: float) -> Any:
    """Return a callback of the Trainer that stops it, with a checkpoint, when time is up."""
    from transformers import TrainerCallback

    class Clock(TrainerCallback):  # type: ignore[misc]
        def on_step_end(self, args: Any, state: Any, control: Any, **_: Any) -> None:
            if minutes and time.monotonic() - begun_s > 60 * minutes:
                control.should_save = control.should_training_stop = True

    return Clock()


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
