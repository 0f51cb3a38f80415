"""Continue prompts, with or without a grammar, and score texts, by one GGUF file."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np

from karma.contracts import (
    AnswerSpec,
    Choice,
    Completion,
    ProgramSpec,
    Prompt,
    Scoring,
    Thinking,
)
from karma.errors import ModelError, RequestRefused
from karma.infer.llama.certainty import CertaintyLog
from karma.infer.llama.chat_template import ChatTemplate
from karma.infer.llama.constrain import best_token, choose_token, gumbel
from karma.infer.llama.gguf_model import GgufModel
from karma.infer.llama.options import LlamaOptions
from karma.infer.llama.room_states import StateOptions
from karma.infer.llama.scoring import SkillScorer
from karma.infer.llama.thinking import Thought, closing_tokens, think, told_apart
from karma.infer.programs.automaton import ProgramAutomaton, State
from karma.seeds import stream


@dataclass(frozen=True, slots=True)
class _Decoded:
    """What came out of the token loop."""

    text: bytes
    finish: Literal["stop", "length"]
    tokens: int
    first_token_s: float


class LlamaModel:
    """A `LanguageModel` and a `ScoringModel` over one GGUF file.

    Args:
        path: the file.
        chat: render prompts through the file's own chat template (instruction-tuned models):
            `stable` is the system message, `changing` the user's. Texts are scored without it.
        thinking: whether a thinking model may think before it answers; needs `chat`.
        thinking_tokens: of a thought at most; it is then closed.
        options: this and the rest: see `GgufModel`.
        name: see there.
        sha256: see there.
        states: see there.

    Raises:
        ModelError: see `GgufModel`; or there is no template, and `chat` needs one.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        chat: bool = False,
        thinking: Thinking = "off",
        thinking_tokens: int = 1024,
        options: LlamaOptions | None = None,
        name: str | None = None,
        sha256: str | None = None,
        states: StateOptions | None = None,
    ) -> None:
        self.gguf = GgufModel(path, options, name=name, sha256=sha256, states=states)
        self.name = self.gguf.name
        if thinking == "on" and not chat:
            raise ModelError(f"{self.name}: thinking = 'on' needs chat = true, its chat template")
        self._template = ChatTemplate(self.gguf, thinking=thinking) if chat else None
        self._thinking_tokens = thinking_tokens if thinking == "on" else 0
        self._closing_tokens = closing_tokens(self.gguf) if thinking == "on" else 0
        self._scorer: SkillScorer | None = None  # opened when first asked

    def complete(
        self,
        prompt: Prompt,
        *,
        spec: AnswerSpec | None = None,
        max_tokens: int = 512,
        temperature: float = 0.0,
        seed: int = 0,
    ) -> Completion:
        """Continue the prompt; with `spec`, only with a program or plan that parses.

        An answer that reaches `max_tokens` or the end of the context has finish "length"; under a
        spec it is cut back to its last whole line. A thought comes before the answer and counts
        as what the model said, but neither for `max_tokens` nor for the spec.

        Raises:
            RequestRefused: the prompt does not fit the context.
            ModelError: the model cannot continue it.
        """
        if prompt.pictures:
            raise ModelError(f"{self.name} takes no pictures here; a hosted model may")
        begun = time.perf_counter()
        stable, changing = self._cut(prompt)
        prompt_tokens = len(stable) + len(changing)
        spare, room = self._rooms(prompt_tokens, max_tokens)
        self.gguf.make_room(prompt_tokens + spare + self._closing_tokens + room)
        state = self.gguf.evaluate(stable, changing)
        automaton = None if spec is None else _automaton(spec)
        rng = stream(seed, "decode") if temperature > 0 else None
        thought = self._think(spare, temperature, rng)
        log = CertaintyLog(self.gguf.table, spec)
        found = self._decode(automaton, room, temperature, rng, begun, log)
        said = found.text
        if found.finish == "length" and isinstance(spec, ProgramSpec):
            said = said[: said.rfind(b"\n") + 1]
        reasoning, text = thought.text, said.decode("utf-8", errors="replace")
        if not reasoning and self._template is not None:  # it may think without being asked to
            reasoning, text = told_apart(text)
        return Completion(
            text=text,
            finish=found.finish,
            prompt_tokens=prompt_tokens,
            reused_tokens=0 if state == "evaluated" else len(stable),
            completion_tokens=thought.tokens + found.tokens,
            first_token_s=found.first_token_s,
            total_s=time.perf_counter() - begun,
            reasoning=reasoning,
            constrained=spec is not None,
            engine=self.gguf.engine,
            state=state,
            certainty=log.certainty(),
        )

    def choose(
        self, prompt: Sequence[str], continuations: Sequence[str], *, scoring: Scoring = "sum"
    ) -> Choice:
        """Return the likeliest continuation; see `SkillScorer.choose`.

        The first call opens a second cache over the same weights, which stays.

        Raises:
            ModelError: the model keeps no keys and values, there is no memory for a second cache,
                or prompt and longest continuation do not fit the context.
        """
        if self._scorer is None:
            self._scorer = SkillScorer(self.gguf)
        return self._scorer.choose(prompt, continuations, scoring=scoring)

    def close(self) -> None:
        """Free the model's memory; it cannot be used afterwards."""
        if self._scorer is not None:
            self._scorer.close()
        self.gguf.close()

    def _cut(self, prompt: Prompt) -> tuple[list[int], list[int]]:
        """Return the tokens of the two segments; the second is never empty."""
        before, after, special = prompt.stable, prompt.changing, False
        if self._template is not None:
            before, after = self._template.halves(prompt)
            special = True
        stable = self.gguf.tokens(before, begins=True, special=special)
        changing = self.gguf.tokens(after, special=special)
        if not changing:
            stable, changing = stable[:-1], stable[-1:]
        if not changing:
            raise ModelError("the prompt is empty")
        return stable, changing

    def _rooms(self, prompt_tokens: int, max_tokens: int) -> tuple[int, int]:
        """Return how many tokens a thought and the answer may have; the answer comes first.

        Raises:
            RequestRefused: there is no room for an answer.
        """
        left = self.gguf.limit - prompt_tokens - self._closing_tokens
        if left < 1:
            raise RequestRefused(
                f"the prompt has {prompt_tokens} tokens and needs room for an answer,"
                f" but {self.name} has a context of {self.gguf.limit}"
            )
        answer = min(max_tokens, left)
        return min(self._thinking_tokens, left - answer), answer

    def _think(self, spare: int, temperature: float, rng: np.random.Generator | None) -> Thought:
        if not self._closing_tokens:
            return Thought("", 0)
        return think(self.gguf, spare, lambda: self._next(None, None, temperature, rng)[0][0])

    def _decode(
        self,
        automaton: ProgramAutomaton | None,
        room: int,
        temperature: float,
        rng: np.random.Generator | None,
        begun: float,
        log: CertaintyLog,
    ) -> _Decoded:
        table = self.gguf.table
        state = automaton.start() if automaton is not None else None
        pieces: list[bytes] = []
        first_token_s = 0.0
        while len(pieces) < room:
            chosen, state = self._next(automaton, state, temperature, rng, log)
            if not pieces:
                first_token_s = time.perf_counter() - begun
            if chosen[0] in table.end_tokens:
                return _Decoded(b"".join(pieces), "stop", len(pieces), first_token_s)
            pieces += [table.pieces[token] for token in chosen[: room - len(pieces)]]
            if automaton is not None and state is not None and not automaton.next_bytes(state):
                return _Decoded(b"".join(pieces), "stop", len(pieces), first_token_s)
            if len(pieces) < room:
                self.gguf.extend(chosen)
        return _Decoded(b"".join(pieces), "length", len(pieces), first_token_s)

    def _next(
        self,
        automaton: ProgramAutomaton | None,
        state: State | None,
        temperature: float,
        rng: np.random.Generator | None,
        log: CertaintyLog | None = None,
    ) -> tuple[list[int], State | None]:
        """Return the next token, and what then has to follow; decoded at once, that is quicker."""
        logits = self.gguf.logits()
        scores = logits if rng is None else gumbel(logits, temperature, rng)
        if automaton is None or state is None:
            token, after = best_token(scores), None
        else:
            token, after = choose_token(scores, automaton, state, self.gguf.table)
        if log is not None:
            log.add(logits, token)
        if automaton is None:
            return [token], None
        if after is None or not (text := automaton.forced(after)):
            return [token], after
        more = self.gguf.tokens(text.decode())
        if b"".join(self.gguf.table.pieces[one] for one in more) != text:
            return [token], after  # a tokenizer that cannot go on in the middle of a text
        return [token, *more], automaton.advance(after, text)


@lru_cache(maxsize=8)
def _automaton(spec: AnswerSpec) -> ProgramAutomaton:
    return ProgramAutomaton(spec)
