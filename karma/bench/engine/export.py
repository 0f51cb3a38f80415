"""Write a run for other programs: one line per episode as CSV.

The bytes do not depend on how often the run was stopped, but for the columns of seconds.
"""

import csv
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from karma.bench.figures.metrics import METRICS, episodes_of
from karma.journal.run_folder import RunData, read_run

_TEXTS = ("run", "row", "method", "task", "kind", "scene", "error", "unjudged")
_NUMBERS = ("seed", "instructions")


def to_csv(folder: Path) -> bytes:
    """Return one line per episode; what is not measured is empty."""
    names, lines = episode_lines(folder)
    out = io.StringIO()
    quoted: Any = csv.QUOTE_NONNUMERIC  # else a lone carriage return would end a line
    writer = csv.DictWriter(out, names, lineterminator="\n", quoting=quoted)
    writer.writeheader()
    writer.writerows(lines)
    return out.getvalue().encode()


# ----------------------------------------------------------------- lines


def episode_lines(folder: Path) -> tuple[list[str], list[dict[str, Any]]]:
    """Return the names of all columns, and a line per episode; None is not measured.

    Raises:
        FileError: there is no run, or a line of it is damaged.
    """
    run = read_run(folder)
    names = [*_TEXTS, *_NUMBERS, "succeeded", *(metric.key for metric in METRICS)]
    return names, [{"run": run.header.name, **line} for line in _of_run(run)]


def _of_run(run: RunData) -> Iterator[dict[str, Any]]:
    """Yield a line per episode, with the means of the metrics that its row has."""
    judged = {one.record.key: one for one in episodes_of(run.records, run.timings)}
    has = {
        row: [
            metric
            for metric in METRICS
            if metric.only is None or any(metric.only(r) for r in run.records if r.row == row)
        ]
        for row in dict.fromkeys(record.row for record in run.records)
    }
    for record in run.records:
        episode = judged.get(record.key)
        metrics = has[record.row] if episode else ()
        seen = {metric.key: metric.of(episode) for metric in metrics if episode}
        yield {
            "row": record.row,
            "method": record.method,
            "task": record.task,
            "kind": record.kind,
            "scene": record.scene,
            "error": record.error,
            "unjudged": record.unjudged,
            "seed": record.seed,
            "instructions": len(record.subtasks),
            "succeeded": None if record.unjudged else record.success,
            **dict.fromkeys(metric.key for metric in METRICS),
            **{key: float(sum(one) / len(one)) for key, one in seen.items() if len(one)},
        }
