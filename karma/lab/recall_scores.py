"""How often a recall puts a right unit first: R@1 by class, with intervals and control rows."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from karma.bench.statistics import Estimate, mean
from karma.contracts import MemoryUnit, Recall, Recalled
from karma.lab.recall_questions import Marks, RecallQuestion, marked, memory_of
from karma.seeds import stream

DRAWS = 3  # memories a question


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
    rows: Mapping[tuple[str, Marks], Recall],
    questions: Iterable[RecallQuestion],
    units: int,
    *,
    draws: int = DRAWS,
) -> list[Asked]:
    """Ask every question over several memories, the same ones for all rows.

    Args:
        rows: (what it is called in the table, who is marked as handled) -> what is measured.
        questions: of all classes.
        units: size of the memories.
        draws: memories a question.
    """
    hits: dict[tuple[str, Marks], dict[str, dict[str, list[float]]]] = {row: {} for row in rows}
    for question in questions:
        for number in range(draws):
            memory = memory_of(question, units, number)
            for row, recall in rows.items():
                right = is_right(recall, question, marked(memory, question, row[1]))
                for kind in question.kinds:
                    of_kind = hits[row].setdefault(kind, {})
                    of_kind.setdefault(question.group, []).append(float(right))
    return [
        Asked(
            row=name,
            units=units,
            marks=marks,
            by_kind={kind: mean(list(groups.values())) for kind, groups in by_kind.items()},
        )
        for (name, marks), by_kind in hits.items()
    ]


def is_right(recall: Recall, question: RecallQuestion, units: Sequence[MemoryUnit]) -> bool:
    """Return whether the first unit, those skipped left out, is a right one."""
    found = recall.recall(question.text, units, len(question.skipped) + 1)
    first = next(one.unit.object_id for one in found if one.unit.object_id not in question.skipped)
    return first in question.right
