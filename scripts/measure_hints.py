"""Measure how often hints name the right type or deed, by class of word.

python scripts/measure_hints.py models/nano/words.json             # known words, as if never seen
python scripts/measure_hints.py models/nano/words.json --held-out  # lexemes that are held out

Columns: class, way of scoring, words, right meaning first, among the first three (95 % intervals).
"""

from pathlib import Path
from typing import Annotated

import typer

from karma import registry
from karma.files import read_json
from karma.language.hints import WordFile
from karma.offline import go_offline
from karma.training.planner.hint_figures import asked_words, figures
from karma.training.planner.hinted import KeptRows


def main(
    words: Path,
    held_out: Annotated[bool, typer.Option("--held-out", help="Ask for held-out words.")] = False,
    rows: Annotated[Path, typer.Option(help="Keeps vectors from run to run.")] = Path(
        "runs/hint_rows.safetensors"
    ),
) -> None:
    """Print one line per class of words and way of scoring."""
    go_offline()
    rows.parent.mkdir(parents=True, exist_ok=True)
    kept = KeptRows(registry.load("embedders", "minilm")(), rows)
    for line in figures(read_json(words, WordFile), kept, list(asked_words(unseen=held_out))):
        print(line)
    kept.save()


if __name__ == "__main__":
    typer.run(main)
