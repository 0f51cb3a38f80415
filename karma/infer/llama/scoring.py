"""Score a closed list of continuations exactly under llama.cpp.

The score of a continuation s after a prompt is S(s) = sum over t of log p(tok_t | prompt, tok_<t);
`average` divides it by the number of tokens. Prompt and continuations are tokenised apart. The
naive way runs the whole prompt once per continuation. Here the prompt runs once and stays, and the
continuations share what they begin with in a trie of tokens.

A prompt is given in segments, and each is always decoded by itself, also when nothing is kept: so
what was kept from an earlier prompt changes no bit of a score (see `gguf_model`). With weights in
F32, F16, BF16 or Q8_0 the scores are those of the naive way but for the last digits of the
logarithm (measured: 1e-6), however prompt and continuation are cut there. With Q4_K, whose bits
depend on the cut, they are off by some hundredths: compare them with each other only.

A continuation that another begins with, token by token, never scores less than that one under
"sum", and the search cannot choose the longer: let continuations end in something that none goes
on from, such as a comma or the end of the line.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from karma.contracts import END, Choice, Scoring
from karma.errors import RequestRefused
from karma.infer.choosing.best_first import Race
from karma.infer.choosing.token_trie import Floats, Node, score_children, trie_of
from karma.infer.llama.constrain import Logits
from karma.infer.llama.gguf_model import GgufModel
from karma.infer.llama.path_runs import PathRuns
from karma.infer.llama.sequence_cache import SequenceCache

_TRIES = 8  # lists of continuations whose tokens are kept


@dataclass(frozen=True, slots=True, kw_only=True)
class Scores:
    """All continuations scored, in the order given, and what that took in tokens."""

    values: Floats
    prompt_tokens: int
    reused_tokens: int  # of the prompt, kept from an earlier call
    run_tokens: int  # of continuations


@dataclass(slots=True)
class _Segment:
    """A part of the prompt that is in the cache."""

    tokens: tuple[int, ...]
    logits: Logits  # after its last token


@dataclass(frozen=True, slots=True)
class _Begun:
    """A trie behind its prompt; the scores of the root's children are known."""

    trie: Sequence[Node]
    found: Floats
    prompt_tokens: int
    reused_tokens: int


class SkillScorer:
    """Scores continuations with an opened model, in a cache of its own.

    Chat templates are not applied: what is scored is a continuation of plain text.

    Args:
        model: the model; its own kept prompt and answers are left as they are.

    Raises:
        ModelError: the model keeps no keys and values, or there is no memory for a second cache.
    """

    def __init__(self, model: GgufModel) -> None:
        self.model = model
        self._cache = SequenceCache(model)
        self._kept: list[_Segment] = []  # segments of the prompt in the cache
        self._tries: dict[tuple[str, ...], Sequence[Node]] = {}

    def scores(
        self,
        prompt: Sequence[str],
        continuations: Sequence[str],
        *,
        scoring: Scoring = "sum",
    ) -> Scores:
        """Return the score of every continuation.

        Args:
            prompt: its segments; each is tokenised and decoded by itself.
            continuations: what may follow; `END` stands for the end of the answer.
            scoring: the sum of log-probabilities, or their average.

        Raises:
            RequestRefused: prompt and longest continuation do not fit the context.
            ValueError: there is no continuation, one without tokens, or no prompt.
        """
        begun = self._begin(prompt, continuations)
        trie, found = begun.trie, begun.found
        paths = PathRuns(self._cache, trie, found, begun.prompt_tokens)
        paths.score_all()
        values = np.empty(len(continuations), np.float64)
        for number, node in enumerate(trie):
            divisor = max(node.depth, 1) if scoring == "average" else 1
            values[node.ends] = found[number] / divisor
        return Scores(
            values=values,
            prompt_tokens=begun.prompt_tokens,
            reused_tokens=begun.reused_tokens,
            run_tokens=paths.count,
        )

    def choose(
        self, prompt: Sequence[str], continuations: Sequence[str], *, scoring: Scoring = "sum"
    ) -> Choice:
        """Return the continuation with the highest score, running as few tokens as can prove it.

        The score is the one that `scores` gives. Arguments and errors as there.
        """
        start_s = time.perf_counter()
        begun = self._begin(prompt, continuations)
        trie, found = begun.trie, begun.found
        paths = PathRuns(self._cache, trie, found, begun.prompt_tokens)
        race = Race(trie, found, average=scoring == "average")
        score, one, number = race.run(paths.score_below)
        return Choice(
            number=one,
            score=score,
            prompt_tokens=begun.prompt_tokens,
            reused_tokens=begun.reused_tokens,
            completion_tokens=trie[number].depth,
            run_tokens=paths.count,
            total_s=time.perf_counter() - start_s,
            engine=self.model.engine,
        )

    def close(self) -> None:
        """Free the cache; the model stays open."""
        self._cache.close()

    def _begin(self, prompt: Sequence[str], continuations: Sequence[str]) -> _Begun:
        """Have the prompt in the cache."""
        trie = self._trie(tuple(continuations))
        given = [
            tuple(self.model.tokens(text, begins=number == 0)) for number, text in enumerate(prompt)
        ]
        segments = [tokens for tokens in given if tokens]
        if not segments:
            raise ValueError("there is no prompt")
        tokens, longest = sum(map(len, segments)), trie[0].longest
        needed = tokens + longest - 1
        if needed > self.model.limit:
            raise RequestRefused(
                f"the prompt has {tokens} tokens and the longest continuation {longest}:"
                f" that needs a context of {needed}, but {self.model.name} has {self.model.limit}"
            )
        if self._cache.make_room(needed):
            self._kept = []
        reused = self._keep(segments)
        found = np.zeros(len(trie), np.float64)
        score_children(trie, found, [0], self._kept[-1].logits[None, :])
        return _Begun(trie, found, tokens, reused)

    def _keep(self, segments: Sequence[tuple[int, ...]]) -> int:
        """Decode what is not kept of a prompt; return how many tokens were."""
        same = 0
        for kept, wanted in zip(self._kept, segments, strict=False):
            if kept.tokens != wanted:
                break
            same += 1
        self._kept = self._kept[:same]
        reused = sum(len(segment.tokens) for segment in self._kept)
        self._cache.forget(reused)
        position = reused
        for wanted in segments[same:]:
            logits = self._cache.extend(wanted, position)
            position += len(wanted)
            self._kept.append(_Segment(wanted, logits))
        return reused

    def _trie(self, continuations: tuple[str, ...]) -> Sequence[Node]:
        """Return the trie of a list, made once for the lists used last."""
        if continuations not in self._tries:
            if len(self._tries) == _TRIES:
                self._tries.clear()
            ends = [self.model.end_token]
            lists = [self.model.tokens(one) if one != END else ends for one in continuations]
            self._tries[continuations] = trie_of(lists)
        return self._tries[continuations]
