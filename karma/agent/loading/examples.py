"""The examples that a planner is told, nearest to the request: of the written bank, or another."""

import hashlib
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from karma.agent.loading.alfred_sentences import names_its_place, read_sentences
from karma.agent.loading.example_memory import ExampleMemory
from karma.agent.loading.planner_files import learnt_embedder
from karma.agent.loading.said_requests import load_said
from karma.agent.planning.expert import ExpertView
from karma.agent.planning.goal_lines import as_lines
from karma.agent.planning.plain_programs import plain_program
from karma.contracts import Embedder, Examples, Vectors, WorkedExample
from karma.errors import FileError, KarmaError
from karma.files import cache, read_bytes, shipped, write_atomic
from karma.infer.embed.minilm import FILES

EXAMPLES = 4  # told to a planner with the full prompt, if nothing else is said
_HASH = 32  # bytes of SHA-256 before what is kept


def bank_file(named: str = "") -> Path:
    """Return the file of sentences: the one that is named, else the one that ships."""
    return Path(named) if named else shipped("eval") / "requests" / "written.jsonl"


def read_bank(path: Path, *, goals: bool = False) -> Iterator[WorkedExample]:
    """Yield sentences with their programs; those to be refused are left out.

    Of requests as `eval/requests/written.jsonl`, or of ALFRED's demonstrations, gzipped.

    Raises:
        FileError: a line is none, or there is no sentence to be done.
    """
    if path.suffix == ".gz":
        people = filter(names_its_place, read_sentences(path))
        said = ((one.text, one.wanted) for one in people)
    else:
        said = ((one.text, one.wanted) for one in load_said(path) if one.goals)
    write = as_lines if goals else partial(plain_program, view=ExpertView())
    count = 0
    for text, wanted in said:
        if calls := write(wanted):
            count += 1
            yield WorkedExample(instruction=text, program="\n".join(map(str, calls)))
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

    Raises:
        FileError: the file is missing or torn.
    """
    if not count:
        return None
    embedder = learnt_embedder(embedder)
    path = bank_file(named)
    bank = _bank(path, path.stat().st_mtime if path.is_file() else 0.0, goals)
    memory = ExampleMemory(embedder, bank, kept_vectors(embedder, [e.instruction for e in bank]))
    return lambda instruction: memory.nearest(instruction, count)[::-1]
