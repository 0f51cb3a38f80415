"""The nano planner's network: a small Llama, its first weights, and its way through a pack."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from karma.contracts import Embedder
from karma.seeds import stream
from karma.training.planner.packs import PlannerRecipe
from karma.training.planner.samples import TrainingExample

EVEN = 256  # tokens, and in bfloat16 targets, come in multiples of it
BLOCK = 12  # examples whose attention is computed at once


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Batch:
    """Packs end to end, n tokens of which the last few are padding, and how examples attend.

    Attention sees every example as a row of its own, stable text first: m places in blocks of rows
    of a like width, in which only what comes before is seen. Stable text stands in several rows.
    """

    tokens: Any  # (n,)
    positions: Any  # (n,)
    targets: Any  # (n,) the token that follows where it belongs to a program, else -100
    rows: Any  # (m,) the token that stands at each place of the rows; padding at what is left
    home: Any  # (n,) the first place at which a token stands; 0 for padding
    at_home: Any  # (m, 1) whether a place is its token's first
    again: Any  # (k,) the places that are not
    shapes: tuple[tuple[int, int], ...]  # rows and width of each block

    def to(self, device: str) -> "Batch":
        """Return the batch on a device."""
        return Batch(
            shapes=self.shapes,
            **{
                f.name: getattr(self, f.name).to(device) for f in fields(self) if f.name != "shapes"
            },
        )


def collate(packs: Sequence[Sequence[TrainingExample]], tokenizer: Any) -> Batch:
    """Turn packs into tensors."""
    import torch

    tokens, positions, targets = list[int](), list[int](), list[int]()
    rows: list[NDArray[np.int64]] = []
    for pack in packs:
        ids, places, group, target = _row(pack, tokenizer)
        of = np.array(group)
        for number in range(1, len(pack) + 1):
            rows.append(np.flatnonzero((of == 0) | (of == number)) + len(tokens))
        tokens, positions, targets = tokens + ids, positions + places, targets + target
    size = len(tokens)
    more = EVEN - size % EVEN  # few shapes: every new one costs oneDNN a kernel, and memory for it
    spread, shapes = _blocks(rows, padding=size)
    first = np.unique(spread, return_index=True)
    home = np.zeros(size + more, dtype=np.int64)
    home[:size] = first[1][:size]
    at_home = np.zeros((len(spread), 1), dtype=bool)
    at_home[home[:size]] = True
    return Batch(
        tokens=torch.tensor(tokens + [1] * more),
        positions=torch.tensor(positions + [0] * more),
        targets=torch.tensor(targets + [-100] * more),
        rows=torch.from_numpy(spread),
        home=torch.from_numpy(home),
        at_home=torch.from_numpy(at_home),
        again=torch.from_numpy(np.flatnonzero(~at_home[:, 0] & (spread < size))),
        shapes=shapes,
    )


def _blocks(
    rows: list[NDArray[np.int64]], padding: int
) -> tuple[NDArray[np.int64], tuple[tuple[int, int], ...]]:
    """Return rows of a like length in blocks, one after another, and the blocks' shapes."""
    rows = sorted(rows, key=len)
    found, shapes = [], []
    for start in range(0, len(rows), BLOCK):
        part = rows[start : start + BLOCK]
        block = np.full((BLOCK, -(-len(part[-1]) // 16) * 16), padding, dtype=np.int64)
        for number, row in enumerate(part):
            block[number, : len(row)] = row
        found.append(block.ravel())
        shapes.append(block.shape)
    return np.concatenate(found), tuple(shapes)


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


def forward(model: Any, batch: Batch, *, half: bool = False) -> tuple[Any, Any]:
    """Return logits at the places that count, shape (n, vocabulary), and their targets (n,).

    Args:
        model: a `LlamaForCausalLM` with tied embeddings; its own forward is not used, as this one
            computes the same in fewer passes over memory, and hardly any padding.
        batch: of `collate`.
        half: matrices in bfloat16; weights stay float32.
    """
    import torch

    kind = torch.bfloat16 if half else torch.float32
    config, core = model.config, model.model
    table = core.embed_tokens.weight.to(kind)
    flow = torch.nn.functional.embedding(batch.tokens, table)
    turns = _turns(batch.positions, config, kind)
    counts = torch.nonzero(batch.targets != -100).flatten()
    wanted = batch.targets[counts]
    if half:
        more = -len(counts) % EVEN
        counts = torch.cat([counts, counts[:1].expand(more)])
        wanted = torch.nn.functional.pad(wanted, (0, more), value=-100)
    for layer in core.layers:
        flow = flow + _attention(layer, flow, turns, batch, config)
        if layer is core.layers[-1]:
            flow = flow[counts]  # no one looks at the others any more
        flow = flow + _feed_forward(layer, flow, config)
    last = _norm(flow, core.norm, config)
    return (last @ table.T).float(), wanted


def _norm(flow: Any, norm: Any, config: Any) -> Any:
    import torch

    weight = norm.weight.to(flow.dtype)
    return torch.nn.functional.rms_norm(flow, weight.shape, weight, config.rms_norm_eps)


def _turns(positions: Any, config: Any, kind: Any) -> tuple[Any, Any]:
    """Return cosines and sines of the rotary embedding, each (n, 1, half a head)."""
    import torch

    size = config.hidden_size // config.num_attention_heads
    steps = torch.arange(0, size, 2, device=positions.device, dtype=torch.float32) / size
    base = config.rope_parameters["rope_theta"]
    angles = positions[:, None, None].float() * (1.0 / base**steps)
    return angles.cos().to(kind), angles.sin().to(kind)


def _attention(layer: Any, flow: Any, turns: tuple[Any, Any], batch: Batch, config: Any) -> Any:
    import torch

    part, heads, size = layer.self_attn, config.num_attention_heads, config.hidden_size
    weight = torch.cat([part.q_proj.weight, part.k_proj.weight, part.v_proj.weight])
    rows = _norm(flow, layer.input_layernorm, config) @ weight.to(flow.dtype).T
    near, value = rows.split([2 * size, size], dim=-1)
    near = _turned(near.view(len(rows), 2 * heads, -1), turns).view(len(rows), -1)
    spread = _moves().spread(torch.cat([near, value], dim=-1), batch)
    found = []
    for (count, width), block in zip(
        batch.shapes, spread.split([c * w for c, w in batch.shapes]), strict=True
    ):
        query, key, value = block.view(count, width, 3, heads, -1).permute(2, 0, 3, 1, 4)
        later = torch.full((width, width), -1e9, dtype=flow.dtype, device=flow.device).triu(1)
        close = (query * query.shape[-1] ** -0.5) @ key.transpose(-1, -2)
        seen = (
            torch.softmax(close + later, dim=-1) @ value
        )  # torch's own kernel is slower backwards
        found.append(seen.transpose(1, 2).reshape(count * width, -1))
    return _moves().gather(torch.cat(found), batch) @ part.o_proj.weight.to(flow.dtype).T


class _Moves(NamedTuple):
    """The ways between tokens (n, size) and the places of attention's rows (m, size)."""

    spread: Any
    gather: Any


@cache
def _moves() -> _Moves:
    """Return both, with backward passes of their own: torch's add row by row."""
    import torch

    class Spread(torch.autograd.Function):
        @staticmethod
        def forward(ctx: Any, flat: Any, batch: Batch) -> Any:
            ctx.batch = batch
            return flat.index_select(0, batch.rows)

        @staticmethod
        def backward(ctx: Any, *grads: Any) -> Any:
            batch, grad = ctx.batch, grads[0]
            found = grad.index_select(0, batch.home)
            found.index_add_(0, batch.rows[batch.again], grad.index_select(0, batch.again))
            return found.masked_fill_((batch.tokens == 1)[:, None], 0), None

    class Gather(torch.autograd.Function):
        @staticmethod
        def forward(ctx: Any, rows: Any, batch: Batch) -> Any:
            ctx.batch = batch
            return rows.index_select(0, batch.home)

        @staticmethod
        def backward(ctx: Any, *grads: Any) -> Any:
            return grads[0].index_select(0, ctx.batch.rows) * ctx.batch.at_home, None

    return _Moves(Spread.apply, Gather.apply)


def _turned(rows: Any, turns: tuple[Any, Any]) -> Any:
    import torch

    first, second = rows.chunk(2, dim=-1)
    cosine, sine = turns
    return torch.cat([first * cosine - second * sine, second * cosine + first * sine], dim=-1)


def _feed_forward(layer: Any, flow: Any, config: Any) -> Any:
    import torch

    part = layer.mlp
    rows = _norm(flow, layer.post_attention_layernorm, config)
    weight = torch.cat([part.gate_proj.weight, part.up_proj.weight]).to(flow.dtype)
    gate, up = (rows @ weight.T).chunk(2, dim=-1)
    return (torch.nn.functional.silu(gate) * up) @ part.down_proj.weight.to(flow.dtype).T
