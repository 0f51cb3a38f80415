"""The nano planner's network: a small Llama, its first weights, and its way through a pack."""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from karma.contracts import Embedder
from karma.seeds import stream
from karma.training.planner.packs import PlannerRecipe
from karma.training.planner.samples import TrainingExample

EVEN = 256  # targets per step come in multiples of it in bfloat16


def first_embeddings(
    recipe: PlannerRecipe, tokenizer: Any, embedder: Embedder
) -> NDArray[np.float32]:
    """Return token embeddings to start from, shape (vocabulary, hidden).

    What a token spells is embedded as text and projected to its principal directions, so that
    `Tomato`, `tomato` and, less so, `ripe fruit` start near each other; plus noise of half the
    length, which is all that tokens without letters get.
    """
    rng = stream(recipe.seed, "planner", "embeddings")
    size = tokenizer.get_vocab_size()
    words = [_spelt(tokenizer.decode([i], skip_special_tokens=False)) for i in range(size)]
    distinct = sorted({word for word in words if word})
    rows = embedder.embed(distinct)
    rows = rows - rows.mean(axis=0)
    _, _, directions = np.linalg.svd(rows, full_matrices=False)
    flat = rows @ directions[: recipe.hidden].T
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    place = {word: number for number, word in enumerate(distinct)}
    noise = rng.standard_normal((size, recipe.hidden)) / np.sqrt(recipe.hidden)
    found = 0.5 * noise
    for token, word in enumerate(words):
        if word:
            found[token] += flat[place[word]]
    return np.asarray(found * 0.02 * np.sqrt(recipe.hidden), dtype=np.float32)


def _spelt(text: str) -> str:
    """Return the lower-case words a token spells: "CounterTop" is "counter top"."""
    return " ".join(re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", text)).lower()


def new_model(recipe: PlannerRecipe, embeddings: NDArray[np.float32] | None = None) -> Any:
    """Return a Llama with random weights drawn from the recipe's seed.

    Args:
        recipe: sizes and seed.
        embeddings: token embeddings to start from, shape (vocabulary, hidden).
    """
    import torch
    from transformers import LlamaConfig, LlamaForCausalLM

    config = LlamaConfig(
        vocab_size=recipe.vocabulary,
        hidden_size=recipe.hidden,
        num_hidden_layers=recipe.layers,
        num_attention_heads=recipe.heads,
        num_key_value_heads=recipe.heads,
        intermediate_size=recipe.feed_forward,
        max_position_embeddings=recipe.context,
        tie_word_embeddings=True,
        bos_token_id=None,
        eos_token_id=0,
        pad_token_id=1,
    )
    with torch.random.fork_rng():
        torch.manual_seed(recipe.seed)
        model = LlamaForCausalLM(config)
    if embeddings is not None:
        with torch.no_grad():
            model.model.embed_tokens.weight.copy_(torch.from_numpy(embeddings))
    return model


def collate(packs: Sequence[Sequence[TrainingExample]], tokenizer: Any) -> dict[str, Any]:
    """Turn packs into tensors.

    Returns:
        tokens (b, t), positions (b, t), mask (b, 1, t, t) bool, and targets (b, t): the token that
        follows where it belongs to a program, else -100.
    """
    import torch

    rows = [_row(pack, tokenizer) for pack in packs]
    width = -(-max(len(row[0]) for row in rows) // 32) * 32
    tokens = np.full((len(rows), width), 1, dtype=np.int64)
    positions = np.zeros((len(rows), width), dtype=np.int64)
    groups = np.full((len(rows), width), -1, dtype=np.int64)
    targets = np.full((len(rows), width), -100, dtype=np.int64)
    for number, (ids, places, group, target) in enumerate(rows):
        span = slice(0, len(ids))
        tokens[number, span], positions[number, span] = ids, places
        groups[number, span], targets[number, span] = group, target
    column = groups[:, None, :]
    seen = (column == 0) | (column == groups[:, :, None])
    mask = seen & np.tril(np.ones((width, width), dtype=bool))[None]
    return {
        "tokens": torch.from_numpy(tokens),
        "positions": torch.from_numpy(positions),
        "mask": torch.from_numpy(mask[:, None]),
        "targets": torch.from_numpy(targets),
    }


def _row(pack: Sequence[TrainingExample], tokenizer: Any) -> tuple[list[int], ...]:
    stable = tokenizer.encode(pack[0].stable, add_special_tokens=False).ids
    ids, places = list(stable), list(range(len(stable)))
    group, target = [0] * len(stable), [-100] * len(stable)
    for number, example in enumerate(pack, start=1):
        asked = tokenizer.encode(example.changing, add_special_tokens=False).ids
        answer = [*tokenizer.encode(example.program, add_special_tokens=False).ids, 0]
        part = asked + answer[:-1]
        ids += part
        places += range(len(stable), len(stable) + len(part))
        group += [number] * len(part)
        target += [-100] * (len(asked) - 1) + answer
    return ids, places, group, target


def forward(model: Any, batch: dict[str, Any], *, half: bool = False) -> tuple[Any, Any]:
    """Return logits at the places that count, shape (n, vocabulary), and their targets (n,).

    Args:
        model: a `LlamaForCausalLM` with tied embeddings; its own forward is not used, as this one
            computes the same in fewer passes over memory.
        batch: of `collate`.
        half: matrices in bfloat16; weights stay float32.
    """
    import torch

    kind = torch.bfloat16 if half else torch.float32
    config, core = model.config, model.model
    table = core.embed_tokens.weight.to(kind)
    flow = torch.nn.functional.embedding(batch["tokens"], table)
    turns = _turns(batch["positions"], config, kind)
    hidden = torch.zeros(batch["mask"].shape, dtype=kind, device=flow.device)
    hidden.masked_fill_(~batch["mask"], -1e9)
    for layer in core.layers:
        flow = flow + _attention(layer, flow, turns, hidden, config)
        flow = flow + _feed_forward(layer, flow, config)
    targets = batch["targets"].flatten()
    counts = torch.nonzero(targets != -100).flatten()
    wanted = targets[counts]
    if half:  # few shapes: every new one costs oneDNN a kernel, and memory for it
        more = -len(counts) % EVEN
        counts = torch.cat([counts, counts[:1].expand(more)])
        wanted = torch.nn.functional.pad(wanted, (0, more), value=-100)
    last = _norm(flow.flatten(0, 1)[counts], core.norm, config)
    return (last @ table.T).float(), wanted


def _norm(flow: Any, norm: Any, config: Any) -> Any:
    import torch

    weight = norm.weight.to(flow.dtype)
    return torch.nn.functional.rms_norm(flow, weight.shape, weight, config.rms_norm_eps)


def _turns(positions: Any, config: Any, kind: Any) -> tuple[Any, Any]:
    """Return cosines and sines of the rotary embedding, each (b, 1, t, head)."""
    import torch

    size = config.hidden_size // config.num_attention_heads
    steps = torch.arange(0, size, 2, device=positions.device, dtype=torch.float32) / size
    base = config.rope_parameters["rope_theta"]
    angles = positions[:, None, :, None].float() * (1.0 / base**steps)
    angles = torch.cat([angles, angles], dim=-1)
    return angles.cos().to(kind), angles.sin().to(kind)


def _attention(layer: Any, flow: Any, turns: tuple[Any, Any], hidden: Any, config: Any) -> Any:
    import torch

    part, heads = layer.self_attn, config.num_attention_heads
    weight = torch.cat([part.q_proj.weight, part.k_proj.weight, part.v_proj.weight])
    rows = _norm(flow, layer.input_layernorm, config) @ weight.to(flow.dtype).T
    b, t, _ = rows.shape
    query, key, value = rows.view(b, t, 3, heads, -1).permute(2, 0, 3, 1, 4)
    query = _turned(query, turns) * query.shape[-1] ** -0.5
    near = query @ _turned(key, turns).transpose(-1, -2)  # torch's own kernel is slower backwards
    found = torch.softmax(near + hidden, dim=-1) @ value
    found = found.transpose(1, 2).reshape(b, t, -1)
    return found @ part.o_proj.weight.to(flow.dtype).T


def _turned(rows: Any, turns: tuple[Any, Any]) -> Any:
    import torch

    first, second = rows.chunk(2, dim=-1)
    return rows * turns[0] + torch.cat([-second, first], dim=-1) * turns[1]


def _feed_forward(layer: Any, flow: Any, config: Any) -> Any:
    import torch

    part = layer.mlp
    rows = _norm(flow, layer.post_attention_layernorm, config)
    weight = torch.cat([part.gate_proj.weight, part.up_proj.weight]).to(flow.dtype)
    gate, up = (rows @ weight.T).chunk(2, dim=-1)
    return (torch.nn.functional.silu(gate) * up) @ part.down_proj.weight.to(flow.dtype).T
