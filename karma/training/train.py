"""Training the nano planner: packs of examples over one scene, a small Llama, resumable.

A pack is the scene's stable text once and several (memory, instruction, program) examples after it.
Each example attends to the stable text and itself only, at the positions it has when asked alone,
so a pack trains exactly what inference does. The loss counts program tokens only.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from karma.contracts import Embedder
from karma.errors import FileError
from karma.files import read_json, to_json, write_atomic
from karma.infer.gguf_export import new_tokenizer
from karma.program import SKILLS
from karma.prompt import landmark_types
from karma.seeds import stream
from karma.training.alfred import Sentence, StepSentence
from karma.training.phrases import Book
from karma.training.recollections import Room, pick
from karma.training.samples import Example, draw, draw_alfred, draw_step
from karma.world.types import object_types

END = "<|end|>"
PAD = "<|pad|>"
TYPES = tuple(sorted(object_types()))
PART = 3  # packs that are computed at once
EVEN = 256  # targets per step come in multiples of it in bfloat16
WHOLE = (
    *(f"{skill.name}(robot, '" for skill in SKILLS),
    "', '", "', ['", "'])\n", "')\n", " @", " *\n",
    "#areas\n", "#memory\n", "#held ", "#task ", "#program\n", "#error ",
    *(f"node_{number}" for number in range(1, 33)), *(f"_{number}" for number in range(2, 10)),
    *TYPES, *(f" {name}" for name in sorted(landmark_types())),
)  # pieces of the notation that are one token each, so names stand alone  # fmt: skip
_PIECES = re.compile("|".join(re.escape(text) for text in sorted(WHOLE, key=len, reverse=True)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Recipe:
    """All that decides the weights, besides the data."""

    seed: int = 0
    vocabulary: int = 4096
    hidden: int = 320
    layers: int = 6
    heads: int = 5
    feed_forward: int = 896
    context: int = 2048
    packs: int = 20  # per step
    examples: int = 4  # per pack with long-term memory; half as many more without it
    steps: int = 9000
    warmup: int = 200
    decay: float = 0.4  # share of the steps in which the learning rate falls to zero
    learning_rate: float = 1.2e-3
    weight_decay: float = 0.05
    mapped: float = 0.6  # share of packs with long-term memory
    alfred: tuple[float, float] = (0.4, 0.5)  # share of ALFRED's goals without and with it
    steps_said: float = 0.2  # share of what ALFRED's annotators said of single steps, without it
    plans: float = 0.4  # share of packs with long-term memory in rooms where ALFRED was recorded
    half: bool = False  # matrices in bfloat16, where the processor has instructions for it


@dataclass(frozen=True, kw_only=True)
class Data:
    """Where examples come from."""

    rooms: Sequence[Room]
    book: Book
    excluded: frozenset[tuple[str, str]]
    alfred: Sequence[Sentence] = ()
    steps: Sequence[StepSentence] = ()
    forbidden: frozenset[str] = frozenset()  # sentences of the tests, see `plain`

    @cached_property
    def recorded(self) -> Sequence[Room]:
        """The rooms in which a sentence of ALFRED's was said."""
        return tuple(room for room in self.rooms if self.said(room))

    def said(self, room: Room) -> Sequence[Sentence]:
        """Return ALFRED's sentences of a room."""
        return self._by_plan.get(room.name, ())

    @cached_property
    def _by_plan(self) -> Mapping[str, Sequence[Sentence]]:
        found: dict[str, list[Sentence]] = {}
        for sentence in self.alfred:
            found.setdefault(sentence.floor_plan, []).append(sentence)
        return found


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """One line of the training log."""

    step: int
    loss: float
    tokens: int
    exact: float | None  # held-out programs right to the letter, teacher-forced


def draw_pack(recipe: Recipe, data: Data, *name: str) -> list[Example]:
    """Draw one pack; equal names give equal packs."""
    rng = stream(recipe.seed, "planner", *name)
    mapped = bool(rng.random() < recipe.mapped)
    recorded = data.recorded if mapped and rng.random() < recipe.plans else ()
    room = pick(rng, recorded or data.rooms)
    said = data.said(room) if mapped else data.alfred
    found: list[Example] = []
    wanted = recipe.examples if mapped else recipe.examples * 3 // 2
    while len(found) < wanted:
        example: Example | None = None
        roll = rng.random()
        if said and roll < recipe.alfred[mapped]:
            example = draw_alfred(rng, room, said, mapped=mapped)
        elif data.steps and not mapped and roll > 1 - recipe.steps_said:
            example = draw_step(rng, room, data.steps)
        else:
            example = draw(rng, room, data.book, mapped=mapped, excluded=data.excluded)
        if example is not None and plain(_task(example)) not in data.forbidden:
            found.append(example)
    return found


def _task(example: Example) -> str:
    return example.changing.partition("\n")[0].removeprefix("#task ")


def plain(sentence: str) -> str:
    """Return a sentence as the leak test compares it: lower case, words only.

    >>> plain("Please, wash an apple.")
    'please wash an apple'
    """
    return " ".join(re.findall(r"[a-z0-9]+", sentence.lower()))


def corpus(recipe: Recipe, data: Data, packs: int) -> Iterator[str]:
    """Yield texts to train the tokenizer on."""
    for number in range(packs):
        pack = draw_pack(recipe, data, "corpus", str(number))
        yield pack[0].stable
        for example in pack:
            yield example.changing
            yield example.program


def make_tokenizer(recipe: Recipe, data: Data, packs: int) -> Any:
    """Train the tokenizer on the corpus, the notation's fixed pieces being tokens of their own."""
    from tokenizers import AddedToken

    bare = new_tokenizer(
        (piece for text in corpus(recipe, data, packs) for piece in _PIECES.split(text)),
        recipe.vocabulary - len(WHOLE),
        [END, PAD],
    )
    bare.add_tokens([AddedToken(text, normalized=False, special=False) for text in WHOLE])
    return bare


def first_embeddings(recipe: Recipe, tokenizer: Any, embedder: Embedder) -> NDArray[np.float32]:
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


def new_model(recipe: Recipe, embeddings: NDArray[np.float32] | None = None) -> Any:
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


def collate(packs: Sequence[Sequence[Example]], tokenizer: Any) -> dict[str, Any]:
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


def _row(pack: Sequence[Example], tokenizer: Any) -> tuple[list[int], ...]:
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


def exact_share(
    model: Any, tokenizer: Any, packs: Sequence[Sequence[Example]], device: str
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


def train(
    recipe: Recipe,
    data: Data,
    held_out: Sequence[Sequence[Example]],
    tokenizer: Any,
    folder: Path,
    *,
    device: str = "cpu",
    every: int = 200,
    share: tuple[int, int] = (0, 1),
    embeddings: NDArray[np.float32] | None = None,
) -> Iterator[Progress]:
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
    step, seen = _resume(folder, model, optimizers)
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
            _checkpoint(folder, model, optimizers, step, seen)
            yield Progress(step=step, loss=float(np.mean(losses)), tokens=seen, exact=exact)
            losses = []


def _optimizers(model: Any, recipe: Recipe) -> tuple[Any, ...]:
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


def _of_a_size(packs: Sequence[Sequence[Example]]) -> list[Sequence[Sequence[Example]]]:
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


def _schedule(recipe: Recipe, step: int) -> float:
    """Warm up, stay, decay: so that `steps` can still be changed on the way."""
    if step < recipe.warmup:
        return (step + 1) / recipe.warmup
    left = (recipe.steps - step) / max(1, int(recipe.decay * recipe.steps))
    return min(1.0, left)


def _to(batch: dict[str, Any], device: str) -> dict[str, Any]:
    return {name: tensor.to(device) for name, tensor in batch.items()}


# ----------------------------------------------------------------- checkpoints


@dataclass(frozen=True, slots=True, kw_only=True)
class _Saved:
    step: int
    tokens: int


def _checkpoint(
    folder: Path, model: Any, optimizers: Sequence[Any], step: int, tokens: int
) -> None:
    """Save weights and optimizer state as safetensors; the older checkpoint stays until then."""
    from safetensors.torch import save

    state = {f"model.{name}": value for name, value in model.named_parameters()}
    for name, value in model.named_parameters():
        for optimizer in optimizers:
            for moment, held in optimizer.state.get(value, {}).items():
                if moment != "step":
                    state[f"{moment}.{name}"] = held
    header = {"step": str(step), "tokens": str(tokens)}
    state = {name: value.detach().cpu().contiguous() for name, value in state.items()}
    write_atomic(folder / "checkpoint.safetensors", save(state, metadata=header))
    write_atomic(folder / "progress.json", to_json(_Saved(step=step, tokens=tokens)))


def _resume(folder: Path, model: Any, optimizers: Sequence[Any]) -> tuple[int, int]:
    """Load the last checkpoint into model and optimizer; return its step and token count."""
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


def load_weights(folder: Path, recipe: Recipe) -> Any:
    """Return the model of the last checkpoint, float32, in evaluation mode.

    Raises:
        FileError: there is none.
    """
    import torch
    from safetensors import safe_open

    path = folder / "checkpoint.safetensors"
    if not path.exists():
        raise FileError(path, "no checkpoint", fix="python scripts/train_planner.py")
    model = new_model(recipe)
    with safe_open(path, "pt") as saved, torch.no_grad():
        for name, value in model.named_parameters():
            value.copy_(saved.get_tensor(f"model.{name}"))
    return model.eval()
