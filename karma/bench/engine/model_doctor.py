"""See what each model of an experiment runs on here, its memory and speed, and what would help.

Each one is opened as a run opens it, and asked a little: a planner reads a prompt of random words
and says a few tokens, an embedder gets some texts, a vision model a grey picture.
"""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from karma import registry
from karma.bench.engine.workers import listed_mb
from karma.errors import KarmaError, ModelError
from karma.loading.models import OPENAI, Models, check_asked, filled, language_model
from karma.loading.names import opened_as
from karma.models.checks.gguf import check_gguf
from karma.models.checks.memory import gguf_parts_mb
from karma.models.llama.gguf_model import GgufModel
from karma.models.manifest import ModelEntry, resolve_planner
from karma.models.session import Session
from karma.types.observation import SeenObject

_PROMPT, _ANSWER = 512, 24  # tokens that a planner's speed is measured with
_FULL = 2821  # tokens of the largest prompt of the full profile, and of an answer
_TEXTS = 8
_FRAME = np.full((300, 300, 3), 128, np.uint8)


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelSeen:
    """One model of an experiment, and what was seen of it; None: not known or not measured."""

    role: str
    name: str
    device: str = ""  # as llama.cpp or torch calls it
    how: str = ""  # layers, kernels, numbers
    memory_mb: float | None = None  # predicted
    speeds: Mapping[str, float] | None = None  # unit -> how many of it in a second
    context: int | None = None  # tokens that it has now
    limit: int | None = None  # that it may grow to
    advice: tuple[str, ...] = ()
    error: str = ""


def tried(entry: ModelEntry, folder: Path) -> ModelSeen | None:
    """Open a model as a run does in its role, and ask it a little; None: it fills no role.

    It need not be listed yet; its files lie in the folder.

    Raises:
        ModelError: it does not open, or does not answer; whatever a library raised.
    """
    try:
        if entry.role == "planner":
            file = folder / Path(entry.files[0].path).name
            profile = entry.prompt_profile or ""
            return _planner(Models(planner=str(file), chat=entry.chat, profile=profile))
        for key, plural, ask in _ROLES:
            name = opened_as(plural, entry, str(folder))
            if name:
                return _torch(key, plural, ask, Models().computed_by({key: name}))
    except KarmaError:
        raise
    except Exception as error:  # a file that fits its header may still be anything
        why = str(error).splitlines() or [""]
        raise ModelError(
            f"{entry.name!r} does not run as {entry.role}: {type(error).__name__}: {why[0]}\n"
            "  To fix: another --role, or another file"
        ) from error
    return None


def examine(models: Models) -> Iterator[tuple[str, Callable[[], ModelSeen | None]]]:
    """Yield for each role its model's name, and what looks at it: None where nothing computes."""
    looks: dict[str, Callable[[Models], ModelSeen | None]] = {"planner": _planner}
    looks |= {role: partial(_torch, role, plural, ask) for role, plural, ask in _ROLES}
    for role, look in looks.items():
        name = getattr(models, role)
        if name or role == "planner":
            yield f"{role} {name}", partial(_safely, role, name, models, look)


def _safely(
    role: str, name: str, models: Models, look: Callable[[Models], ModelSeen | None]
) -> ModelSeen | None:
    """Return what was found, or the error as a finding: the others are looked at all the same."""
    if name.partition(":")[0] == OPENAI:
        return ModelSeen(role=role, name=getattr(models.hosted, role).model, device="hosted")
    try:
        return look(models)
    except KarmaError as error:
        return ModelSeen(role=role, name=name, error=str(error))


# ----------------------------------------------------------------- planners


def _planner(models: Models) -> ModelSeen:
    file = resolve_planner(models.planner)
    model: Any = language_model(models, Session(), 0)[0]
    profile = models.profile or file.prompt_profile
    try:
        check_asked(model, profile)
        gguf: GgufModel = model.gguf
        speeds, engine = _speeds(gguf), gguf.engine
        metadata = check_gguf(Path(file.path))
        predicted = gguf_parts_mb(
            Path(file.path), metadata, context=gguf.n_ctx, batch=gguf.n_batch,
        )  # fmt: skip
        on_gpu = engine.gpu_layers > 0
        layers = f"{engine.gpu_layers} of {gguf.size.blocks + 1} layers, " if on_gpu else ""
        flash = "on" if engine.flash_attention else "off"
        advice = []
        if profile == "full" and gguf.limit < _FULL:
            advice.append(
                f"its context of {gguf.limit} does not hold the longest prompts of the full "
                f"profile with an answer ({_FULL} tokens): "
                'profile = "compact", or another n_ctx or model'
            )
        return ModelSeen(
            role="planner", name=file.name, device=engine.device,
            how=f"{layers}{engine.kv} KV, flash attention {flash}, "
            f"{engine.threads} thread{'s' * (engine.threads > 1)}"
            + (f", {model.manner}" if model.manner else ""),
            memory_mb=predicted, speeds=speeds,
            context=gguf.n_ctx, limit=gguf.limit, advice=tuple(advice),
        )  # fmt: skip
    finally:
        model.close()


def _speeds(gguf: GgufModel) -> dict[str, float]:
    """Measure how fast a prompt is read and an answer is said, in tokens a second."""
    prompt = min(_PROMPT, gguf.limit // 2)
    answer = min(_ANSWER, gguf.limit - prompt)
    tokens = np.random.default_rng(0).integers(0, gguf.vocabulary, prompt).tolist()
    gguf.make_room(prompt + answer)
    gguf.evaluate([tokens[:8]])  # weights come from the disk now
    _, read_s = _timed(lambda: (gguf.evaluate([tokens]), gguf.logits()))  # a GPU is waited for

    def say() -> None:
        for token in tokens[:answer]:
            gguf.extend([token])
            gguf.logits()

    _, said_s = _timed(say)
    return {"prefill tokens/s": prompt / read_s, "decode tokens/s": answer / said_s}


# ----------------------------------------------------------------- torch models


def _torch(
    role: str, plural: str, ask: Callable[[Any], dict[str, float]], models: Models
) -> ModelSeen | None:
    name = getattr(models, role)
    if not hasattr(registry.load(plural, name.partition(":")[0]), "computed_on"):
        return None
    model = filled(plural, name, None, Session(), models)
    speeds = ask(model)
    device, _, numbers = model.computed_on.partition(", ")
    return ModelSeen(
        role=role, name=model.name, device=device, how=numbers, speeds=speeds,
        memory_mb=listed_mb(name.partition(":")[2] or model.name),
    )  # fmt: skip


def _embedder(model: Any) -> dict[str, float]:
    model.embed(["warm"])
    texts = [f"a clean mug on shelf {number}" for number in range(_TEXTS)]
    _, seconds = _timed(lambda: model.embed(texts))
    return {"texts/s": len(texts) / seconds}


def _vision(model: Any) -> dict[str, float]:
    cup = SeenObject(
        object_id="Cup|1", object_type="Cup", position_m=(0, 0, 0), box_center_m=(0, 0, 0),
        box_size_m=(1, 1, 1), pickupable=True, region=(100.0, 100.0, 160.0, 180.0),
    )  # fmt: skip
    _, seconds = _timed(lambda: model.read_states(_FRAME, "wash the cup", [cup]))
    return {"pictures/s": 1 / seconds}


_ROLES: Sequence[tuple[str, str, Callable[[Any], dict[str, float]]]] = (
    ("embedder", "embedders", _embedder),
    ("vision", "vision_models", _vision),
)


# ----------------------------------------------------------------- measuring


def _timed(call: Callable[[], Any]) -> tuple[Any, float]:
    begun = time.perf_counter()
    found = call()
    return found, time.perf_counter() - begun
