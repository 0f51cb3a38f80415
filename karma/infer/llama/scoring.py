"""Exact scores of a closed list of continuations under llama.cpp.

The score of a continuation s after a prompt is S(s) = sum over t of log p(tok_t | prompt, tok_<t);
`average` divides it by the number of tokens. Prompt and continuations are tokenised apart. The
naive way runs the whole prompt once per continuation. Here the prompt runs once and stays, and the
continuations share what they begin with in a trie of tokens.

A prompt is given in segments, and each is always decoded by itself, also when nothing is kept: so
what was kept from an earlier prompt changes no bit of a score (see `karma.infer.llama.model`). With
weights in F32, F16, BF16 or Q8_0 the scores are those of the naive way but for the last digits of
the logarithm (measured: 1e-6), however prompt and continuation are cut there. With Q4_K, whose
bits depend on the cut, they are off by some hundredths: compare them with each other only.

A continuation that another begins with, token by token, never scores less than that one under
"sum", and the search cannot choose the longer: let continuations end in something that none goes
on from, such as a comma or the end of the line.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, Protocol, runtime_checkable

import numpy as np

from karma.errors import ModelError
from karma.infer.llama.best_first import Race
from karma.infer.llama.model import LlamaModel
from karma.infer.llama.sequence_cache import SequenceCache
from karma.infer.llama.token_trie import Floats, Logits, Node, score_children, trie_of
from karma.infer.llama.trie_runs import PathRuns, score_together

Scoring = Literal["sum", "average"]

END = ""  # as a continuation: the answer ends here
_TRIES = 8  # lists of continuations whose tokens are kept


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """What it took to score, in tokens."""

    prompt: int  # of the prompt
    reused: int  # of those, kept from an earlier call
    run: int  # of continuations


@dataclass(frozen=True, slots=True, kw_only=True)
class Scores:
    """All continuations scored, in the order given."""

    values: Floats
    cost: Cost


@dataclass(frozen=True, slots=True, kw_only=True)
class Best:
    """The continuation with the highest score; the first of equals."""

    number: int  # in the list given
    score: float
    tokens: int  # of the continuation
    cost: Cost
    seconds: float
    threads: int | None = None  # that computed it


@runtime_checkable
class Chooser(Protocol):
    """Chooses from a closed list by the likelihood of each text after a prompt."""

    def best(
        self, prompt: Sequence[str], continuations: Sequence[str], *, scoring: Scoring = "sum"
    ) -> Best:
        """Return the best continuation; see `SkillScorer.best`."""


@dataclass(slots=True)
class _Segment:
    """A part of the prompt that is in the cache."""

    tokens: tuple[int, ...]
    logits: Logits  # after its last token


class SkillScorer:
    """Scores continuations with an opened model, in a cache of its own.

    Chat templates are not applied: what is scored is a continuation of plain text.

    Args:
        model: the model; its own kept prompt and answers are left as they are.

    Raises:
        ModelError: the model keeps no keys and values, or there is no memory for a second cache.
    """

    def __init__(self, model: LlamaModel) -> None:
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
        one_batch: bool = False,
    ) -> Scores:
        """Return the score of every continuation.

        Args:
            prompt: its segments; each is tokenised and decoded by itself.
            continuations: what may follow; `END` stands for the end of the answer.
            scoring: the sum of log-probabilities, or their average.
            one_batch: faster, and off by some thousandths: see `karma.infer.llama.trie_runs`.

        Raises:
            ModelError: prompt and longest continuation do not fit the context.
            ValueError: there is no continuation, one without tokens, or no prompt.
        """
        trie, found, cost = self._begin(prompt, continuations)
        if one_batch:
            run = score_together(self._cache, trie, found, cost.prompt)
        else:
            paths = PathRuns(self._cache, trie, found, cost.prompt)
            paths.score_all()
            run = paths.count
        values = np.empty(len(continuations), np.float64)
        for number, node in enumerate(trie):
            divisor = max(node.depth, 1) if scoring == "average" else 1
            values[node.ends] = found[number] / divisor
        return Scores(values=values, cost=replace(cost, run=run))

    def best(
        self, prompt: Sequence[str], continuations: Sequence[str], *, scoring: Scoring = "sum"
    ) -> Best:
        """Return the continuation with the highest score, running as few tokens as can prove it.

        The score is the one that `scores` gives. Arguments and errors as there.
        """
        begun = time.perf_counter()
        trie, found, cost = self._begin(prompt, continuations)
        paths = PathRuns(self._cache, trie, found, cost.prompt)
        race = Race(trie, found, average=scoring == "average")
        leader: int | None = 0
        while leader is not None:
            paths.score_below(leader)
            race.enter(leader)
            leader = race.leader()
        score, one, number = race.winner()
        return Best(
            number=one,
            score=score,
            tokens=trie[number].depth,
            cost=replace(cost, run=paths.count),
            seconds=time.perf_counter() - begun,
            threads=self.model.n_threads,
        )

    def close(self) -> None:
        """Free the cache; the model stays open."""
        self._cache.close()

    def _begin(
        self, prompt: Sequence[str], continuations: Sequence[str]
    ) -> tuple[Sequence[Node], Floats, Cost]:
        """Have the prompt in the cache.

        Returns:
            The trie, its scores (those of the root's children are known), what the prompt took.
        """
        trie = self._trie(tuple(continuations))
        given = [
            tuple(self.model.tokens(text, begins=number == 0)) for number, text in enumerate(prompt)
        ]
        segments = [tokens for tokens in given if tokens]
        if not segments:
            raise ValueError("there is no prompt")
        tokens, longest = sum(map(len, segments)), trie[0].longest
        needed = tokens + longest - 1
        if needed > self.model.n_ctx:
            raise ModelError(
                f"the prompt has {tokens} tokens and the longest continuation {longest}:"
                f" that needs a context of {needed}, but {self.model.name} has {self.model.n_ctx}"
            )
        cost = Cost(prompt=tokens, reused=self._keep(segments), run=0)
        found = np.zeros(len(trie), np.float64)
        score_children(trie, found, [0], self._kept[-1].logits[None, :])
        return trie, found, cost

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
