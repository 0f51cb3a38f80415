"""What belongs to a planner: its words file, for hints, and its examples."""

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from copy import copy
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from karma import registry
from karma.agent.goals.files import SaidRequest, load_said
from karma.agent.planning.expert import ExpertView
from karma.agent.planning.goal_lines import as_lines, plain_program
from karma.contracts import Embedder, Examples, Hints, Vectors, WorkedExample
from karma.errors import FileError, KarmaError
from karma.files import cache, read_bytes, shipped, write_atomic
from karma.language.hints import Hinter, load_words
from karma.models.embed.minilm import FILES
from karma.models.manifest import (
    check_file,
    file_paths,
    find_model,
    is_gguf_path,
    resolve_planner,
)
from karma.plugins.alfred.sentences import Sentence, names_its_place, read_sentences

WORDS = "words.json"  # beside a GGUF that has no entry, if it has one
NO_WORDS = "none"  # as a words file: no hints
_EMBEDDER = "minilm"  # whatever recall uses: planners have learnt its similarities


def may_refuse(planner: str, said: bool | None = None) -> bool:
    """Return whether a local planner may refuse: as said, else where it has learnt to."""
    return resolve_planner(planner).refuses if said is None else said


def hints_for(planner: str, words: str = "", embedder: Embedder | None = None) -> Hints | None:
    """Return what gives a planner its hints; None where it has not learnt to read them.

    `words` is a words file in place of the planner's own, "none" for no hints.
    """
    path = chosen_words(planner, words)
    if path is None:
        return None
    embedder = learnt_embedder(embedder)
    return Hinter(load_words(path, embedder), embedder).hints


def learnt_embedder(loaded: Embedder | None) -> Embedder:
    """Return the embedder that hints and examples go by: the one that is loaded, if it is that."""
    if loaded is not None and loaded.name == _EMBEDDER:
        return loaded
    found: Embedder = registry.load("embedders", _EMBEDDER)()
    return found


def chosen_words(planner: str, words: str = "") -> Path | None:
    """Return the words file that is used: the one that is named, else the planner's own."""
    if words:
        return None if words == NO_WORDS else Path(words)
    if is_gguf_path(planner):
        path = Path(planner).with_name(WORDS)
        return path if path.exists() else None
    entry = find_model(planner)  # its files are checked, with the vectors
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


def bank_file(named: str = "") -> Path:
    """Return the file of sentences: the one that is named, else the one that ships."""
    return Path(named) if named else shipped("eval") / "requests" / "written.jsonl"


def read_bank(path: Path, *, goals: bool = False) -> Iterator[WorkedExample]:
    """Yield sentences with their programs, less those to be refused; FileError for none.

    Of requests as `eval/requests/written.jsonl`, or of ALFRED's demonstrations, gzipped.
    """
    said: Iterable[Sentence | SaidRequest]
    if path.suffix == ".gz":
        said = (one for one in read_sentences(path) if names_its_place(one))
    else:
        said = (one for one in load_said(path) if one.goals)
    write = as_lines if goals else partial(plain_program, view=ExpertView())
    count = 0
    for one in said:
        if calls := write(one.wanted):
            count += 1
            yield WorkedExample(instruction=one.text, program="\n".join(map(str, calls)))
    if not count:
        raise FileError(path, "holds no sentence with goals", fix="see eval/requests/README.md")


@lru_cache(maxsize=4)
def _bank(path: Path, changed: float, goals: bool) -> tuple[WorkedExample, ...]:
    """Return a bank that was changed then, in seconds."""
    return tuple(read_bank(path, goals=goals))


def kept_vectors(embedder: Embedder, texts: Sequence[str]) -> Vectors:
    """Return the vectors of a bank's sentences, computed once: 15 ms each, for 700 ten seconds.

    They are kept in `karma.files.cache`, by the hash of model and sentences; where that cannot be
    written, or what is there is damaged, they are computed.
    """
    key = hashlib.sha256("\0".join([*FILES.values(), *texts]).encode()).hexdigest()
    path = cache() / "vectors" / f"{key}.f32"
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


def examples_for(
    count: int, named: str = "", embedder: Embedder | None = None, *, goals: bool = False
) -> Examples | None:
    """Return what finds a planner's examples, the nearest last; None for none.

    `named` is a file of sentences in place of the one that ships.
    """
    if not count:
        return None
    embedder = learnt_embedder(embedder)
    path = bank_file(named)
    bank = _bank(path, path.stat().st_mtime if path.is_file() else 0.0, goals)
    memory = ExampleMemory(embedder, bank, kept_vectors(embedder, [e.instruction for e in bank]))
    return lambda instruction: memory.nearest(instruction, count)[::-1]
