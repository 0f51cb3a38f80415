"""A run or a sweep as TensorBoard's event files, for who looks at everything there."""

from collections.abc import Iterator
from pathlib import Path

from karma.bench.export import episode_lines
from karma.bench.metrics import METRICS
from karma.bench.steps import slug
from karma.errors import FileError, KarmaError

MEAN = "success, mean so far"


def write_tensorboard(folder: Path, out: Path) -> int:
    """Write a folder of event files per row, and per cell of a sweep; steps count its episodes.

    Args:
        folder: of the run or the sweep.
        out: a folder that is not there yet, or empty.

    Returns:
        How many episodes were written.

    Raises:
        FileError: there is no run, a line of it is damaged, or `out` holds something.
        KarmaError: tensorboard is not installed.
    """
    try:
        from tensorboard.summary import Writer
    except ImportError as error:
        raise KarmaError(
            f"TensorBoard's files need the package tensorboard: {error}\n"
            "  To fix: pip install 'karma-offline[tensorboard]', or --to csv"
        ) from error
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise FileError(out, "is there already", fix="--out another folder")
    _, lines = episode_lines(folder)
    rows: dict[Path, list[dict[str, object]]] = {}
    for line in lines:
        cell = slug(str(line["cell"])) if "cell" in line else ""
        rows.setdefault(out / cell / slug(str(line["row"])), []).append(line)
    for place, mine in rows.items():
        writer = Writer(str(place))
        for step, (tag, value) in _scalars(mine):
            writer.add_scalar(tag, value, step)
        writer.close()
    return len(lines)


def _scalars(lines: list[dict[str, object]]) -> Iterator[tuple[int, tuple[str, float]]]:
    """Yield step, tag and value of what is measured; what is not has no point."""
    done = 0
    for step, line in enumerate(line for line in lines if not line["unjudged"]):
        for metric in METRICS:
            value = line[metric.key]
            if isinstance(value, float):
                yield step, (metric.key, value)
        done += bool(line["succeeded"])
        yield step, (MEAN, done / (step + 1))
