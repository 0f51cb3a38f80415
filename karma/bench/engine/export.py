"""A run or a sweep for other programs: one line per episode as CSV or Parquet, or JUnit's XML.

All three are the same bytes however often the run was stopped, but for the columns of seconds.
"""

import csv
import io
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET  # written only

from karma.agent.journal.owned_folder import kind_in
from karma.agent.journal.records import EpisodeRecord, NotRun
from karma.agent.journal.run_folder import RunData, read_run
from karma.bench.engine.sweep_folder import SweptCell, read_sweep
from karma.bench.figures.metrics import METRICS, episodes_of
from karma.errors import KarmaError

if TYPE_CHECKING:
    import pyarrow

_NO_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_TEXTS = ("run", "cell", "row", "method", "task", "kind", "scene", "error", "unjudged")
_NUMBERS = ("seed", "instructions")


_Part = tuple[RunData | None, SweptCell | None]  # of a sweep a cell; None: it has not begun
_Case = tuple[str, str, str, str]  # name, kind of its end ("" succeeded), message, text


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
    kinds = {
        **dict.fromkeys((metric.key for metric in METRICS), pyarrow.float64()),
        **dict.fromkeys(_NUMBERS, pyarrow.int64()),
        "succeeded": pyarrow.bool_(),
    }
    schema = pyarrow.schema([(name, kinds.get(name, pyarrow.string())) for name in names])
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
    for run, cell in _parts(folder):
        name = cell.name if cell else ""
        if cell is not None and cell.failed:
            failed: _Case = ("cell", "error", cell.failed.partition("\n")[0], cell.failed)
            _add_suite(root, name, [failed], ("tests", "errors"))
        records, others = (run.records, run.not_run) if run else ((), ())
        for row in dict.fromkeys([*(one.row for one in records), *(one.row for one in others)]):
            cases = list(_cases(records, others, row))
            _add_suite(root, " · ".join(filter(None, (name, row))), cases)
    data: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return data + b"\n"


FORMS: dict[str, Callable[[Path], bytes]] = {
    "csv": to_csv,
    "parquet": to_parquet,
    "junit": to_junit,
}


# ----------------------------------------------------------------- lines


def _parts(folder: Path) -> list[_Part]:
    if kind_in(folder) != "sweep":
        return [(read_run(folder), None)]
    data = read_sweep(folder)
    return [(data.run(cell), cell) for cell in data.cells]


def episode_lines(folder: Path) -> tuple[list[str], list[dict[str, Any]]]:
    """Return the names of all columns, and a line per episode; None is not measured.

    Raises:
        FileError: there is no run, or a line of it is damaged.
    """
    parts = _parts(folder)
    keys = dict.fromkeys(key for _, cell in parts if cell for key in cell.values)
    first, metrics = ("run", *(("cell",) if keys else ())), [metric.key for metric in METRICS]
    own = {key: f"set.{key}" for key in keys}  # no key of a grid is another column's name
    rest = [name for name in _TEXTS if name not in ("run", "cell")]
    names = [*first, *own.values(), *rest, *_NUMBERS, "succeeded", *metrics]
    lines = []
    for run, cell in parts:
        if run is None:
            continue
        said: dict[str, Any] = {"run": run.header.name}
        if cell is not None:
            said |= {"cell": cell.name, **{own[key]: value for key, value in cell.values.items()}}
        lines += [said | one for one in _of_run(run)]
    return names, lines


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


def _cases(records: Sequence[EpisodeRecord], others: Sequence[NotRun], row: str) -> Iterator[_Case]:
    """Yield a test case for each episode of a row."""
    for one in others:
        if one.row == row:
            reason = f"not run: {one.reason}"
            yield f"{one.task} (seed {one.seed})", "error", reason.partition("\n")[0], reason
    for record in records:
        if record.row == row:
            yield f"{record.task} (seed {record.seed})", *_end_of(record)


def _end_of(record: EpisodeRecord) -> tuple[str, str, str]:
    if record.unjudged:
        return "skipped", record.unjudged, ""
    if record.error:
        return "error", record.error.partition("\n")[0], record.error
    if record.success:
        return "", "", ""
    unmet = [sub for sub in record.subtasks if sub.unmet]
    lines = [f"{sub.instruction}: unmet {', '.join(sub.unmet)}" for sub in unmet]
    return "failure", lines[0] if lines else "no goal was asked", "\n".join(lines)


def _add_suite(
    root: ET.Element,
    name: str,
    cases: Sequence[_Case],
    counted: Sequence[str] = ("tests", "failures", "errors", "skipped"),
) -> None:
    ends = Counter(end for _, end, _, _ in cases)
    counts = {"tests": len(cases), "failures": ends["failure"], "errors": ends["error"]}
    counts["skipped"] = ends["skipped"]
    said = {key: str(counts[key]) for key in counted}
    suite = ET.SubElement(root, "testsuite", {"name": _safe(name), **said})
    for title, end, message, text in cases:
        case = ET.SubElement(suite, "testcase", classname=_safe(name), name=_safe(title))
        if end:
            ET.SubElement(case, end, message=_safe(message)).text = _safe(text)


def _safe(text: str) -> str:
    """Return a text without the letters that XML cannot hold."""
    return _NO_XML.sub("\N{REPLACEMENT CHARACTER}", text)
