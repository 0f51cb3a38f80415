"""How often a recall puts a right unit first: R@1 by class, with intervals and control rows."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from karma.bench.statistics import Estimate, mean
from karma.contracts import MemoryUnit, Recall, Recalled
from karma.lab.recall_questions import Marks, RecallQuestion, memory_of
from karma.seeds import stream

DRAWS = 10  # memories a question


class InOrder:
    """A control row: units by an order that does not read the question.

    Args:
        by: "chance" shuffles them, "recency" has the last handled first, "handled" has what was
            handled first, in any order.
        seed: of the shuffles.
    """

    def __init__(self, by: str, *, seed: int = 0) -> None:
        self._by, self._seed = by, seed

    def recall(self, query: str, units: Sequence[MemoryUnit], k: int) -> list[Recalled]:
        """Return the first k of that order, all with similarity 0."""
        found = list(units)
        if self._by == "recency":
            found.reverse()
        else:
            ids = "/".join(unit.object_id for unit in units)
            stream(self._seed, "recall", self._by, query, ids).shuffle(found)
        if self._by != "chance":
            found.sort(key=lambda unit: not unit.handled)
        return [Recalled(unit=unit, similarity=0.0) for unit in found[:k]]


CONTROLS = ("chance", "recency", "handled")


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """One row of the table: R@1 by class."""

    row: str
    units: int
    marks: Marks
    by_kind: Mapping[str, Estimate]


def ask(
    row: str,
    recall: Recall,
    questions: Iterable[RecallQuestion],
    units: int,
    *,
    marks: Marks = "lived",
    draws: int = DRAWS,
) -> Asked:
    """Ask a recall every question over several memories.

    Args:
        row: what it is called in the table.
        recall: what is measured.
        questions: of all classes.
        units: size of the memories.
        marks: who is marked as handled, see `memory_of`.
        draws: memories a question.
    """
    hits: dict[str, dict[str, list[float]]] = {}
    for question in questions:
        found = [
            float(is_right(recall, question, memory_of(question, units, number, marks=marks)))
            for number in range(draws)
        ]
        for kind in question.kinds:
            hits.setdefault(kind, {}).setdefault(question.group, []).extend(found)
    by_kind = {kind: mean(list(groups.values())) for kind, groups in hits.items()}
    return Asked(row=row, units=units, marks=marks, by_kind=by_kind)


def is_right(recall: Recall, question: RecallQuestion, units: Sequence[MemoryUnit]) -> bool:
    """Return whether the first unit, those skipped left out, is a right one."""
    found = recall.recall(question.text, units, len(question.skipped) + 1)
    first = next(one.unit.object_id for one in found if one.unit.object_id not in question.skipped)
    return first in question.right
