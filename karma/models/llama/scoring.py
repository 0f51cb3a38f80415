"""Find the best of a closed list of continuations exactly under llama.cpp.

The score of a continuation s after a prompt is S(s) = sum over t of log p(tok_t | prompt, tok_<t);
`average` divides it by the number of tokens. Prompt and continuations are tokenised apart.

The prompt is evaluated once and stays; what continuations begin with is scored best first. No
continuation can score more than what it begins with, because log p <= 0: the first that leads every
unfinished beginning has won. A beginning is always decoded whole behind the prompt, in one call, so
that its scores do not depend on what was decoded before.

A continuation that another begins with, token by token, never scores less than that under "sum",
and the search cannot choose the longer: let continuations end in something that none goes on from,
such as a comma or the end of the line.
"""

import time
from collections.abc import Sequence
from functools import lru_cache
from heapq import heappop, heappush
from typing import NamedTuple

import numpy as np

from karma.errors import ModelError, RequestRefused
from karma.models.constraint import Logits
from karma.models.llama.gguf_model import GgufModel
from karma.types.completion import END, Choice, Scoring

Tokens = tuple[int, ...]


class _Continuations(NamedTuple):
    """Continuations by what they begin with."""

    following: dict[Tokens, dict[int, None]]  # beginning -> tokens that may follow, in order
    longest: dict[Tokens, int]  # beginning -> tokens of the longest continuation
    number: dict[Tokens, int]  # whole continuation -> place in the list, of the first of equals


def choose(
    model: GgufModel,
    prompt: Sequence[str],
    continuations: Sequence[str],
    *,
    scoring: Scoring = "sum",
) -> Choice:
    """Return the continuation with the highest score, running as few tokens as can prove it.

    Each segment of the prompt is tokenised and decoded by itself; `END` stands for the end of the
    answer. Chat templates are not applied.

    Raises:
        RequestRefused: prompt and longest continuation do not fit the context.
        ModelError: the model keeps no keys and values, or its logits are not numbers.
        ValueError: there is no continuation, one without tokens, or no prompt.
    """
    start_s = time.perf_counter()
    known = _continuations(model, tuple(continuations))
    given = [model.tokens(text, begins=number == 0) for number, text in enumerate(prompt)]
    segments = [tokens for tokens in given if tokens]
    if not segments:
        raise ValueError("there is no prompt")
    size, longest = sum(map(len, segments)), known.longest[()]
    if size + longest > model.limit:
        raise RequestRefused(
            f"the prompt has {size} tokens and the longest continuation {longest}:"
            f" that needs a context of {size + longest}, but {model.name} has {model.limit}"
        )
    model.make_room(size + longest)
    reused = model.evaluate(segments)
    scores: dict[Tokens, float] = {(): 0.0}
    queue: list[tuple[float, Tokens]] = []  # (minus the most it can come to, beginning); a heap

    def add(beginning: Tokens, logits: Logits) -> None:
        children = known.following[beginning]
        for token, chance in zip(children, _log_chances(logits, list(children)), strict=True):
            child = (*beginning, token)
            scores[child] = scores[beginning] + chance
            divisor = known.longest[child] if scoring == "average" else 1
            heappush(queue, (-scores[child] / divisor, child))

    expanded: set[Tokens] = {()}
    run = 0
    add((), model.logits())
    best: tuple[float, int, Tokens] | None = None
    while queue and (best is None or queue[0][0] <= best[0]):  # equals can come up to it
        _, leader = heappop(queue)
        if leader in known.number:
            divisor = len(leader) if scoring == "average" else 1
            ended = (-scores[leader] / divisor, known.number[leader], leader)
            best = ended if best is None else min(best, ended)
        if leader in known.following and leader not in expanded:
            path = _along(leader, known)
            rows = model.branch(size, path)
            run += len(path)
            for depth in range(1, len(path) + 1):
                if path[:depth] in known.following and path[:depth] not in expanded:
                    expanded.add(path[:depth])
                    add(path[:depth], rows[depth - 1])
    assert best is not None
    return Choice(
        number=best[1], score=-best[0], prompt_tokens=size, reused_tokens=reused,
        completion_tokens=len(best[2]), run_tokens=run, total_s=time.perf_counter() - start_s,
        engine=model.engine,
    )  # fmt: skip


def _along(beginning: Tokens, known: _Continuations) -> Tokens:
    """Return a beginning and what has to follow: several tokens take as long as a single one."""
    while len(inner := _inner(beginning, known)) == 1:
        beginning = inner[0]
    if len(beginning) == 1:  # a token alone is decoded by other kernels than many are
        return (*beginning, next(iter(known.following[beginning])))
    return beginning


def _inner(beginning: Tokens, known: _Continuations) -> list[Tokens]:
    children = [(*beginning, token) for token in known.following[beginning]]
    return [child for child in children if child in known.following]


@lru_cache(maxsize=8)
def _continuations(model: GgufModel, texts: tuple[str, ...]) -> _Continuations:
    if not texts:
        raise ValueError("there is no continuation to score")
    known = _Continuations({}, {(): 0}, {})
    for number, text in enumerate(texts):
        tokens = (model.end_token,) if text == END else tuple(model.tokens(text))
        if not tokens or min(tokens) < 0:
            raise ValueError(f"continuation {number} has no token")
        known.number.setdefault(tokens, number)
        for depth, token in enumerate(tokens):
            known.following.setdefault(tokens[:depth], {})[token] = None
        for depth in range(len(tokens) + 1):
            longest = known.longest.get(tokens[:depth], 0)
            known.longest[tokens[:depth]] = max(longest, len(tokens))
    return known


def _log_chances(logits: Logits, tokens: Sequence[int]) -> list[float]:
    """Return the log-probabilities of some tokens among all."""
    top = float(logits.max())
    if not np.isfinite(top):
        raise ModelError("the model's logits are not numbers: damaged weights")
    total = top + float(np.log(np.exp(logits - np.float32(top)).sum(dtype=np.float64)))
    found: list[float] = np.minimum(logits[tokens].astype(np.float64) - total, 0.0).tolist()
    return found
