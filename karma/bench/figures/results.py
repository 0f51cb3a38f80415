"""Build results of a run from its folder, alone, beside other runs and beside the paper."""

import csv
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from karma.bench.figures.columns import COLUMNS, OFF_ROW, figures_of
from karma.bench.figures.compare import Arm, Comparison, arm_of, compare_kinds, rows_of
from karma.bench.figures.failures import Failure, failures
from karma.bench.figures.metrics import TimedEpisode, episodes_of
from karma.bench.figures.statistics import Estimate, interval_text
from karma.bench.figures.tables import PublishedFigures, Result, Sheet
from karma.errors import KarmaError
from karma.files import read_bytes, shipped
from karma.journal.formats import figure_text
from karma.journal.header import changed, options_apart, rows_apart, shared_apart
from karma.journal.records import in_words
from karma.journal.run_folder import RunData, read_run
from karma.journal.steps import read_steps, steps_path


def result_of(run: RunData, published: PublishedFigures) -> Result:
    """Return the figures behind the tables of a run.

    The run may be unfinished: a figure says how many episodes stand behind it.
    """
    episodes = episodes_of(run.records, run.timings)
    return Result(
        name=run.header.name,
        figures=figures_of(run.records, episodes),
        comparisons=_comparisons(run, episodes),
        failures=[one for episode in episodes for one in _failures(run, episode)],
        published=published,
    )


def _comparisons(run: RunData, episodes: list[TimedEpisode]) -> list[Comparison]:
    """Return the comparisons of the first row with all rows over the same episodes."""
    rows = rows_of(run.records)
    arms = [arm_of(run.records, episodes, row) for row in rows]
    asked = [
        {(episode.record.task, episode.record.seed) for episode in arm.episodes} for arm in arms
    ]
    return [
        comparison
        for arm, keys in zip(arms[1:], asked[1:], strict=True)
        if keys == asked[0]
        for comparison in compare_kinds(arms[0], arm)
    ]


def _failures(run: RunData, episode: TimedEpisode) -> tuple[Failure, ...]:
    if episode.record.success:
        return ()
    path = steps_path(run.folder, *episode.record.key)
    return failures(episode, read_steps(path) if path.exists() else None)


# ----------------------------------------------------------------- as CSV


def load_published() -> PublishedFigures:
    """Read the paper's figures."""
    text = read_bytes(shipped("eval") / "paper" / "published.csv").decode()
    return {
        (row["row"], row["kind"], row["metric"]): float(row["value"])
        for row in csv.DictReader(io.StringIO(text))
    }


def to_csv(result: Result) -> str:
    """Write the figures of a run as CSV with intervals and published values."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(
        ("row", "kind", "metric", "value", "low", "high", "episodes", "tasks", "seeds", "published")
    )
    for line in result.figures:
        for key, one in line.values.items():
            there = result.published.get((line.row, line.kind, key))
            low_high = (one.interval.low, one.interval.high) if one.interval else (None, None)
            writer.writerow(
                (
                    line.row, line.kind, key, *(_short_number(v) for v in (one.value, *low_high)),
                    line.episodes, line.tasks, line.seeds, _short_number(there),
                )
            )  # fmt: skip
    return out.getvalue()


def _short_number(value: float | None) -> str:
    return "" if value is None else f"{value:.6g}"


# ----------------------------------------------------------------- arms by name


@dataclass(frozen=True, slots=True, kw_only=True)
class Side:
    """A run, or a row of a run, with its name."""

    name: str
    run: RunData
    row: str  # "" where none is named

    @property
    def rows(self) -> tuple[str, ...]:
        """That row, or all that there are."""
        return (self.row,) if self.row else rows_of(self.run.records)

    def arm(self, row: str) -> Arm:
        """Return a row as an arm; KarmaError for an unknown row."""
        episodes = episodes_of(self.run.records, self.run.timings)
        name = self.name if self.row else f"{self.name}:{row}"
        try:
            return arm_of(self.run.records, episodes, row, name)
        except KarmaError as error:
            fix = "name one of them: karma compare ... 'RUN:ROW'"
            raise KarmaError(f"{self.run.folder}: {error}\n  To fix: {fix}") from error


def sides_named(names: Sequence[str]) -> list[Side]:
    """Return the sides named by RUN or RUN:ROW; FileError for a missing or damaged run."""
    chosen = ((name, *split_name(name)) for name in names)
    return [Side(name=name, run=read_run(folder), row=row) for name, folder, row in chosen]


def arms_named(sides: Sequence[Side]) -> list[list[Arm]]:
    """Return the arms that `karma compare` is asked for, in groups that belong together.

    Where no row is named and every run has several, each row that all of them have makes a group.

    Raises:
        KarmaError: fewer than two arms, no such row, it is not clear which row is meant, or rooms
            of one name differ.
    """
    if len(sides) < 2:
        raise KarmaError("it takes two to compare\n  To fix: karma compare RUN_A RUN_B")
    check_same_rooms([side.run for side in sides])
    rows = [side.rows for side in sides]
    if empty := [side.name for side, group in zip(sides, rows, strict=True) if not group]:
        raise KarmaError(f"{empty[0]}: the run has no episodes yet\n  To fix: karma eval FILE")
    if all(len(group) == 1 for group in rows):
        return [[side.arm(group[0]) for side, group in zip(sides, rows, strict=True)]]
    common = [row for row in rows[0] if all(row in group for group in rows)]
    if any(side.row for side in sides) or not common:
        unclear = next(side.name for side, group in zip(sides, rows, strict=True) if group[1:])
        there = next(group for group in rows if group[1:])
        raise KarmaError(
            f"{unclear}: which row? There are {', '.join(map(repr, there))}\n"
            f"  To fix: karma compare ... '{unclear}:{there[0]}'"
        )
    return [[side.arm(row) for side in sides] for row in common]


def check_same_rooms(runs: Sequence[RunData]) -> None:
    """Check that scenes with equal names are equal in all runs.

    Raises:
        KarmaError: names the first that is not.
    """
    first = runs[0]
    for run in runs[1:]:
        for name in sorted(first.header.scenes.keys() & run.header.scenes.keys()):
            if first.header.scenes[name] != run.header.scenes[name]:
                raise KarmaError(
                    f"{first.folder} and {run.folder}: {name} is not the same room in both, so "
                    "nothing can be said about them together\n"
                    "  To fix: karma eval both with the same scenes, --fresh"
                )


def set_apart(sides: Sequence[Side]) -> list[str]:
    """Return in words all that sets each later run or row apart from the first.

    Options, tasks, models, prompts, versions, rooms and machines; nothing that is equal.
    """
    first = sides[0]
    return [
        f"{side.name}: {words}"
        for side in sides[1:]
        for words in (*_headers_apart(first.run, side.run), *_options_apart(first, side))
    ]


def _headers_apart(first: RunData, run: RunData) -> list[str]:
    headers = [one.header for one in (first, run)]
    before, after = (asdict(one.machine) if one.machine else {} for one in headers)
    machines = changed("machine", _texts(before), _texts(after))
    return [*headers[0].inputs_apart(headers[1]), *machines]


def _texts(values: Mapping[str, object]) -> dict[str, str]:
    return {name: str(value) for name, value in values.items()}


def _options_apart(first: Side, side: Side) -> list[str]:
    old, new = first.run.header.options, side.run.header.options
    if not first.row and not side.row:
        return options_apart(old, new)
    mine, other = (  # where none is named the only one is meant
        row or next((str(one.get("name")) for one in options.get("rows", ())), "")
        for options, row in ((old, first.row), (new, side.row))
    )
    return shared_apart(old, new) + rows_apart(old, mine, new, other)


def unfinished(runs: Iterable[RunData]) -> list[str]:
    """Return in words which of some runs are not done to their end."""
    return [
        f"{folder}: not finished, the figures are of the {len(run.records)} episodes that are "
        f"done; karma eval goes on with it\n{in_words(run.not_run)}".rstrip()
        for folder, run in {run.folder: run for run in runs}.items()
        if not run.finished
    ]


def split_name(name: str) -> tuple[Path, str]:
    """Return the folder and the row of RUN:ROW; a folder may have a colon in its name."""
    if Path(name).is_dir():
        return Path(name), ""
    folder, _, row = name.partition(":")
    return Path(folder), row


# ----------------------------------------------------------------- the paper's margins


EXPERT = "expert"  # the row that is no baseline
_OVER_BASELINES = {"composite": 1.3, "complex": 2.3}  # SR over the best baseline's (§4.3)
_SAVED = {"composite": {"re": 0.902, "rt": 0.687}, "complex": {"re": 0.867, "rt": 0.690}}  # Table 1
_WITHOUT_MEMORY = 1.0  # the paper gives no margin over the same agent without memory


@dataclass(frozen=True, slots=True, kw_only=True)
class Margin:
    """A margin of the paper with the value of a run."""

    text: str
    wanted: float  # at least
    ours: Estimate
    rival: str = ""  # the row it is measured against

    @property
    def verdict(self) -> str:
        """Whether it holds, and whether its whole interval does."""
        value, interval = self.ours.value, self.ours.interval
        if value is None:
            return "undefined"
        if value < self.wanted:
            return "no" if interval is None or interval.high < self.wanted else "no, not surely"
        return "yes" if interval is not None and interval.low >= self.wanted else "yes, not surely"


def margins(result: Result) -> list[Margin]:
    """Return the margins of the first row of a run; those that its rows allow."""
    return [*_of_success(result), *_of_savings(result)]


def margin_sheet(result: Result) -> Sheet | None:
    """Return the margins as a table; None where a run has nothing to say of them."""
    found = margins(result)
    if not found:
        return None
    return Sheet(
        title=f"{result.name}: the paper's margins",
        caption=(
            '"not surely": the 95 % interval reaches over the wanted value. Undefined: no baseline '
            "solved anything, or there was nothing to save. The paper gives no margin over the "
            "same agent without memory; 1 says that memory helps."
        ),
        head=("margin", "against", "wanted", "ours", "holds"),
        lines=tuple(
            (one.text, one.rival, figure_text(one.wanted), interval_text(one.ours), one.verdict)
            for one in found
        ),
    )


def _of_success(result: Result) -> Iterator[Margin]:
    for kind, wanted in _OVER_BASELINES.items():
        mine = [comparison for comparison in result.comparisons if comparison.kind == kind]
        if rivals := [one for one in mine if _is_baseline(one)]:
            best = max(rivals, key=lambda one: one.success.second.value or 0.0)
            text = f"SR of {best.first}, {kind} tasks, times that of the best baseline"
            yield Margin(text=text, wanted=wanted, ours=best.ratio, rival=best.second)
        for one in mine:
            if one.second == OFF_ROW:
                text = f"SR of {one.first}, {kind} tasks, times that without memory"
                yield Margin(text=text, wanted=_WITHOUT_MEMORY, ours=one.ratio, rival=one.second)


def _is_baseline(one: Comparison) -> bool:
    """Return whether the second arm is a baseline: no ablation, no twin, not the expert."""
    return one.second not in (EXPERT, OFF_ROW) and not one.second.startswith(one.first)


def _of_savings(result: Result) -> Iterator[Margin]:
    first = result.figures[0].row if result.figures else ""
    for line in result.figures:
        if line.row != first or not line.pairs or line.kind not in _SAVED:
            continue
        for key in ("re", "rt", "re_related", "rt_related"):
            wanted = _SAVED[line.kind][key.removesuffix("_related")]
            text = f"{COLUMNS[key].title} of {first}, {line.kind} tasks"
            yield Margin(text=text, wanted=wanted, ours=line.values[key], rival=OFF_ROW)
