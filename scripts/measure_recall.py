"""How often recall puts a right unit first, before and after, with control rows.

    python scripts/measure_recall.py [--shared ../shared/data/recall] [--draws 3] [--save FILE]
        [--embedder minilm | sentence:NAME]
    python scripts/measure_recall.py --words karma/plugins/rules/wording/type_words.json

Questions are our own, in words that no part of the project is trained on or embeds
(`eval/recall/questions.jsonl`; what drew them is in the history, at commit c96376b), and those of
the reference data where they are there. R@1 in memories of 10 and 40 units, with 95 % intervals
over words or tasks. `marks`: which units are marked as handled: the question's ("lived"), none
("none"), or others ("against"). "before" are the figures that
`eval/recall/before.json` kept of the recall as it was; --save writes such a file. The recall is
that of an experiment's row without options. --words writes what types are called, on the training
side, with vectors, for recall to read (minutes).
"""

import os
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import typer
from measuring import table
from support.recall_questions import (
    CONTROLS,
    DRAWS,
    Asked,
    InOrder,
    Marks,
    RecallQuestion,
    ask,
    read_alfred_l,
    read_household,
    read_questions,
)

from karma import registry
from karma.agent.loading.models import Models, load_resources
from karma.bench.figures.statistics import interval_text
from karma.errors import FileError
from karma.files import read_json, to_json, write_atomic
from karma.offline.guard import go_offline
from karma.plugins.rules.wording.hints import write_words
from karma.plugins.training.hinted import words_file
from karma.types.roles import Recall

OURS = Path("eval/recall/questions.jsonl")
BEFORE = Path("eval/recall/before.json")
SHARED = Path(os.environ.get("KARMA_SHARED", "../shared")) / "data" / "recall"
SIZES = (10, 40)
MARKS: tuple[Marks, ...] = ("lived", "none", "against")


def main(
    words: Path | None = None,
    shared: Path = SHARED,
    draws: int = DRAWS,
    save: Path | None = None,
    embedder: str = Models().embedder,
) -> None:
    """Ask all questions, and print a table for each set."""
    go_offline()
    if words:
        write_words(words, words_file(()), registry.load("embedders", "minilm")())
        return
    recall = load_resources(Models(embedder=embedder), maps=None, seed=0).recall
    sets = question_sets(shared)
    found = {name: asked_all(recall, questions, draws) for name, questions in sets.items()}
    if save:
        write_atomic(save, to_json(found, indent=1))
    kept = read_json(BEFORE, dict[str, list[Asked]]) if BEFORE.exists() else {}
    for name, rows in found.items():
        print(f"\n{name}\n")
        kinds = list(rows[0].by_kind)
        table(f"units | row | marks | {' | '.join(kinds)}", shown(kept.get(name, []), rows, kinds))


def question_sets(shared: Path) -> dict[str, list[RecallQuestion]]:
    """Return our own questions and, where they are, those of the reference data."""
    sets = {"ours": read_questions(OURS)}
    readers = {
        "household": ("household_odd.jsonl", read_household),
        "alfred-l": ("alfred_l_odd.jsonl", read_alfred_l),
        "alfred-l, phrases": ("alfred_l_odd.jsonl", partial(read_alfred_l, phrases=True)),
    }
    for name, (file, read) in readers.items():
        path = shared / file
        try:
            sets[name] = read(path)
        except FileError as error:
            print(f"{name}: not asked: {error}")
    return sets


def asked_all(recall: Recall, questions: list[RecallQuestion], draws: int) -> list[Asked]:
    """Return the rows of a set: recall with every kind of marks, and controls."""
    rows: dict[tuple[str, Marks], Recall] = {("recall", marks): recall for marks in MARKS}
    rows |= {(by, "lived"): InOrder(by) for by in CONTROLS}
    return [row for units in SIZES for row in ask(rows, questions, units, draws=draws)]


def shown(
    before: list[Asked], after: list[Asked], kinds: list[str]
) -> Iterator[tuple[object, ...]]:
    """Yield the rows of a set, before and after."""
    rows = {(row.units, row.marks, row.row): row for row in before if row.row == "recall"}
    for row in after:
        old = rows.get((row.units, row.marks, row.row))
        for label, shown in (("before", old), ("after" if old else row.row, row)):
            if shown is not None:
                cells = (interval_text(shown.by_kind[kind]) for kind in kinds)
                yield shown.units, label, shown.marks, *cells


if __name__ == "__main__":
    typer.run(main)
