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

A node of the trie is what some continuations begin with; the root is the prompt alone. A last token
is never run: the logits after its parent hold its score.
"""

import heapq
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from karma.errors import ModelError, RequestRefused
from karma.models.llama.answer import Logits
from karma.models.llama.gguf_model import GgufModel
from karma.types.completion import END, Choice, Scoring

Floats = NDArray[np.float64]
_ROWS = 16  # of logits turned to log-probabilities at a time
_TEXT, _SPARE = 0, 1  # sequences; the spare one is for a token that keeps another company


@dataclass(slots=True)
class Node:
    """What some continuations begin with."""

    token: int
    depth: int
    parent: int
    children: dict[int, int] = field(default_factory=dict)  # token -> node
    ends: list[int] = field(default_factory=list)  # continuations that end here
    longest: int = 0  # tokens of the longest continuation through here


def trie_of(continuations: Sequence[Sequence[int]]) -> list[Node]:
    """Return the trie of token lists, parents before children, the root first.

    ValueError where there is none, or one has no token.
    """
    if not continuations:
        raise ValueError("there is no continuation to score")
    trie = [Node(token=-1, depth=0, parent=0)]
    for one, tokens in enumerate(continuations):
        if not tokens or min(tokens) < 0:
            raise ValueError(f"continuation {one} has no token")
        number = 0
        for token in tokens:
            trie[number].longest = max(trie[number].longest, len(tokens))
            if token not in trie[number].children:
                trie[number].children[token] = len(trie)
                trie.append(Node(token=token, depth=trie[number].depth + 1, parent=number))
            number = trie[number].children[token]
        trie[number].longest = max(trie[number].longest, len(tokens))
        trie[number].ends.append(one)
    return trie


def path_to(trie: Sequence[Node], number: int) -> tuple[int, ...]:
    """Return the nodes from below the root down to one."""
    path = []
    while number:
        path.append(number)
        number = trie[number].parent
    return tuple(path[::-1])


def score_children(
    trie: Sequence[Node], found: Floats, nodes: Sequence[int], logits: Logits
) -> None:
    """Score the children of `nodes`, whose own scores are `found`; `logits` has a row per node.

    ModelError where the logits are not numbers.
    """
    for start in range(0, len(nodes), _ROWS):
        rows = logits[start : start + _ROWS]
        totals = _log_sum_exp(rows)
        for row, total, number in zip(rows, totals, nodes[start : start + _ROWS], strict=True):
            children = trie[number].children
            chances = row[list(children)].astype(np.float64) - total
            found[list(children.values())] = found[number] + np.minimum(chances, 0.0)


def _log_sum_exp(logits: Logits) -> Floats:
    top = logits.max(axis=1)
    if not np.isfinite(top).all():
        raise ModelError("the model's logits are not numbers: damaged weights")
    total = np.exp(logits - top[:, None]).sum(axis=1)
    found: Floats = top.astype(np.float64) + np.log(total.astype(np.float64))
    return found


class Race:
    """The prefixes that are scored, by the most that each can come to.

    No continuation can score more than what it begins with, because log p <= 0; so the first one
    that leads every unfinished prefix has won. `found` has the scores of nodes as they become
    known; with `average` a continuation's is divided by its tokens.
    """

    def __init__(self, trie: Sequence[Node], found: Floats, *, average: bool) -> None:
        self._trie, self._found, self._average = trie, found, average
        self._queue: list[tuple[float, int]] = []  # (minus the most it can come to, node); a heap
        self._ended: list[tuple[float, int, int]] = []  # (-score, continuation, node); a heap

    def run(self, score_below: Callable[[int], None]) -> tuple[float, int, int]:
        """Return the best that ends: score, continuation (the first of equals), node.

        `score_below` fills in the scores of a node's children, the root's first.
        """
        leader: int | None = 0
        while leader is not None:
            score_below(leader)
            for child in self._trie[leader].children.values():
                most = self._found[child] / (self._trie[child].longest if self._average else 1)
                heapq.heappush(self._queue, (-float(most), child))
            leader = self._leader()
        score, one, number = self._ended[0]
        return -score, one, number

    def _leader(self) -> int | None:
        """Take out the best prefix to go on from; None when the race is over."""
        while self._queue:
            if self._ended and self._ended[0][0] < self._queue[0][0]:  # equals can come up to it
                break
            _, number = heapq.heappop(self._queue)
            node = self._trie[number]
            score = self._found[number] / (node.depth if self._average else 1)
            for one in node.ends:
                heapq.heappush(self._ended, (-float(score), one, number))
            if node.children:
                return number
        return None


# ----------------------------------------------------------------- under llama.cpp


class SequenceCache:
    """One text as tokens at positions, extended or cut back at its end, apart from the model's own.

    llama.cpp's CPU kernels for F32, F16, BF16 and Q8_0 (measured on x86) give a token the same
    bits in any batch of two or more, whatever else is decoded with it, as long as its sequence lies
    in the same cells; a batch, or a request for logits, of one goes through other kernels. So
    nothing here is decoded, or asked for, alone.

    Raises:
        ModelError: the model keeps no keys and values, or there is no memory for a second cache.
    """

    def __init__(self, model: GgufModel) -> None:
        import llama_cpp

        self.batch = model.n_batch
        self._model = model
        self._open(model.n_ctx)
        self._tokens = llama_cpp.llama_batch_init(max(self.batch, 2), 0, 1)

    def make_room(self, tokens: int) -> bool:
        """Let it hold so many tokens; return whether it was opened anew, and keeps nothing.

        ModelError where there is no memory for it.
        """
        if tokens <= self._size:
            return False
        self._context.close()
        self._open(min(self._model.limit, 1 << (tokens - 1).bit_length()))
        return True

    def _open(self, size: int) -> None:
        import llama_cpp

        self._size = 0
        self._context = self._model.sequences(2, cells=size + 1)  # one more for the spare
        self._size = size
        self._memory = llama_cpp.llama_get_memory(self._context.ctx)

    def extend(self, tokens: Sequence[int], position: int) -> Logits:
        """Decode a text from a position on; return the logits after its last token."""
        for first in range(0, len(tokens), self.batch):
            logits = self.decode(
                tokens[first : first + self.batch], position + first, last_only=True
            )
        last: Logits = logits[-1].copy()
        return last

    def decode(self, tokens: Sequence[int], position: int, *, last_only: bool = False) -> Logits:
        """Decode one batch from a position on; return logits, valid until the next.

        A row per token, or with `last_only` that after the last. ModelError where llama.cpp cannot.
        """
        import llama_cpp

        count = len(tokens)
        alone = count == 1
        for number, token in enumerate(tokens):
            wanted = not last_only or number >= count - 2
            self._set(number, token, position + number, _TEXT, wanted=wanted)
        if alone:
            self._set(1, tokens[0], position, _SPARE, wanted=True)
        self._tokens.n_tokens = max(count, 2)
        code = llama_cpp.llama_decode(self._context.ctx, self._tokens)
        if code != 0:
            raise ModelError(f"{self._model.name}: llama.cpp cannot score (code {code})")
        if alone:
            llama_cpp.llama_memory_seq_rm(self._memory, _SPARE, -1, -1)
        rows = 2 if last_only or alone else count
        pointer = llama_cpp.llama_get_logits(self._context.ctx)
        shape = rows, self._model.vocabulary
        logits = np.asarray(np.ctypeslib.as_array(pointer, shape=shape), np.float32)
        if alone:
            return logits[:1]
        return logits[-1:] if last_only else logits

    def forget(self, position: int) -> None:
        """Keep the text up to a position, and nothing else."""
        import llama_cpp

        llama_cpp.llama_memory_seq_rm(self._memory, _TEXT, position, -1)

    def close(self) -> None:
        """Free it, once."""
        import llama_cpp

        if self._tokens is not None:
            llama_cpp.llama_batch_free(self._tokens)
            self._tokens = None
            self._context.close()
            self._memory = None  # what is used after all fails in Python, not in llama.cpp

    def _set(self, number: int, token: int, position: int, sequence: int, *, wanted: bool) -> None:
        batch = self._tokens
        batch.token[number], batch.pos[number] = token, position
        batch.n_seq_id[number], batch.seq_id[number][0] = 1, sequence
        batch.logits[number] = wanted


class PathRuns:
    """Runs a trie behind a prompt path after path, keeping what a path shares with the one before.

    So each continuation lies in the very cells that it would have alone, and its logits are those
    of a run of its own, bit for bit. All paths in one batch take less time, but lie in other cells:
    the sums of their attention are taken in another order, and with weights, or kept keys and
    values, of 16 bits the log-probability of an unlikely text moves by a few thousandths.

    The cache holds a prompt of `start` tokens, and the scores of the root's children are `found`;
    `count` tokens were run.
    """

    def __init__(
        self, cache: SequenceCache, trie: Sequence[Node], found: Floats, start: int
    ) -> None:
        self.count = 0
        self._cache, self.trie, self.found, self.start = cache, trie, found, start
        self._path: tuple[int, ...] = ()  # in the cache
        self._known = {0}  # nodes whose children have scores

    def score_below(self, number: int) -> None:
        """Score the children of a node, whose parent's are scored.

        Where only one way leads on, it is run along: two tokens take as long as one.
        """
        if number in self._known:
            return
        last = number
        while len(inner := self._inner(last)) == 1:
            last = inner[0]
        self.run(path_to(self.trie, last))

    def _inner(self, number: int) -> list[int]:
        children = self.trie[number].children.values()
        return [child for child in children if self.trie[child].children]

    def run(self, path: tuple[int, ...]) -> None:
        """Run a path of nodes, from below the root, and score their children."""
        same = _same(self._path, path)
        self._cache.forget(self.start + same)
        self._path = path
        for first in range(same, len(path), self._cache.batch):
            nodes = path[first : first + self._cache.batch]
            tokens = [self.trie[number].token for number in nodes]
            logits = self._cache.decode(tokens, self.start + first)
            score_children(self.trie, self.found, nodes, logits)
            self._known.update(nodes)
        self.count += len(path) - same


def _same(old: Sequence[object], new: Sequence[object]) -> int:
    """Return how many of the first are equal."""
    pairs = enumerate(zip(old, new, strict=False))
    return next((n for n, (a, b) in pairs if a != b), min(len(old), len(new)))


_TRIES = 8  # lists of continuations whose tokens are kept


@dataclass(slots=True)
class _Segment:
    """A part of the prompt that is in the cache."""

    tokens: tuple[int, ...]
    logits: Logits  # after its last token


class SkillScorer:
    """Scores continuations with an opened model, in a cache of its own.

    Chat templates are not applied: what is scored is a continuation of plain text.

    Raises:
        ModelError: the model keeps no keys and values, or there is no memory for a second cache.
    """

    def __init__(self, model: GgufModel) -> None:
        self.model = model
        self._cache = SequenceCache(model)
        self._kept: list[_Segment] = []  # segments of the prompt in the cache
        self._tries: dict[tuple[str, ...], Sequence[Node]] = {}

    def choose(
        self, prompt: Sequence[str], continuations: Sequence[str], *, scoring: Scoring = "sum"
    ) -> Choice:
        """Return the continuation with the highest score, running as few tokens as can prove it.

        The score is the sum of log-probabilities or their average. Each segment of the prompt is
        tokenised and decoded by itself; `END` stands for the end of the answer.

        Raises:
            RequestRefused: prompt and longest continuation do not fit the context.
            ValueError: there is no continuation, one without tokens, or no prompt.
        """
        start_s = time.perf_counter()
        paths, reused = self.begin(prompt, continuations)
        race = Race(paths.trie, paths.found, average=scoring == "average")
        score, one, number = race.run(paths.score_below)
        return Choice(
            number=one, score=score, prompt_tokens=paths.start, reused_tokens=reused,
            completion_tokens=paths.trie[number].depth, run_tokens=paths.count,
            total_s=time.perf_counter() - start_s, engine=self.model.engine,
        )  # fmt: skip

    def close(self) -> None:
        """Free the cache; the model stays open."""
        self._cache.close()

    def begin(self, prompt: Sequence[str], continuations: Sequence[str]) -> tuple[PathRuns, int]:
        """Have the prompt in the cache; return what runs behind it, and how much was kept."""
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
        return PathRuns(self._cache, trie, found, tokens), reused

    def _keep(self, segments: Sequence[tuple[int, ...]]) -> int:
        """Decode what is not kept of a prompt; return how many tokens were."""
        same = _same([kept.tokens for kept in self._kept], segments)
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
