"""What a planner and a splitter make of requests as people say them (`eval/requests/`).

    python scripts/measure_requests.py                    # the shipped planner
    python scripts/measure_requests.py --planner FILE.gguf --out runs/requests-new
    python scripts/measure_requests.py --no-planner       # the splitters alone, in a second

The first table: of 200 requests to refuse and 200 to do, how many are refused, beside an agent
that never refuses, one that always does, and one that refuses as many as the planner, by lot. The
second: of 200 sentences of several requests, how many are cut into those requests, and how many are
done in the room, whole, cut at every "and" and full stop, by the splitter, and by hand. What was
said and answered is kept line by line in the folder; what is there is not said again (--fresh
starts over).
"""

import argparse
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from rich.progress import track

from karma.bench.spoken import SaidRecord, Splitter, Talk
from karma.bench.statistics import interval_text, rate
from karma.files import to_json
from karma.journal.folder import read_lines
from karma.loading.models import Models, load_resources
from karma.methods.karma import KarmaMethod
from karma.offline import go_offline
from karma.seeds import stream
from karma.tasks.requests import load_said, load_several, split_right
from karma.tasks.sentences import split_instruction
from karma.world.sim import EmbeddedWorld

SETS = Path("eval/requests")
KINDS = {  # what a planner may give as reason, by why a request is to be refused
    "deed": ("deed", "thing"), "thing": ("thing", "deed"), "place": ("place", "thing"),
    "impossible": ("impossible", "deed"), "negated": ("negated",), "language": ("language",),
    "nonsense": ("unclear", "language", "impossible"), "unclear": ("unclear",),
}  # fmt: skip
SPLITTERS: dict[str, Splitter] = {
    "whole": lambda said: (said.text,),
    'every "and"': lambda said: every_and(said.text),
    "split_instruction": lambda said: split_instruction(said.text),
    "by hand": lambda said: tuple(one.clause for one in said.requests),
}
Counted = Callable[[SaidRecord], bool | None]


def main() -> None:
    """Say everything that was not said yet, and print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--planner", default=Models().planner, help="in the manifest, or a GGUF")
    parser.add_argument("--no-planner", action="store_true", help="only cut, say nothing")
    parser.add_argument("--out", type=Path, default=Path("runs/requests"))
    parser.add_argument("--fresh", action="store_true", help="say everything again")
    parser.add_argument("--only", choices=("one", "several"), help="one of the two tables")
    given = parser.parse_args()
    go_offline()
    if given.no_planner:
        print(several_table(list(cut_alone())))
        return
    given.out.mkdir(parents=True, exist_ok=True)
    talk = talk_with(given.planner, given.out)
    if given.only != "several":
        records = said(talk, given.out / "one.jsonl", given.fresh, say_each())
        print(one_table(records))
    if given.only != "one":
        records = said(talk, given.out / "several.jsonl", given.fresh, say_sentences())
        print(several_table(records))


def talk_with(planner: str, folder: Path) -> Talk:
    """Return an agent with both memories; maps of rooms are kept in the folder."""
    resources = load_resources(Models(planner=planner), maps=folder / "maps", seed=0)
    return Talk(method=KarmaMethod.build(resources, {}), world=EmbeddedWorld(), folder=folder)


# ----------------------------------------------------------------- saying

Saying = tuple[str, Callable[[Talk], SaidRecord]]  # a key, and how to say it


def say_each() -> Iterator[Saying]:
    """Yield what is to be refused and what is to be done, each by its id."""
    for one in (*load_said(SETS / "refuse.jsonl"), *load_said(SETS / "do.jsonl")):
        yield one.id, lambda talk, one=one: talk.one(one)  # type: ignore[misc]


def say_sentences() -> Iterator[Saying]:
    """Yield sentences of several requests, cut in each way."""
    for name, splitter in SPLITTERS.items():
        for one in load_several(SETS / "several.jsonl"):
            key = f"{one.id}/{name}"
            yield key, lambda talk, one=one, name=name, by=splitter: talk.several(one, name, by)  # type: ignore[misc]


def said(talk: Talk, path: Path, fresh: bool, sayings: Iterator[Saying]) -> list[SaidRecord]:
    """Return the records of all sayings; those in the file are read, others are made and added."""
    if fresh:
        path.unlink(missing_ok=True)
    known = {key_of(record): record for record in read_lines(path, SaidRecord)}
    found = []
    with path.open("ab") as file:
        for key, say in track(list(sayings), description=path.stem):
            if key not in known:
                known[key] = say(talk)
                file.write(to_json(known[key]))
                file.flush()
            found.append(known[key])
    return found


def key_of(record: SaidRecord) -> str:
    """Return the key that a record was made by."""
    return f"{record.id}/{record.splitter}" if record.splitter else record.id


def cut_alone() -> Iterator[SaidRecord]:
    """Yield the records of the splitters, without an agent."""
    for name, splitter in SPLITTERS.items():
        for one in load_several(SETS / "several.jsonl"):
            clauses = tuple(splitter(one))
            yield SaidRecord(
                id=one.id,
                kind=one.kind,
                text=one.text,
                splitter=name,
                clauses=clauses,
                split=split_right(clauses, one.requests),
            )


def every_and(text: str) -> tuple[str, ...]:
    """Return a text cut at every "and", "then", semicolon and full stop."""
    parts = re.split(r"[.;!?]|\b(?:and then|and|then)\b", text)
    return tuple(part.strip(" ,") for part in parts if part.strip(" ,"))


# ----------------------------------------------------------------- tables


def one_table(records: Sequence[SaidRecord]) -> str:
    """Return how many requests are refused, of those to be refused and of those to be done."""
    wrong = [one for one in records if one.reached is None]
    right = [one for one in records if one.reached is not None]
    share = sum(map(refused, wrong)) / len(wrong) if wrong else 0.0
    rng = stream(0, "requests", "lot")
    lot = {one.id: bool(rng.random() < share) for one in records}
    ways: dict[str, Counted] = {
        "this planner": refused,
        "never refuses": lambda one: False,
        "always refuses": lambda one: True,
        "by lot": lambda one: lot[one.id],
    }
    lines = ["| who | of 200 to refuse: refused | of 200 to do: refused |", "|---|---|---|"]
    lines += [
        f"| {who} | {figure(wrong, way)} | {figure(right, way)} |" for who, way in ways.items()
    ]
    lines += ["", "| to refuse | requests | refused | the reason fits |", "|---|---|---|---|"]
    for kind, them in by_kind(wrong):
        lines.append(f"| {kind} | {len(them)} | {figure(them, refused)} | {figure(them, fits)} |")
    lines += ["", "| to do | requests | refused | done |", "|---|---|---|---|"]
    for kind, them in by_kind(right):
        lines.append(f"| {kind} | {len(them)} | {figure(them, refused)} | {figure(them, done)} |")
    return "\n".join(lines)


def several_table(records: Sequence[SaidRecord]) -> str:
    """Return how many sentences are cut into their requests, and done."""
    counted: dict[str, Counted] = {
        "cut right": lambda one: one.split, "done": done,
        "either": lambda one: None if one.reached is None else bool(one.split or one.reached),
    }  # fmt: skip
    lines = [f"| cut | {' | '.join(counted)} |", "|---|" + "---|" * len(counted)]
    for name in SPLITTERS:
        them = [one for one in records if one.splitter == name]
        lines.append(f"| {name} | {' | '.join(figure(them, way) for way in counted.values())} |")
    mine = [one for one in records if one.splitter == "split_instruction"]
    lines += ["", f"| by the splitter | sentences | {' | '.join(counted)} |"]
    lines.append("|---|---|" + "---|" * len(counted))
    for kind, them in by_kind(mine)[:-1]:
        told = " | ".join(figure(them, way) for way in counted.values())
        lines.append(f"| {kind} | {len(them)} | {told} |")
    return "\n".join(lines)


def by_kind(records: Sequence[SaidRecord]) -> list[tuple[str, list[SaidRecord]]]:
    """Return the records of each kind, and of all."""
    kinds = dict.fromkeys(one.kind for one in records)
    found = [(kind, [one for one in records if one.kind == kind]) for kind in kinds]
    return [*found, ("all", list(records))]


def figure(records: Sequence[SaidRecord], counted: Counted) -> str:
    """Return a rate with its interval; each sentence counts once."""
    values = [value for value in map(counted, records) if value is not None]
    return interval_text(rate([[float(value)] for value in values]))


def refused(record: SaidRecord) -> bool:
    """Return whether a request was refused."""
    return bool(record.refused)


def done(record: SaidRecord) -> bool | None:
    """Return whether all that was asked for was done."""
    return record.reached


def fits(record: SaidRecord) -> bool:
    """Return whether the reason of a refusal is one of those that fit."""
    return record.refused in KINDS[record.kind]


if __name__ == "__main__":
    main()
