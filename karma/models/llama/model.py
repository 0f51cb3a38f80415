"""Continue prompts, with or without a grammar, and score texts, by one GGUF file."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from karma.errors import ModelError, RequestRefused
from karma.models.checks.gguf import TEMPLATE
from karma.models.completeness import cut_off, cycle, going_round
from karma.models.constraint import Constraint, Logits, best_token
from karma.models.llama.answer import CertaintyLog, StreamingAnswer, gumbel
from karma.models.llama.chat_template import ChatTemplate, Thought, think
from karma.models.llama.gguf_model import GgufModel, OutOfTime
from karma.models.llama.opening import LlamaOptions
from karma.models.llama.scoring import choose
from karma.models.thoughts import GAP, split_thought
from karma.seeds import stream
from karma.types.completion import Choice, Completion, Listener, Scoring, Thinking
from karma.types.grammars import without_closing
from karma.types.planning import AnswerSpec, ProgramSpec, Prompt

MIN_SEGMENT = 128  # tokens that are decoded at once, of messages that are kept


@dataclass(frozen=True, slots=True)
class _Decoded:
    """What came out of the token loop."""

    text: bytes
    finish: Literal["stop", "length", "time", "cycle"]
    tokens: int


@dataclass(frozen=True, slots=True)
class Draw:
    """How a token is chosen: the best, or a sample at a temperature."""

    temperature: float = 0.0
    rng: np.random.Generator | None = None

    def scores(self, logits: Logits) -> Logits:
        """Return scores whose best is the token."""
        return logits if self.rng is None else gumbel(logits, self.temperature, self.rng)


class LlamaModel:
    """A `LanguageModel` and a `ScoringModel` over one GGUF file; opened as `GgufModel` says.

    Prompts go through the file's own chat template if `chat`, None: if it has one: `stable` is the
    system message, `changing` the user's. Texts are scored without it. `thinking` needs it, and a
    thought is closed after `thinking_tokens`.

    Attributes:
        manner: how prompts go in where there is a template, in words; else "".

    Raises:
        ModelError: see `GgufModel`; or there is no template that can be used, and one is wanted.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        chat: bool | None = None,
        thinking: Thinking = "off",
        thinking_tokens: int = 1024,
        options: LlamaOptions | None = None,
        name: str | None = None,
        sha256: str | None = None,
        restore: str = "",
    ) -> None:
        self.gguf = GgufModel(path, options, name=name, sha256=sha256, restore=restore)
        self.name = self.gguf.name
        there = TEMPLATE in self.gguf.metadata
        used = there if chat is None else chat
        if thinking == "on" and not used:
            raise ModelError(f"{self.name}: thinking = 'on' needs its chat template")
        self._template = ChatTemplate(self.gguf, thinking=thinking) if used else None
        way = "through" if used else "without"
        self.manner = f"{way} its own chat template" if there else ""
        self._thinking_tokens = thinking_tokens if thinking == "on" else 0
        tags = self._template.tags if self._template is not None else None
        self._closing = tags[1] if tags is not None and thinking == "on" else ""
        self._closing_tokens = 0
        if self._closing:
            closing = f"\n{self._closing}{GAP}"
            self._closing_tokens = len(self.gguf.tokens(closing, special=True))

    def complete(
        self,
        prompt: Prompt,
        *,
        spec: AnswerSpec | None = None,
        max_tokens: int = 512,
        max_seconds: float | None = None,
        temperature: float = 0.0,
        seed: int = 0,
        listen: Listener | None = None,
    ) -> Completion:
        """Continue the prompt; with `spec`, only with a program or plan that parses.

        A thought comes before the answer and counts as what the model said, but neither for
        `max_tokens` nor for the spec. An answer that is not whole has a fault, and its finish says
        why: "length" at `max_tokens` or the end of the context; "cycle" where a program's last
        lines come for the third time; "time" after `max_seconds`, reading the prompt counted. The
        clock is looked at after each token, and after each 512 of the prompt; asked again, it goes
        on where it stopped reading.

        Raises:
            RequestRefused: the prompt does not fit the context.
            ModelError: the model cannot continue it.
        """
        if prompt.pictures:
            raise ModelError(f"{self.name} takes no pictures here; a hosted model may")
        answer = StreamingAnswer(max_seconds, listen)
        segments = self.segments(prompt)
        prompt_tokens = sum(map(len, segments))
        stable_tokens = prompt_tokens - len(segments[-1])
        spare, room = self._rooms(prompt_tokens, max_tokens)
        self.gguf.make_room(prompt_tokens + spare + self._closing_tokens + room)
        held = None if spec is None else Constraint(self.gguf.grammar_tokens, spec.grammar)
        draw = Draw(temperature, stream(seed, "decode") if temperature > 0 else None)
        log = CertaintyLog(
            self.gguf.table, may_refuse=isinstance(spec, ProgramSpec) and bool(spec.refusals)
        )
        thought, found = Thought("", 0), _Decoded(b"", "time", 0)
        reused: int | None = None
        with suppress(OutOfTime):
            reused = self.gguf.evaluate(segments, is_late=lambda: answer.is_late)
            thought = self._think(spare, draw, answer)
            found = self._decode(held, room, draw, answer, log)
        text, reasoning = found.text.decode("utf-8", errors="replace"), thought.text
        if held is not None:
            text = without_closing(text)
        elif not reasoning:
            reasoning, text = split_thought(text)  # it may think without being asked to
        return Completion(
            text=text,
            finish=found.finish,
            prompt_tokens=prompt_tokens,
            reused_tokens=min(reused or 0, stable_tokens),
            completion_tokens=thought.tokens + found.tokens,
            first_token_s=answer.first_token_s,
            total_s=answer.seconds,
            reasoning=reasoning,
            constrained=held is not None,
            fault=_fault(found, answer),
            engine=self.gguf.engine,
            state=None
            if reused is None
            else "kept"
            if 0 < stable_tokens <= reused
            else "evaluated",
            certainty=log.certainty(),
        )

    def check(self, prompt: Prompt) -> None:
        """Refuse a prompt that cannot be asked; computes nothing.

        Raises:
            RequestRefused: it leaves no room for an answer.
            ModelError: the chat template cannot render it.
        """
        self._rooms(sum(map(len, self.segments(prompt))), 1)

    def choose(
        self, prompt: Sequence[str], continuations: Sequence[str], *, scoring: Scoring = "sum"
    ) -> Choice:
        """Return the likeliest continuation; see `karma.models.llama.scoring`, also for errors."""
        return choose(self.gguf, prompt, continuations, scoring=scoring)

    def close(self) -> None:
        """Free the model's memory; it cannot be used afterwards."""
        self.gguf.close()

    def segments(self, prompt: Prompt) -> list[list[int]]:
        """Return the tokens of the segments that a prompt is decoded in; the last is never empty.

        Earlier turns are segments of their own, as what follows them changes.
        """
        before, after, special = prompt.before, prompt.changing, False
        if self._template is not None:
            before, after = self._template.halves(prompt)
            special = True
        texts, said = [], [prompt.stable, *(text for turn in prompt.turns for text in turn)]
        for text in said if prompt.turns else ():
            head, found, before = before.partition(text.strip())
            texts.append(head + found)
        texts.append(before)
        segments = [
            self.gguf.tokens(text, begins=not number, special=special)
            for number, text in enumerate(texts)
        ]
        segments = [*joined(segments), self.gguf.tokens(after, special=special)]
        if not segments[-1] and segments[-2]:
            segments[-1] = [segments[-2].pop()]
        if not segments[-1]:
            raise ModelError("the prompt is empty")
        return segments

    def _rooms(self, prompt_tokens: int, max_tokens: int) -> tuple[int, int]:
        """Return how many tokens a thought and the answer may have; the answer comes first.

        RequestRefused where there is no room for an answer.
        """
        left = self.gguf.limit - prompt_tokens - self._closing_tokens
        if left < 1:
            raise RequestRefused(
                f"the prompt has {prompt_tokens} tokens and needs room for an answer,"
                f" but {self.name} has a context of {self.gguf.limit}"
            )
        answer = min(max_tokens, left)
        return min(self._thinking_tokens, left - answer), answer

    def _think(self, spare: int, draw: Draw, answer: StreamingAnswer) -> Thought:
        if not self._closing:
            return Thought("", 0)

        def next_token() -> int:
            return best_token(draw.scores(self.gguf.logits()))

        return think(self.gguf, self._closing, spare, next_token, answer)

    def _decode(
        self,
        held: Constraint | None,
        room: int,
        draw: Draw,
        answer: StreamingAnswer,
        log: CertaintyLog,
    ) -> _Decoded:
        table, text, count = self.gguf.table, b"", 0
        while count < room:
            logits = self.gguf.logits()
            scores = draw.scores(logits)
            token = best_token(scores) if held is None else held.choose(scores)
            log.add(logits, token)
            answer.begins()
            if token in table.end_tokens:
                return _Decoded(text, "stop", count)
            text, count = text + table.pieces[token], count + 1
            answer.came(table.pieces[token])
            if held is not None:
                held.take(token)
                if held.has_ended:
                    return _Decoded(text, "stop", count)
                if b"\n" in table.pieces[token] and _cycle(text):
                    return _Decoded(text, "cycle", count)
            if answer.is_late:
                return _Decoded(text, "time", count)
            if count < room:
                self.gguf.extend([token], ahead=held.expected() if held is not None else ())
        return _Decoded(text, "length", count)


def _cycle(text: bytes) -> int:
    return cycle(text.split(b"\n")[:-1])


def joined(segments: Sequence[list[int]]) -> list[list[int]]:
    """Join short segments to at least `MIN_SEGMENT` tokens, from the start; the last may be short.

    Segments that are added behind leave the earlier ones as they are.
    """
    found: list[list[int]] = [[]]
    for segment in segments:
        if len(found[-1]) >= MIN_SEGMENT:
            found.append([])
        found[-1] += segment
    return found


def _fault(found: _Decoded, answer: StreamingAnswer) -> str:
    """Return why an answer is not whole; "" for one that is."""
    match found.finish:
        case "length":
            return cut_off(found.tokens)
        case "cycle":
            return going_round(_cycle(found.text))
        case "time":
            return answer.late
    return ""
