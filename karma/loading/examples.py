"""The examples that a planner is told, nearest to the request: of the written bank, or another."""

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

from karma import registry
from karma.agent.expert import ExpertView
from karma.agent.plain_programs import plain_program
from karma.contracts import Embedder, Examples, WorkedExample
from karma.errors import FileError
from karma.methods.example_memory import ExampleMemory
from karma.places import shipped
from karma.tasks.drawing.alfred import names_its_place, program_of, read_sentences
from karma.tasks.requests import load_said

EXAMPLES = 4  # told to a planner with the full prompt, if nothing else is said
_EMBEDDER = "minilm"  # whatever recall uses, so that equal runs have equal examples


def bank_file(named: str = "") -> Path:
    """Return the file of sentences: the one that is named, else the one that ships."""
    return Path(named) if named else shipped("eval") / "requests" / "written.jsonl"


def read_bank(path: Path) -> Iterator[WorkedExample]:
    """Yield sentences with their programs; those to be refused are left out.

    Args:
        path: of requests, as `eval/requests/written.jsonl`; or of ALFRED's demonstrations, gzipped.

    Raises:
        FileError: a line is none, or there is no sentence to be done.
    """
    if path.suffix == ".gz":
        people = filter(names_its_place, read_sentences(path))
        said = ((one.text, program_of(one, ExpertView())) for one in people)
    else:
        ours = (one for one in load_said(path) if one.goals)
        said = ((one.text, plain_program(one.wanted, ExpertView())) for one in ours)
    count = 0
    for text, calls in said:
        if calls:
            count += 1
            yield WorkedExample(instruction=text, program="\n".join(map(str, calls)))
    if not count:
        raise FileError(path, "holds no sentence with goals", fix="see eval/requests/README.md")


@lru_cache(maxsize=2)
def _memory(embedder: Embedder, path: Path) -> ExampleMemory:
    return ExampleMemory(embedder, tuple(read_bank(path)))


def examples_for(count: int, named: str = "", embedder: Embedder | None = None) -> Examples | None:
    """Return what finds a planner's examples, the nearest last; None for none.

    Args:
        count: examples told.
        named: a file of sentences in place of the one that ships.
        embedder: that is loaded already; another one is not used.

    Raises:
        FileError: the file is missing or torn.
    """
    if not count:
        return None
    if embedder is None or embedder.name != _EMBEDDER:
        embedder = registry.load("embedders", _EMBEDDER)()
    memory = _memory(embedder, bank_file(named))  # type: ignore[arg-type]
    return lambda instruction: memory.nearest(instruction, count)[::-1]
