"""Compare two runs of an experiment episode by episode.

`python scripts/compare_runs.py BEFORE AFTER [--rename OLD=NEW ...]` compares what an episode came
to: success, unmet goals, places searched, world actions, the skills and what they answered, the
programs, the tokens, memory hits. Seconds are left out, and so are episodes in which the clock cut
off an answer (`answer_seconds`), in either run: equal runs need not be equal there. Of a figure of
the policy laboratory, which has no episodes, `results.json` is compared. Exit status 1 when
anything differs.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

Key = tuple[str, str, int]


def outcomes(folder: Path, rows: dict[str, str]) -> dict[Key, list[Any] | None]:
    """Return the outcome of each episode by row, task and seed; None if the clock cut it off."""
    found: dict[Key, list[Any] | None] = {}
    for line in (folder / "episodes.jsonl").read_text(encoding="utf-8").splitlines():
        record = json.loads(line)
        row = rows.get(record["row"], record["row"])
        cut = any(a["finish"] == "time" for sub in record["subtasks"] for a in sub["answers"])
        found[row, record["task"], record["seed"]] = None if cut else list(_outcome(record))
    return found


def _outcome(record: dict[str, Any]) -> Iterator[Any]:
    yield bool(record["error"])
    for sub in record["subtasks"]:
        yield sub["finished"], sub["unmet"], sub["hits"], sub["queries"]
        yield [a["recalled"] for a in sub["answers"]]
        yield [(c["text"], c["ok"], c["reason"], c["actions"], c["explorations"])
               for c in sub["calls"]]  # fmt: skip
        yield [(a["program"], a["prompt_tokens"], a["completion_tokens"], a["error"])
               for a in sub["answers"]]  # fmt: skip


def main(
    before: Path,
    after: Path,
    rename: Annotated[list[str] | None, typer.Option(help="OLD=NEW: a row's name now.")] = None,
) -> None:
    """Print the episodes that differ and their count; exit status 1 if any differs."""
    if not (before / "episodes.jsonl").exists():
        first, other = ((folder / "results.json").read_bytes() for folder in (before, after))
        print("results.json:", "equal" if first == other else "differs")
        raise typer.Exit(first != other)
    renamed = dict(pair.split("=", 1) for pair in rename or ())
    was, now = outcomes(before, renamed), outcomes(after, {})
    every = sorted(was.keys() | now.keys())
    keys = [key for key in every if None not in (was.get(key, ""), now.get(key, ""))]
    wrong = [key for key in keys if was.get(key) != now.get(key)]
    for key in wrong:
        print(*key, "differs" if key in was and key in now else "stands in one run only")
    cut = f", {len(every) - len(keys)} left out, cut off by the clock" * (len(keys) < len(every))
    print(f"{len(keys)} episodes, {len(wrong)} differ{cut}")
    raise typer.Exit(bool(wrong))


if __name__ == "__main__":
    typer.run(main)
