"""Planner models by llama.cpp: one GGUF, one context, the scene's prefix kept.

A prompt is always decoded in the same cut, [stable] then [changing], also when nothing is kept:
how a prompt is cut into calls changes the last bits of the logits, so only then are warm and cold
answers identical bit for bit. One stable part is kept at a time.
"""

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from karma.contracts import Completion, ProgramSpec, Prompt
from karma.errors import ModelError
from karma.infer.llama.constrain import (
    Logits,
    ProgramAutomaton,
    State,
    choose_token,
    gumbel,
)
from karma.infer.llama.opening import (
    chat_renderer,
    check_room,
    open_gguf,
    token_table,
    try_in_own_process,
)
from karma.infer.manifest.gguf_check import check_gguf
from karma.infer.manifest.manifest import check_file
from karma.infer.manifest.memory_check import check_memory, kept_mb
from karma.seeds import stream

_MARK = "\ue000changing\ue000"  # private use: no template treats it specially
_N_BATCH = 512  # tokens per call; measured to change nothing but memory and speed


@dataclass(frozen=True, slots=True)
class _Decoded:
    """What came out of the token loop."""

    text: bytes
    finish: Literal["stop", "length"]
    tokens: int
    first_token_s: float


class LlamaModel:
    """A `LanguageModel` over one GGUF file.

    Args:
        path: the file; any GGUF that llama.cpp can run.
        n_ctx: context in tokens; never more than the model was trained for.
        n_threads: by default two, or one where there is only one core; results do not depend on
            it. More than there are free cores is slower.
        kv: type of the kept keys and values.
        name: by default the file's name.
        sha256: if given, the file is refused unless it has this hash; a file without is first
            tried in a process of its own, which costs a second or two.
        chat: render prompts through the file's own chat template (instruction-tuned models):
            `stable` is the system message, `changing` the user's.

    Raises:
        ModelError: missing, of another hash, damaged, too big for the memory that is free, or
            without the template that `chat` needs.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        n_ctx: int = 4096,
        n_threads: int | None = None,
        kv: Literal["f16", "f32"] = "f16",
        name: str | None = None,
        sha256: str | None = None,
        chat: bool = False,
    ) -> None:
        path = Path(path)
        if sha256 is not None:
            check_file(path, sha256)
        elif not path.is_file():
            fix = "`karma models verify` tells which models are there, `make setup` restores them"
            expected = "any (no manifest vouches for this path)"
            raise ModelError(
                f"{path}: no such file\n  Expected SHA-256: {expected}\n  To fix: {fix}"
            )
        metadata = check_gguf(path)
        trained = int(metadata[f"{metadata['general.architecture']}.context_length"])
        self.name = name or path.stem
        self.n_ctx = min(n_ctx, trained)
        self.n_threads = n_threads or min(2, len(os.sched_getaffinity(0)))
        self.n_batch = min(_N_BATCH, self.n_ctx)
        each = 2 if kv == "f16" else 4
        check_room(path, metadata, n_ctx=self.n_ctx, n_batch=self.n_batch, bytes_each=each)
        self._kept_mb = partial(kept_mb, metadata, bytes_each=each)
        if sha256 is None:
            try_in_own_process(path)
        self._llama: Any = open_gguf(path, self.n_ctx, self.n_threads, self.n_batch, kv)
        self._table = token_table(self._llama)
        self._template: Any = chat_renderer(self._llama, path) if chat else None
        self._kept: list[int] = []  # tokens whose keys and values are valid from position 0
        self._keeps = not (self._llama._is_recurrent or self._llama._is_hybrid)

    def complete(
        self,
        prompt: Prompt,
        *,
        spec: ProgramSpec | None = None,
        max_tokens: int = 512,
        temperature: float = 0.0,
        seed: int = 0,
    ) -> Completion:
        """Continue the prompt; with `spec`, only with a program that parses.

        An answer that reaches `max_tokens` or the end of the context has finish "length"; under a
        spec it is cut back to its last whole line.

        Raises:
            ModelError: the prompt does not fit the context, or the model cannot continue it.
        """
        begun = time.perf_counter()
        stable, changing = self._cut(prompt)
        prompt_tokens = len(stable) + len(changing)
        if prompt_tokens >= self.n_ctx:
            raise ModelError(
                f"the prompt has {prompt_tokens} tokens and needs room for an answer,"
                f" but {self.name} has a context of {self.n_ctx}"
            )
        reused = self._evaluate(stable, changing)
        automaton = None if spec is None else _automaton(spec)
        rng = stream(seed, "decode") if temperature > 0 else None
        room = min(max_tokens, self.n_ctx - prompt_tokens)
        found = self._decode(automaton, room, temperature, rng, begun)
        text = found.text
        if found.finish == "length" and automaton is not None:
            text = text[: text.rfind(b"\n") + 1]
        return Completion(
            text=text.decode("utf-8", errors="replace"),
            finish=found.finish,
            prompt_tokens=prompt_tokens,
            reused_tokens=reused,
            completion_tokens=found.tokens,
            first_token_s=found.first_token_s,
            total_s=time.perf_counter() - begun,
            threads=self.n_threads,
            batch=self.n_batch,
        )

    def logits(self) -> Logits:
        """Return a copy of the logits after the last decoded token, shape (vocabulary,)."""
        return self._last_logits().copy()

    def tokens(self, text: str, *, begins: bool = False) -> list[int]:
        """Return the tokens of plain text; `begins`: after the model's own first token, if any."""
        found: list[int] = self._llama.tokenize(text.encode("utf-8", "replace"), False, False)
        bos = self._llama.token_bos()
        wanted = begins and bos >= 0 and bool(self._llama._model.add_bos_token())
        return [bos, *found] if wanted else found

    @property
    def end_token(self) -> int:
        """The token that ends an answer."""
        return int(self._llama.token_eos())

    @property
    def vocabulary(self) -> int:
        """How many tokens there are."""
        return int(self._llama.n_vocab())

    def sequences(self, count: int, *, cells: int) -> Any:
        """Open a second context over the same weights: one cache for several sequences.

        It is freed with the model at the latest; see `karma.infer.llama.scoring`.

        Args:
            count: of sequences.
            cells: tokens that the cache holds, of all of them together.

        Raises:
            ModelError: the model keeps no keys and values, or there is no memory for more.
        """
        from llama_cpp import _internals, _utils

        if not self._keeps:
            raise ModelError(f"{self.name}: keeps no keys and values, so it cannot branch")
        check_memory(
            self.name, self._kept_mb(cells), parts=f"a second cache, of {cells} tokens",
            fix="take a smaller model (`karma models list`) or a shorter context",
        )  # fmt: skip
        parameters = type(self._llama.context_params).from_buffer_copy(self._llama.context_params)
        parameters.n_ctx, parameters.n_seq_max, parameters.kv_unified = cells, count, True
        # llama.cpp ends the process where a batch cannot hold a token of each sequence
        parameters.n_batch = parameters.n_ubatch = max(self.n_batch, count)
        try:
            with _utils.suppress_stdout_stderr(disable=False):  # it warns of longer than trained
                return _internals.LlamaContext(
                    model=self._llama._model, params=parameters, verbose=False
                )
        except ValueError as error:
            raise ModelError(f"{self.name}: no memory for a cache of {cells} tokens") from error

    def close(self) -> None:
        """Free the model's memory; it cannot be used afterwards."""
        if self._llama is not None:
            self._llama.close()
            self._llama = None  # what is used after all fails in Python, not in llama.cpp

    def _cut(self, prompt: Prompt) -> tuple[list[int], list[int]]:
        """Return the tokens of the two segments; the second is never empty."""
        before, after, special = prompt.stable, prompt.changing, False
        if self._template is not None:
            before, after = self._rendered(prompt)
            special = True
        bos = self._llama.token_bos()
        add_bos = bool(self._llama._model.add_bos_token()) and bos >= 0
        stable = self._llama.tokenize(before.encode("utf-8", "replace"), False, special)
        changing = self._llama.tokenize(after.encode("utf-8", "replace"), False, special)
        if add_bos and stable[:1] != [bos]:
            stable.insert(0, bos)
        if not changing:
            stable, changing = stable[:-1], stable[-1:]
        if not changing:
            raise ModelError("the prompt is empty")
        return stable, changing

    def _rendered(self, prompt: Prompt) -> tuple[str, str]:
        """Put the prompt into the chat template, cut where its changing part begins."""
        before, after = self._template_halves(prompt.stable)
        return before, prompt.changing + after

    def _template_halves(self, stable: str) -> tuple[str, str]:
        system = [{"role": "system", "content": stable}, {"role": "user", "content": _MARK}]
        user = [{"role": "user", "content": stable + _MARK}]
        for messages in (system, user):  # some templates refuse or drop a system message
            try:
                halves: list[str] = self._template(messages=messages).prompt.split(_MARK)
            except Exception as error:  # noqa: BLE001 - a template can raise anything
                reason = str(error)
                continue
            if len(halves) == 2 and stable.strip() in halves[0]:
                return halves[0], halves[1]
            reason = "it does not repeat what it is given"
        raise ModelError(f"{self.name}: its chat template cannot be used: {reason}")

    def _evaluate(self, stable: Sequence[int], changing: Sequence[int]) -> int:
        """Decode the prompt in its cut; return how many tokens were already there."""
        reused = len(stable) if self._keeps and self._kept == stable else 0
        self._kept = []  # while decoding, nothing is certain
        self._llama.reset()
        self._llama.n_tokens = reused
        if reused == 0 and stable:
            self._eval(stable)
        self._eval(changing)
        self._kept = list(stable)
        return reused

    def _eval(self, tokens: Sequence[int]) -> None:
        try:
            self._llama.eval(tokens)
        except RuntimeError as error:
            raise ModelError(f"{self.name}: llama.cpp cannot decode: {error}") from error

    def _decode(
        self,
        automaton: ProgramAutomaton | None,
        room: int,
        temperature: float,
        rng: np.random.Generator | None,
        begun: float,
    ) -> _Decoded:
        state = automaton.start() if automaton is not None else None
        pieces: list[bytes] = []
        first_token_s = 0.0
        while len(pieces) < room:
            token, state = self._next(automaton, state, temperature, rng)
            if not pieces:
                first_token_s = time.perf_counter() - begun
            if token in self._table.end_tokens:
                return _Decoded(b"".join(pieces), "stop", len(pieces), first_token_s)
            pieces.append(self._table.pieces[token])
            if automaton is not None and state is not None and not automaton.next_bytes(state):
                return _Decoded(b"".join(pieces), "stop", len(pieces), first_token_s)
            if len(pieces) < room:
                self._eval([token])
        return _Decoded(b"".join(pieces), "length", len(pieces), first_token_s)

    def _next(
        self,
        automaton: ProgramAutomaton | None,
        state: State | None,
        temperature: float,
        rng: np.random.Generator | None,
    ) -> tuple[int, State | None]:
        scores = self._last_logits()
        if rng is not None:
            scores = gumbel(scores, temperature, rng)
        if automaton is None or state is None:
            top = int(np.argmax(scores))
            if not np.isfinite(scores[top]):
                raise ModelError(f"the best score of a token is {scores[top]}: damaged weights")
            return top, None
        return choose_token(scores, automaton, state, self._table)

    def _last_logits(self) -> Logits:
        import llama_cpp

        pointer = llama_cpp.llama_get_logits_ith(self._llama.ctx, -1)
        return np.ctypeslib.as_array(pointer, shape=(self._llama.n_vocab(),))


@lru_cache(maxsize=8)
def _automaton(spec: ProgramSpec) -> ProgramAutomaton:
    return ProgramAutomaton(spec)
