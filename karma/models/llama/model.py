"""Continue prompts, with or without a grammar, and score texts, by one GGUF file.

Names in programs are chosen as a whole. A grammar lets a model begin a name and then denies it the
rest: who would say `Desk` in a room without one has said "Des", and all that is left is `DeskLamp`.
So where the token that the model wants most may not follow inside a name, the name is taken back,
and the likeliest of all names that may stand there is found: best first, by the sum of their
tokens' log-probabilities.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from heapq import heappop, heappush
from pathlib import Path
from typing import Literal

import numpy as np

from karma.errors import ModelError, RequestRefused
from karma.models.automaton import ProgramAutomaton, State, without_closing
from karma.models.checks.template import TEMPLATE
from karma.models.completeness import cut_off, cycle, going_round
from karma.models.llama.answer import (
    CertaintyLog,
    Logits,
    UnderWay,
    best_token,
    choose_token,
    gumbel,
)
from karma.models.llama.chat_template import (
    ChatTemplate,
    Thought,
    closing_tokens,
    think,
    told_apart,
)
from karma.models.llama.gguf_model import GgufModel, OutOfTime
from karma.models.llama.opening import LlamaOptions
from karma.models.llama.scoring import SkillScorer, path_to, trie_of
from karma.seeds import stream
from karma.types.completion import Choice, Completion, KvState, Listener, Scoring, Thinking
from karma.types.planning import AnswerSpec, ProgramSpec, Prompt


@dataclass(frozen=True, slots=True)
class _Decoded:
    """What came out of the token loop."""

    text: bytes
    finish: Literal["stop", "length", "time", "cycle"]
    tokens: int


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
        self._closing_tokens = closing_tokens(self.gguf) if thinking == "on" else 0
        self._scorer: SkillScorer | None = None  # opened when first asked

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
        answer = UnderWay(max_seconds, listen)
        stable, changing = self._cut(prompt)
        prompt_tokens = len(stable) + len(changing)
        spare, room = self._rooms(prompt_tokens, max_tokens)
        self.gguf.make_room(prompt_tokens + spare + self._closing_tokens + room)
        automaton = None if spec is None else _automaton(spec)
        rng = stream(seed, "decode") if temperature > 0 else None
        log = CertaintyLog(self.gguf.table, spec)
        state: KvState | None = None
        thought, found = Thought("", 0), _Decoded(b"", "time", 0)
        with suppress(OutOfTime):
            state = self.gguf.evaluate(stable, changing, is_late=lambda: answer.is_late)
            thought = self._think(spare, temperature, rng, answer)
            found = self._decode(automaton, room, temperature, rng, answer, log)
        reasoning, text = self._thought_and_answer(thought, found, spec)
        return Completion(
            text=text,
            finish=found.finish,
            prompt_tokens=prompt_tokens,
            reused_tokens=len(stable) if state == "kept" else 0,
            completion_tokens=thought.tokens + found.tokens,
            first_token_s=answer.first_token_s,
            total_s=answer.seconds,
            reasoning=reasoning,
            constrained=spec is not None,
            fault=_fault(found, answer),
            engine=self.gguf.engine,
            state=state,
            certainty=log.certainty(),
        )

    def _thought_and_answer(
        self, thought: Thought, found: _Decoded, spec: AnswerSpec | None
    ) -> tuple[str, str]:
        """Return the thought and the answer."""
        text = found.text.decode("utf-8", errors="replace")
        if isinstance(spec, ProgramSpec):
            text = without_closing(text)
        if thought.text or self._template is None:
            return thought.text, text
        return told_apart(text)  # it may think without being asked to

    def check(self, prompt: Prompt) -> None:
        """Refuse a prompt that cannot be asked; computes nothing.

        Raises:
            RequestRefused: it leaves no room for an answer.
            ModelError: the chat template cannot render it.
        """
        stable, changing = self._cut(prompt)
        self._rooms(len(stable) + len(changing), 1)

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
        before, after, special = prompt.before, prompt.changing, False
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

    def _think(
        self, spare: int, temperature: float, rng: np.random.Generator | None, answer: UnderWay
    ) -> Thought:
        if not self._closing_tokens:
            return Thought("", 0)

        def choose() -> int:
            return self._next(None, None, temperature, rng)[0]

        return think(self.gguf, spare, choose, answer)

    def _decode(
        self,
        automaton: ProgramAutomaton | None,
        room: int,
        temperature: float,
        rng: np.random.Generator | None,
        answer: UnderWay,
        log: CertaintyLog,
    ) -> _Decoded:
        table = self.gguf.table
        state = automaton.start() if automaton is not None else None
        pieces: list[bytes] = []
        told = 0  # pieces: a name is told of when it is whole
        names = NameWatch(self.gguf, automaton, log) if automaton and rng is None else None
        while len(pieces) < room:
            if names and state:
                state = names.seen(state, pieces)
            token, state = self._next(automaton, state, temperature, rng, log)
            answer.begins()
            if token in table.end_tokens:
                return _Decoded(b"".join(pieces), "stop", len(pieces))
            pieces.append(table.pieces[token])
            under_way = len(pieces) < room and not answer.is_late
            if not (names and state and state.frame.names and under_way):
                answer.came(b"".join(pieces[told:]), len(pieces) - told)
                told = len(pieces)
            if automaton is not None and state is not None and not automaton.next_bytes(state):
                return _Decoded(b"".join(pieces), "stop", len(pieces))
            if automaton is not None and b"\n" in pieces[-1] and _cycle(b"".join(pieces)):
                return _Decoded(b"".join(pieces), "cycle", len(pieces))
            if answer.is_late:
                return _Decoded(b"".join(pieces), "time", len(pieces))
            if len(pieces) < room:
                self.gguf.extend([token], ahead=self._expected(automaton, state, pieces))
        return _Decoded(b"".join(pieces), "length", len(pieces))

    def _next(
        self,
        automaton: ProgramAutomaton | None,
        state: State | None,
        temperature: float,
        rng: np.random.Generator | None,
        log: CertaintyLog | None = None,
    ) -> tuple[int, State | None]:
        logits = self.gguf.logits()
        scores = logits if rng is None else gumbel(logits, temperature, rng)
        if automaton is None or state is None:
            token, after = best_token(scores), None
        else:
            token, after = choose_token(scores, automaton, state, self.gguf.table)
        if log is not None:
            log.add(logits, token)
        return token, after

    def _expected(
        self, automaton: ProgramAutomaton | None, state: State | None, pieces: Sequence[bytes]
    ) -> list[int]:
        """Return tokens that the answer is likely to go on with, as it is cut when it is read."""
        if automaton is None or state is None or not (text := automaton.expected(state)):
            return []
        begun = next((i for i, one in enumerate(reversed(pieces)) if b"\n" in one), len(pieces))
        line = list(pieces[len(pieces) - begun :])
        tokens = self.gguf.tokens((b"".join(line) + text).decode())
        cut = [self.gguf.table.pieces[token] for token in tokens]
        return tokens[len(line) :] if cut[: len(line)] == line else []


def _cycle(text: bytes) -> int:
    return cycle(text.split(b"\n")[:-1])


def _fault(found: _Decoded, answer: UnderWay) -> str:
    """Return why an answer is not whole; "" for one that is."""
    match found.finish:
        case "length":
            return cut_off(found.tokens)
        case "cycle":
            return going_round(_cycle(found.text))
        case "time":
            return answer.late
    return ""


@lru_cache(maxsize=8)
def _automaton(spec: AnswerSpec) -> ProgramAutomaton:
    return ProgramAutomaton(spec)


# ----------------------------------------------------------------- names as a whole


@dataclass(frozen=True, slots=True)
class NameBegun:
    """Where an answer stood before a name."""

    pieces: int  # of the answer, before it
    state: State
    decoded: int  # tokens in the cache, prompt included
    logits: Logits


class NameWatch:
    """Sees that names are chosen as a whole while an answer is decoded behind its prompt."""

    def __init__(self, model: GgufModel, automaton: ProgramAutomaton, log: CertaintyLog) -> None:
        self._model, self._automaton, self._log = model, automaton, log
        self._begun: NameBegun | None = None

    def seen(self, state: State, pieces: list[bytes]) -> State | None:
        """Return where the answer stands, a name that led astray replaced, in `pieces` too."""
        if not state.frame.names:
            return state
        if state.node == 0:
            logits = self._model.logits().copy()
            self._begun = NameBegun(len(pieces), state, self._model.decoded, logits)
        elif self._begun is not None and not self._goes_on(state):
            return self._taken_back(self._begun, pieces)
        return state

    def _goes_on(self, state: State) -> bool:
        """Return whether the token that the model wants most may follow."""
        piece = self._model.table.pieces[best_token(self._model.logits())]
        return bool(piece) and self._automaton.advance(state, piece, closing=True) is not None

    def _taken_back(self, begun: NameBegun, pieces: list[bytes]) -> State | None:
        word, tokens, chances = best_name(self._model, begun)
        self._log.replace(begun.pieces, chances)
        pieces[begun.pieces :] = [self._model.table.pieces[token] for token in tokens]
        self._model.rewind(begun.decoded)
        self._model.extend(tokens)
        return self._automaton.advance(begun.state, word)


def best_name(model: GgufModel, begun: NameBegun) -> tuple[str, list[int], list[float]]:
    """Return the likeliest name that may stand there, its tokens and their log-probabilities.

    The cache then holds what stood before the name, and what was run last; rewind it.
    """
    words = begun.state.frame.words
    trie = trie_of([model.tokens(word) for word in words])
    found: dict[int, float] = {0: 0.0}
    waiting = [(0.0, 0)]
    while True:
        _, number = heappop(waiting)
        if trie[number].ends:
            path = path_to(trie, number)
            gains = np.diff([0.0, *(found[one] for one in path)]).tolist()
            return words[trie[number].ends[0]], [trie[one].token for one in path], gains
        logits = begun.logits
        if number:
            model.rewind(begun.decoded)
            model.extend([trie[one].token for one in path_to(trie, number)])
            logits = model.logits()
        for token, chance in _chances(logits, list(trie[number].children)):
            child = trie[number].children[token]
            found[child] = found[number] + chance
            heappush(waiting, (-found[child], child))


def _chances(logits: Logits, tokens: Sequence[int]) -> list[tuple[int, float]]:
    """Return the log-probabilities of some tokens among all."""
    top = float(logits.max())
    whole = top + float(np.log(np.exp(logits - np.float32(top)).sum(dtype=np.float64)))
    return [(token, min(float(logits[token]) - whole, 0.0)) for token in tokens]
