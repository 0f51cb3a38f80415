"""Exact scores of a closed list of continuations under llama.cpp.

The score of a continuation s after a prompt is S(s) = sum over t of log p(tok_t | prompt, tok_<t);
`average` divides it by the number of tokens. Prompt and continuations are tokenised apart. The
naive way runs the whole prompt once per continuation. Here the prompt runs once and stays; the
continuations share what they begin with in a trie of tokens, whose last tokens need no run at all.

A prompt is given in segments, and each is always decoded by itself, also when nothing is kept: so
what was kept from an earlier prompt changes no bit of a score (see `karma.infer.llama`).

With weights in 16 bits the last bits matter: a value that is rounded the other way in one layer can
move the log-probability of an unlikely text by a thousandth in the end. Sharing a batch with others
changes last bits. Where that counts, `one_by_one` runs the trie path after path, each in the very
cells of the naive way: equal to 1e-5, at the price of more and smaller batches.
"""

import heapq
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from karma.errors import ModelError
from karma.infer.llama import LlamaModel

Scoring = Literal["sum", "average"]
Floats = NDArray[np.float64]

END = ""  # as a continuation: the answer ends here
_SEQUENCES = 255  # in one cache; number 0 holds the prompt
_SPARE = 255  # one more, for a token that keeps another company
_CELLS = 1024  # of the cache, besides the prompt's
_WIDTH = 4  # most promising prefixes run at a time
_TRIES = 8  # lists of continuations whose tokens are kept
_ROWS = 16  # of logits turned to log-probabilities at a time


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
class _Node:
    """What some continuations begin with; the root is the prompt alone."""

    token: int
    depth: int
    parent: int
    children: dict[int, int] = field(default_factory=dict)  # token -> node
    ends: list[int] = field(default_factory=list)  # continuations that end here
    longest: int = 0  # tokens of the longest continuation through here


@dataclass(slots=True)
class _Segment:
    """A part of the prompt that is in the cache."""

    tokens: tuple[int, ...]
    logits: NDArray[np.float32]  # after its last token


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
        self._cache = _Cache(model)
        self._kept: list[_Segment] = []  # segments of the prompt in the cache
        self._tries: dict[tuple[str, ...], Sequence[_Node]] = {}

    def scores(
        self,
        prompt: Sequence[str],
        continuations: Sequence[str],
        *,
        scoring: Scoring = "sum",
        one_by_one: bool = False,
    ) -> Scores:
        """Return the score of every continuation, from one pass over the trie.

        A list that needs more than 254 sequences, or more room than the cache has, takes several
        passes.

        Args:
            prompt: its segments; each is tokenised and decoded by itself.
            continuations: what may follow; `END` stands for the end of the answer.
            scoring: the sum of log-probabilities, or their average.
            one_by_one: to the last bits as the naive way, and slower.

        Raises:
            ModelError: prompt and longest continuation do not fit the context.
            ValueError: there is no continuation, or no prompt.
        """
        trie, cost = self._begin(prompt, continuations)
        found = np.zeros(len(trie), np.float64)
        run = 0
        self._spread(trie, found, [0], self._kept[-1].logits[None, :])
        if one_by_one:
            run = self._walk(trie, found, cost.prompt)
        else:
            for leaves in _passes(trie, self._cache.cells - cost.prompt):
                run += self._pass(trie, found, leaves, cost.prompt)
        values = np.empty(len(continuations), np.float64)
        for number, node in enumerate(trie):
            divisor = max(node.depth, 1) if scoring == "average" else 1
            values[node.ends] = found[number] / divisor
        return Scores(values=values, cost=replace(cost, run=run))

    def best(
        self,
        prompt: Sequence[str],
        continuations: Sequence[str],
        *,
        scoring: Scoring = "sum",
    ) -> Best:
        """Return the continuation with the highest score, running as few tokens as can prove it.

        Best-first search: no continuation can score more than what it begins with, because
        log p <= 0; so the first one that leads every unfinished prefix has won. Arguments and
        errors as in `scores`.
        """
        begun = time.perf_counter()
        trie, cost = self._begin(prompt, continuations)
        found = np.zeros(len(trie), np.float64)
        self._spread(trie, found, [0], self._kept[-1].logits[None, :])
        race = _Race(trie, found, scoring)
        race.enter(0)
        search = _Search(self._cache, trie, cost.prompt)
        while nodes := race.leaders():
            self._spread(trie, found, nodes, search.run(nodes))
            for number in nodes:
                race.enter(number)
        self._cache.forget(cost.prompt)
        score, one, number = race.ended[0]
        return Best(
            number=one,
            score=-score,
            tokens=trie[number].depth,
            cost=replace(cost, run=search.count),
            seconds=time.perf_counter() - begun,
            threads=self.model.n_threads,
        )

    def close(self) -> None:
        """Free the cache; the model stays open."""
        self._cache.close()

    # ------------------------------------------------------------- the prompt

    def _begin(
        self, prompt: Sequence[str], continuations: Sequence[str]
    ) -> tuple[Sequence[_Node], Cost]:
        """Have the prompt in the cache; return the trie and what the prompt took."""
        trie = self._trie(tuple(continuations))
        begins = [True, *[False] * (len(prompt) - 1)]
        given = [
            tuple(self.model.tokens(text, begins=first))
            for text, first in zip(prompt, begins, strict=True)
        ]
        segments = [tokens for tokens in given if tokens]
        if not segments:
            raise ValueError("there is no prompt")
        tokens, longest = sum(map(len, segments)), trie[0].longest
        if tokens + longest - 1 > self.model.n_ctx:
            raise ModelError(
                f"the prompt has {tokens} tokens and the longest continuation {longest},"
                f" but {self.model.name} has a context of {self.model.n_ctx}"
            )
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
        return trie, Cost(prompt=tokens, reused=reused, run=0)

    # ------------------------------------------------------------- the trie

    def _trie(self, continuations: tuple[str, ...]) -> Sequence[_Node]:
        """Return the trie of a list, made once for the lists used last."""
        if continuations not in self._tries:
            if len(self._tries) == _TRIES:
                self._tries.clear()
            ends = [self.model.end_token]
            lists = [self.model.tokens(one) if one != END else ends for one in continuations]
            self._tries[continuations] = trie_of(lists)
        return self._tries[continuations]

    def _spread(
        self,
        trie: Sequence[_Node],
        found: Floats,
        nodes: Sequence[int],
        logits: NDArray[np.float32],
    ) -> None:
        """Score the children of nodes by the logits after each node, a row per node."""
        for start in range(0, len(nodes), _ROWS):
            rows = logits[start : start + _ROWS]
            totals = _log_sum_exp(rows)
            for row, total, number in zip(rows, totals, nodes[start : start + _ROWS], strict=True):
                children = trie[number].children
                chances = row[list(children)].astype(np.float64) - total
                found[list(children.values())] = found[number] + np.minimum(chances, 0.0)

    def _pass(self, trie: Sequence[_Node], found: Floats, leaves: Sequence[int], start: int) -> int:
        """Run every node above some leaves once, a token in as many sequences as pass through it.

        Returns:
            How many tokens that were.
        """
        through: dict[int, list[int]] = {}
        for sequence, leaf in enumerate(leaves, start=1):
            number = leaf
            while number:
                through.setdefault(number, []).append(sequence)
                number = trie[number].parent
            self._cache.copy(0, sequence, start)
        order = sorted(through, key=lambda number: (trie[number].depth, number))
        for first in range(0, len(order), self._cache.batch):
            nodes = order[first : first + self._cache.batch]
            logits = self._cache.decode(
                [trie[number].token for number in nodes],
                [start + trie[number].depth - 1 for number in nodes],
                [through[number] for number in nodes],
            )
            self._spread(trie, found, nodes, logits)
        self._cache.forget(start)
        return len(order)

    def _walk(self, trie: Sequence[_Node], found: Floats, start: int) -> int:
        """Run the trie path after path behind the prompt; return how many tokens that were."""
        before: tuple[int, ...] = ()
        run = 0
        for leaf in _lowest(trie):
            path = _path(trie, leaf)
            same = 0
            while same < len(before) and before[same] == path[same]:
                same += 1
            self._cache.forget(start + same)
            for first in range(same, len(path), self._cache.batch):
                nodes = path[first : first + self._cache.batch]
                places = range(start + first, start + first + len(nodes))
                tokens = [trie[number].token for number in nodes]
                self._spread(
                    trie, found, nodes, self._cache.decode(tokens, places, [[0]] * len(nodes))
                )
            run += len(path) - same
            before = path
        self._cache.forget(start)
        return run


class _Race:
    """Which prefixes may still win."""

    def __init__(self, trie: Sequence[_Node], found: Floats, scoring: Scoring) -> None:
        self._trie, self._found, self._average = trie, found, scoring == "average"
        self._queue: list[tuple[float, int]] = []  # (minus the most it can come to, node)
        self.ended: list[tuple[float, int, int]] = []  # (-score, continuation, node); a heap

    def enter(self, number: int) -> None:
        """Let the children of a node in, now that they have scores."""
        for child in self._trie[number].children.values():
            most = self._found[child] / (self._trie[child].longest if self._average else 1)
            heapq.heappush(self._queue, (-float(most), child))

    def leaders(self) -> list[int]:
        """Take out the best prefixes to go on from; none when the race is over."""
        nodes: list[int] = []
        while self._queue and len(nodes) < _WIDTH and not self._decided():
            _, number = heapq.heappop(self._queue)
            node = self._trie[number]
            score = self._found[number] / (node.depth if self._average else 1)
            for one in node.ends:
                heapq.heappush(self.ended, (-float(score), one, number))
            if node.children:
                nodes.append(number)
        return nodes

    def _decided(self) -> bool:
        """Return whether nothing in the queue can come up to what has ended; equals can."""
        return bool(self.ended) and self.ended[0][0] < self._queue[0][0]


class _Search:
    """Runs nodes of a trie in any order; what led to a node is kept as long as there is room."""

    def __init__(self, cache: "_Cache", trie: Sequence[_Node], start: int) -> None:
        self._cache, self._trie, self._start = cache, trie, start
        self.count = 0  # tokens run
        self._restart()

    def run(self, nodes: Sequence[int]) -> NDArray[np.float32]:
        """Return the logits after each node, a row per node."""
        if all(self._trie[number].parent in self._at for number in nodes):
            if self._fits(len(nodes), len(nodes)):
                return self._step(nodes)
            self._restart()
        return np.concatenate([self._walk(number) for number in nodes])

    def _step(self, nodes: Sequence[int]) -> NDArray[np.float32]:
        """Run nodes whose parents were run, together."""
        for number in nodes:
            self._at[number] = self._begin(self._trie[number].parent)
        return self._decode(nodes, last_only=False)

    def _walk(self, number: int) -> NDArray[np.float32]:
        """Run one node and whatever of its path is missing, in one sequence."""
        path = self._missing(number)
        if not self._fits(1, len(path)):
            self._restart()
            path = self._missing(number)
        sequence = self._begin(self._trie[path[0]].parent)
        self._at.update(dict.fromkeys(path, sequence))
        for first in range(0, len(path), self._cache.batch):
            logits = self._decode(path[first : first + self._cache.batch], last_only=True)
        return logits.copy()

    def _missing(self, number: int) -> list[int]:
        path: list[int] = []
        while number not in self._at:
            path.append(number)
            number = self._trie[number].parent
        return path[::-1]

    def _fits(self, sequences: int, tokens: int) -> bool:
        return (
            self._used + sequences <= self._cache.sequences
            and self._start + self._filled + tokens <= self._cache.cells
        )

    def _begin(self, number: int) -> int:
        """Return a fresh sequence that stands after a node."""
        end = self._start + self._trie[number].depth
        self._cache.copy(self._at[number], self._used, end)
        self._used += 1
        return self._used - 1

    def _restart(self) -> None:
        self._cache.forget(self._start)
        self._at = {0: 0}  # node -> a sequence that passes through it
        self._used = 1  # sequences
        self._filled = 0  # cells besides the prompt's

    def _decode(self, nodes: Sequence[int], *, last_only: bool) -> NDArray[np.float32]:
        self.count += len(nodes)
        self._filled += len(nodes)
        return self._cache.decode(
            [self._trie[number].token for number in nodes],
            [self._start + self._trie[number].depth - 1 for number in nodes],
            [[self._at[number]] for number in nodes],
            last_only=last_only,
        )


class _Cache:
    """Keys and values of the prompt (sequence 0) and of what may follow it (the others)."""

    def __init__(self, model: LlamaModel) -> None:
        import llama_cpp

        self.cells = model.n_ctx + _CELLS
        self.sequences = _SEQUENCES
        self.batch = model.n_batch
        self._model = model
        self._context = model.sequences(_SPARE + 1, cells=self.cells + 1)
        self._memory = llama_cpp.llama_get_memory(self._context.ctx)
        self._tokens = llama_cpp.llama_batch_init(max(self.batch, 2), 0, self.sequences)

    def extend(self, tokens: Sequence[int], position: int) -> NDArray[np.float32]:
        """Decode a part of the prompt; return the logits after its last token."""
        for first in range(0, len(tokens), self.batch):
            part = tokens[first : first + self.batch]
            places = range(position + first, position + first + len(part))
            logits = self.decode(part, places, [[0]] * len(part), last_only=True)
        last: NDArray[np.float32] = logits[-1].copy()
        return last

    def decode(
        self,
        tokens: Sequence[int],
        positions: Sequence[int],
        sequences: Sequence[Sequence[int]],
        *,
        last_only: bool = False,
    ) -> NDArray[np.float32]:
        """Decode one batch; return logits, a row per token (or one), valid until the next."""
        import llama_cpp

        count = len(tokens)
        for number in range(count):
            wanted = not last_only or number == count - 1
            self._set(number, tokens[number], positions[number], sequences[number], wanted=wanted)
        if count == 1:
            self._set(1, tokens[0], positions[0], [_SPARE], wanted=False)
        self._tokens.n_tokens = max(count, 2)
        code = llama_cpp.llama_decode(self._context.ctx, self._tokens)
        if code != 0:
            raise ModelError(f"{self._model.name}: llama.cpp cannot score (code {code})")
        if count == 1:
            llama_cpp.llama_memory_seq_rm(self._memory, _SPARE, -1, -1)
        rows = 1 if last_only else count
        pointer = llama_cpp.llama_get_logits(self._context.ctx)
        shape = rows, self._model.vocabulary
        return np.asarray(np.ctypeslib.as_array(pointer, shape=shape), np.float32)

    def _set(
        self, number: int, token: int, position: int, sequences: Sequence[int], *, wanted: bool
    ) -> None:
        batch = self._tokens
        batch.token[number], batch.pos[number] = token, position
        batch.n_seq_id[number] = len(sequences)
        for place, sequence in enumerate(sequences):
            batch.seq_id[number][place] = sequence
        batch.logits[number] = wanted

    def copy(self, source: int, target: int, end: int) -> None:
        """Let one sequence begin as another does, up to a position."""
        import llama_cpp

        llama_cpp.llama_memory_seq_cp(self._memory, source, target, 0, end)

    def forget(self, position: int) -> None:
        """Keep the prompt up to a position, and nothing else."""
        import llama_cpp

        llama_cpp.llama_memory_seq_keep(self._memory, 0)
        llama_cpp.llama_memory_seq_rm(self._memory, 0, position, -1)

    def close(self) -> None:
        """Free it, once."""
        import llama_cpp

        if self._tokens is not None:
            llama_cpp.llama_batch_free(self._tokens)
            self._tokens = None
            self._context.close()


# ----------------------------------------------------------------- tokens and numbers


def trie_of(continuations: Sequence[Sequence[int]]) -> list[_Node]:
    """Return the trie of token lists, parents before children, the root first.

    Raises:
        ValueError: there is none, or one has no token.
    """
    if not continuations:
        raise ValueError("there is no continuation to score")
    trie = [_Node(token=-1, depth=0, parent=0)]
    for one, tokens in enumerate(continuations):
        if not tokens:
            raise ValueError(f"continuation {one} has no token")
        number = 0
        for token in tokens:
            trie[number].longest = max(trie[number].longest, len(tokens))
            if token not in trie[number].children:
                trie[number].children[token] = len(trie)
                trie.append(_Node(token=token, depth=trie[number].depth + 1, parent=number))
            number = trie[number].children[token]
        trie[number].longest = max(trie[number].longest, len(tokens))
        trie[number].ends.append(one)
    return trie


def _passes(trie: Sequence[_Node], room: int) -> Iterator[list[int]]:
    """Yield the lowest nodes that have to be run, in groups that fit one pass."""
    group: list[int] = []
    run: set[int] = set()
    for leaf in _lowest(trie):
        path = set(_path(trie, leaf))
        if group and (len(group) == _SEQUENCES - 1 or len(run | path) > room):
            yield group
            group, run = [], set()
        group.append(leaf)
        run |= path
    if group:
        yield group


def _lowest(trie: Sequence[_Node]) -> list[int]:
    """Return the nodes to run that none to run is below; neighbours share most of their paths."""
    inner = [number for number, node in enumerate(trie) if number and node.children]
    lowest = [n for n in inner if not any(trie[c].children for c in trie[n].children.values())]
    return sorted(lowest, key=lambda number: _path(trie, number))


def _path(trie: Sequence[_Node], number: int) -> tuple[int, ...]:
    path = []
    while number:
        path.append(number)
        number = trie[number].parent
    return tuple(path[::-1])


def _log_sum_exp(logits: NDArray[np.float32]) -> Floats:
    top = logits.max(axis=1)
    if not np.isfinite(top).all():
        raise ModelError("the model's logits are not numbers: damaged weights")
    total = np.exp(logits - top[:, None]).sum(axis=1)
    found: Floats = top.astype(np.float64) + np.log(total.astype(np.float64))
    return found
