"""A run or a sweep for other programs: one line per episode as CSV or Parquet, or JUnit's XML.

All three are the same bytes however often the run was stopped, but for the columns of seconds.
"""

import csv
import io
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET  # written only

from karma.agent.journal.not_run import NotRun
from karma.agent.journal.owned_folder import kind_in
from karma.agent.journal.records import EpisodeRecord
from karma.agent.journal.run_folder import RunData, read_run
from karma.bench.engine.sweep_folder import SweptCell, read_sweep
from karma.bench.figures.metrics import METRICS, Metric, TimedEpisode, episodes_of
from karma.errors import KarmaError

if TYPE_CHECKING:
    import pyarrow

_NO_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_TEXTS = ("run", "cell", "row", "method", "task", "kind", "scene", "error", "unjudged")
_NUMBERS = ("seed", "instructions")


@dataclass(frozen=True, slots=True, kw_only=True)
class _ExportedRun:
    """A run, and the cell of a sweep that it is."""

    run: RunData | None  # None where a cell has not begun
    cell: SweptCell | None = None


def exported(folder: Path, form: str) -> bytes:
    """Return a run or sweep in one of `FORMS`.

    Raises:
        FileError: there is no run, or a line of it is damaged.
        KarmaError: there is no such form, or what it needs is not installed.
    """
    if form not in FORMS:
        raise KarmaError(f"--to {form}: there is {', '.join(FORMS)}\n  To fix: --to csv")
    return FORMS[form](folder)


def to_arrow(folder: str | Path) -> "pyarrow.Table":
    """Return one line per episode as an Arrow table; `.to_pandas()` makes a DataFrame of it.

    Columns are those of the CSV: the run, a sweep's keys, what names the episode, whether it
    succeeded, and each metric, null where it is not measured.

    Raises:
        FileError: there is no run, or a line of it is damaged.
        KarmaError: pyarrow is not installed.
    """
    pyarrow = _pyarrow()
    names, lines = episode_lines(Path(folder))
    metrics = {metric.key for metric in METRICS}
    kinds = {
        name: pyarrow.float64()
        if name in metrics
        else pyarrow.int64()
        if name in _NUMBERS
        else pyarrow.bool_()
        if name == "succeeded"
        else pyarrow.string()
        for name in names
    }
    schema = pyarrow.schema(list(kinds.items()))
    return pyarrow.Table.from_pylist(lines, schema=schema)


def to_parquet(folder: Path) -> bytes:
    """Return the table of `to_arrow` as a Parquet file."""
    table = to_arrow(folder)
    from pyarrow import BufferOutputStream, parquet

    out = BufferOutputStream()
    parquet.write_table(table, out)
    data: bytes = out.getvalue().to_pybytes()
    return data


def to_csv(folder: Path) -> bytes:
    """Return one line per episode; what is not measured is empty."""
    names, lines = episode_lines(folder)
    out = io.StringIO()
    quoted: Any = csv.QUOTE_NONNUMERIC  # else a lone carriage return would end a line
    writer = csv.DictWriter(out, names, lineterminator="\n", quoting=quoted)
    writer.writeheader()
    writer.writerows(lines)
    return out.getvalue().encode()


def to_junit(folder: Path) -> bytes:
    """Return a test suite per row and a test case per episode, as JUnit's XML."""
    root = ET.Element("testsuites", name=_safe(folder.resolve().name))
    for part in _parts(folder):
        cell = part.cell.name if part.cell else ""
        if part.cell is not None and part.cell.failed:
            suite = _suite(root, cell, tests=1, errors=1)
            case = ET.SubElement(suite, "testcase", classname=_safe(cell), name="cell")
            _said(case, "error", part.cell.failed.partition("\n")[0], part.cell.failed)
        records = part.run.records if part.run else ()
        others = part.run.not_run if part.run else ()
        for row in dict.fromkeys([*(one.row for one in records), *(one.row for one in others)]):
            mine = [record for record in records if record.row == row]
            rest = [one for one in others if one.row == row]
            _add_row(root, " · ".join(filter(None, (cell, row))), mine, rest)
    data: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return data + b"\n"


FORMS: dict[str, Callable[[Path], bytes]] = {
    "csv": to_csv,
    "parquet": to_parquet,
    "junit": to_junit,
}


# ----------------------------------------------------------------- lines


def _parts(folder: Path) -> list[_ExportedRun]:
    if kind_in(folder) != "sweep":
        return [_ExportedRun(run=read_run(folder))]
    data = read_sweep(folder)
    return [_ExportedRun(run=data.run(cell), cell=cell) for cell in data.cells]


def episode_lines(folder: Path) -> tuple[list[str], list[dict[str, Any]]]:
    """Return the names of all columns, and a line per episode; None is not measured.

    Raises:
        FileError: there is no run, or a line of it is damaged.
    """
    parts = _parts(folder)
    keys = dict.fromkeys(key for part in parts if part.cell for key in part.cell.values)
    first, metrics = ("run", *(("cell",) if keys else ())), [metric.key for metric in METRICS]
    own = {key: f"set.{key}" for key in keys}  # no key of a grid is another column's name
    rest = [name for name in _TEXTS if name not in ("run", "cell")]
    names = [*first, *own.values(), *rest, *_NUMBERS, "succeeded", *metrics]
    lines = []
    for part in parts:
        if part.run is None:
            continue
        said: dict[str, Any] = {"run": part.run.header.name}
        if part.cell is not None:
            said |= {"cell": part.cell.name}
            said |= {own[key]: value for key, value in part.cell.values.items()}
        lines += [said | one for one in _of_run(part.run)]
    return names, lines


def _episodes(run: RunData) -> Iterator[TimedEpisode]:
    """Yield the episodes of a run, also those that nobody is judged by."""
    judged = {one.record.key: one for one in episodes_of(run.records, run.timings)}
    for record in run.records:
        yield judged.get(record.key, TimedEpisode(record=record))


def _of_run(run: RunData) -> Iterator[dict[str, Any]]:
    """Yield a line per episode, with the metrics that its row has."""
    has = {
        row: [
            metric
            for metric in METRICS
            if metric.only is None or any(metric.only(r) for r in run.records if r.row == row)
        ]
        for row in dict.fromkeys(record.row for record in run.records)
    }
    for episode in _episodes(run):
        yield _line(episode, has[episode.record.row])


def _line(episode: TimedEpisode, metrics: Sequence[Metric]) -> dict[str, Any]:
    record = episode.record
    return {
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
        **dict.fromkeys((metric.key for metric in METRICS), None),
        **{metric.key: _value(metric, episode) for metric in metrics},
    }


def _value(metric: Metric, episode: TimedEpisode) -> float | None:
    """Return the mean of an episode's observations; None where it is not measured."""
    if episode.record.unjudged:
        return None
    seen = metric.of(episode)
    return float(sum(seen) / len(seen)) if len(seen) else None


def _pyarrow() -> Any:
    try:
        import pyarrow
    except ImportError as error:
        raise KarmaError(
            f"Parquet and tables of Arrow need the package pyarrow: {error}\n"
            "  To fix: pip install 'karma-offline[export]', or --to csv"
        ) from error
    return pyarrow


# ----------------------------------------------------------------- JUnit


def _suite(root: ET.Element, name: str, **counts: int) -> ET.Element:
    said = {key: str(value) for key, value in counts.items()}
    return ET.SubElement(root, "testsuite", {"name": _safe(name), **said})


def _add_row(
    root: ET.Element, name: str, records: Sequence[EpisodeRecord], others: Sequence[NotRun]
) -> None:
    """Add a test suite with a case for each episode."""
    judged = [record for record in records if not record.unjudged]
    errors = sum(bool(record.error) for record in judged)
    suite = _suite(
        root,
        name,
        tests=len(records) + len(others),
        failures=sum(not record.success for record in judged) - errors,
        errors=errors + len(others),
        skipped=len(records) - len(judged),
    )

    def case_of(task: str, seed: int) -> ET.Element:
        text = _safe(f"{task} (seed {seed})")
        return ET.SubElement(suite, "testcase", classname=_safe(name), name=text)

    for one in others:
        reason = f"not run: {one.reason}"
        _said(case_of(one.task, one.seed), "error", reason.partition("\n")[0], reason)
    for record in records:
        case = case_of(record.task, record.seed)
        if record.unjudged:
            _said(case, "skipped", record.unjudged)
        elif record.error:
            _said(case, "error", record.error.partition("\n")[0], record.error)
        elif not record.success:
            unmet = [sub for sub in record.subtasks if sub.unmet]
            lines = [f"{sub.instruction}: unmet {', '.join(sub.unmet)}" for sub in unmet]
            _said(case, "failure", lines[0] if lines else "no goal was asked", "\n".join(lines))


def _said(case: ET.Element, kind: str, message: str, text: str = "") -> None:
    ET.SubElement(case, kind, message=_safe(message)).text = _safe(text)


def _safe(text: str) -> str:
    """Return a text without the letters that XML cannot hold."""
    return _NO_XML.sub("\N{REPLACEMENT CHARACTER}", text)
