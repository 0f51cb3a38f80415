"""The examples that a planner is told, nearest to the request: of the written bank, or another."""

from collections.abc import Iterator
from functools import lru_cache, partial
from pathlib import Path

from karma import registry
from karma.agent.expert import ExpertView
from karma.agent.goal_lines import as_lines
from karma.agent.plain_programs import plain_program
from karma.contracts import Embedder, Examples, WorkedExample
from karma.errors import FileError
from karma.methods.example_memory import ExampleMemory
from karma.places import shipped
from karma.tasks.drawing.alfred import names_its_place, read_sentences
from karma.tasks.requests import load_said

EXAMPLES = 4  # told to a planner with the full prompt, if nothing else is said
_EMBEDDER = "minilm"  # whatever recall uses, so that equal runs have equal examples


def bank_file(named: str = "") -> Path:
    """Return the file of sentences: the one that is named, else the one that ships."""
    return Path(named) if named else shipped("eval") / "requests" / "written.jsonl"


def read_bank(path: Path, *, goals: bool = False) -> Iterator[WorkedExample]:
    """Yield sentences with their programs; those to be refused are left out.

    Args:
        path: of requests, as `eval/requests/written.jsonl`; or of ALFRED's demonstrations, gzipped.
        goals: their goals as lines, in place of programs.

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


@lru_cache(maxsize=2)
def _memory(embedder: Embedder, path: Path, goals: bool) -> ExampleMemory:
    return ExampleMemory(embedder, tuple(read_bank(path, goals=goals)))


def examples_for(
    count: int, named: str = "", embedder: Embedder | None = None, *, goals: bool = False
) -> Examples | None:
    """Return what finds a planner's examples, the nearest last; None for none.

    Args:
        count: examples told.
        named: a file of sentences in place of the one that ships.
        embedder: that is loaded already; another one is not used.
        goals: as lines of goals, not as programs.

    Raises:
        FileError: the file is missing or torn.
    """
    if not count:
        return None
    if embedder is None or embedder.name != _EMBEDDER:
        embedder = registry.load("embedders", _EMBEDDER)()
    memory = _memory(embedder, bank_file(named), goals)  # type: ignore[arg-type]
    return lambda instruction: memory.nearest(instruction, count)[::-1]
