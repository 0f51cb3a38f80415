"""What belongs to a planner: its words file, for hints, and its examples."""

import hashlib
from collections.abc import Sequence
from contextlib import suppress
from copy import copy
from functools import cache
from pathlib import Path

import numpy as np

from karma import registry
from karma.agent.planning.expert import ExpertView
from karma.agent.planning.plain_program import plain_program
from karma.errors import KarmaError
from karma.files import cache as cache_folder
from karma.files import read_bytes, shipped, write_atomic
from karma.goals.files import load_said
from karma.models.embed.minilm import FILES
from karma.models.manifest import (
    check_file,
    file_paths,
    find_model,
    is_gguf_path,
    resolve_planner,
)
from karma.types.planning import WorkedExample
from karma.types.roles import Embedder, Examples, PhraseReader
from karma.types.space import Vectors

WORDS = "words.json"  # beside a GGUF that has no entry, if it has one
_EMBEDDER = "minilm"  # whatever recall uses: planners have learnt its similarities


def may_refuse(planner: str, said: bool | None = None) -> bool:
    """Return whether a local planner may refuse: as said, else where it has learnt to."""
    return resolve_planner(planner).refuses if said is None else said


def reader_for(planner: str, embedder: Embedder | None = None) -> PhraseReader | None:
    """Return the reader of a planner that was trained with hints, else None.

    UnknownNameError without the plug-in that has it.
    """
    path = words_path(planner)
    if path is None:
        return None
    found: PhraseReader = registry.load("phrase_readers", "rules")(path, learnt_embedder(embedder))
    return found


def learnt_embedder(loaded: Embedder | None) -> Embedder:
    """Return the embedder that hints and examples go by: the one that is loaded, if it is that."""
    if loaded is not None and loaded.name == _EMBEDDER:
        return loaded
    found: Embedder = registry.load("embedders", _EMBEDDER)()
    return found


def words_path(planner: str) -> Path | None:
    """Return where a planner's words file lies, checked with its vectors, if it has one."""
    if is_gguf_path(planner):
        path = Path(planner).with_name(WORDS)
        return path if path.exists() else None
    entry = find_model(planner)
    named = entry.words
    if not named:
        return None
    places = dict(zip([file.path for file in entry.files], file_paths(entry), strict=True))
    for file in entry.files:
        if file.path.startswith(f"{named.rpartition('.')[0]}."):
            check_file(places[file.path], file.sha256, size=file.bytes, restore=entry.fix)
    return places[named]


# ----------------------------------------------------------------- worked examples


class ExampleMemory:
    """Finds worked examples by their instructions; examples are added, never removed.

    `vectors` of the seeds' instructions, shape (n, dimension), where they are known.
    """

    def __init__(
        self, embedder: Embedder, seeds: Sequence[WorkedExample], vectors: Vectors | None = None
    ) -> None:
        self._embedder, self._examples = embedder, list(seeds)
        if vectors is None:
            vectors = embedder.embed([example.instruction for example in seeds])
        self._vectors = vectors

    def __len__(self) -> int:
        return len(self._examples)

    def copy(self) -> "ExampleMemory":
        """Return an independent memory with the same examples."""
        twin = copy(self)
        twin._examples = list(self._examples)
        return twin

    def add(self, example: WorkedExample) -> None:
        """Remember one more example."""
        vector = self._embedder.embed([example.instruction])
        self._examples.append(example)
        self._vectors = np.concatenate([self._vectors, vector])

    def nearest(self, text: str, k: int) -> tuple[WorkedExample, ...]:
        """Return the k examples whose instructions are nearest to a text, the nearest first.

        By L2 distance, which orders vectors of length 1 as the cosine does; equals by age.
        """
        query = self._embedder.embed([text])[0]
        gaps = np.round(((self._vectors - query) ** 2).sum(axis=1), 6)
        order = sorted(range(len(self)), key=lambda row: (gaps[row], row))
        return tuple(self._examples[row] for row in order[:k])


EXAMPLES = 4  # told to a planner with the full prompt, if nothing else is said
_HASH = 32  # bytes of SHA-256 before what is kept


def bank_file() -> Path:
    """Return the file of sentences that ships."""
    return shipped("eval") / "requests" / "written.jsonl"


@cache
def read_bank() -> tuple[WorkedExample, ...]:
    """Return the sentences that ship, with their programs, less those to be refused."""
    said = (one for one in load_said(bank_file()) if one.goals)
    found = ((one.text, plain_program(one.wanted, ExpertView())) for one in said)
    return tuple(
        WorkedExample(instruction=text, program="\n".join(map(str, calls)))
        for text, calls in found
        if calls
    )


def kept_vectors(embedder: Embedder, texts: Sequence[str]) -> Vectors:
    """Return the vectors of a bank's sentences, computed once: 15 ms each, for 700 ten seconds.

    They are kept in `karma.files.cache`, by the hash of model and sentences; where that cannot be
    written, or what is there is damaged, they are computed.
    """
    key = hashlib.sha256("\0".join([*FILES.values(), *texts]).encode()).hexdigest()
    path = cache_folder() / "vectors" / f"{key}.f32"
    shape = len(texts), embedder.dimension
    with suppress(KarmaError, OSError):
        data = read_bytes(path)
        if hashlib.sha256(data[_HASH:]).digest() == data[:_HASH]:
            return np.frombuffer(data[_HASH:], "<f4").reshape(shape).astype(np.float32)
    vectors = embedder.embed(texts)
    data = vectors.astype("<f4").tobytes()
    with suppress(KarmaError, OSError):
        write_atomic(path, hashlib.sha256(data).digest() + data)
    return vectors


def examples_for(count: int, embedder: Embedder | None = None) -> Examples | None:
    """Return what finds a planner's examples, the nearest last; None for none.

    The bank is read with the first instruction: goal and tool mode need none of it.
    """

    @cache
    def memory() -> ExampleMemory:
        bank, found = read_bank(), learnt_embedder(embedder)
        return ExampleMemory(found, bank, kept_vectors(found, [e.instruction for e in bank]))

    return (lambda instruction: memory().nearest(instruction, count)[::-1]) if count else None
