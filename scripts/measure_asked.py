"""Measure outcomes of people's requests, judged by the world's true state.

    python scripts/measure_asked.py eval/requests/asked_open.jsonl --lines
    python scripts/measure_asked.py eval/requests/asked_locked.jsonl     # only what it adds up to
    python scripts/measure_asked.py eval/requests/several.jsonl --every 3/4

Each request is said to `karma.Agent` in its room, which it has toured. The oracle is
`tests/support/asked.py`: goals over world state, and whether anything changed at all where nothing
was to be done. Controls: an agent that does nothing and reports "done", and an agent that refuses
all.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import msgspec
import typer
from measuring import counted
from rich.progress import track
from support.asked import (
    VERDICTS,
    AskedRequest,
    Came,
    SeveralRequests,
    Verdict,
    load_several,
    verdict,
)
from support.judging import asking_resources, say

from karma.goals.files import load_said
from karma.goals.goals import parse_goal
from karma.loading.models import Models
from karma.offline.guard import go_offline
from karma.types.roles import Resources

_UNDONE_BY = {  # property of an object that a later goal overwrites
    "HOLDON": "at", "ON": "at", "INSIDE": "at", "OPEN": "door", "CLOSED": "door",
    "TOGGLEON": "switch", "TOGGLEOFF": "switch",
}  # fmt: skip
RIGHTLY = ("right", "asked rightly", "refused rightly")


class AskedRecord(msgspec.Struct, frozen=True, kw_only=True):
    """Outcome of a request."""

    id: str
    kind: str
    text: str
    act: str
    came: Came
    verdict: Verdict
    steps: int
    unmet: tuple[str, ...] = ()
    said: tuple[str, ...] = ()


def main(
    file: Path,
    planner: Annotated[str, typer.Option(help="In the manifest, or a GGUF.")] = Models().planner,
    out: Annotated[Path | None, typer.Option(help="Takes a line for each request.")] = None,
    lines: Annotated[bool, typer.Option(help="Print each request that went wrong.")] = False,
    only: Annotated[str, typer.Option(help="Ids that begin so.")] = "",
    every: Annotated[str, typer.Option(help='Of them some: "1/2" is every other one.')] = "0/1",
    profile: Annotated[str, typer.Option(help='Of the prompts, e.g. "tools".')] = "",
    base_url: Annotated[str, typer.Option(help="Of a hosted planner named so.")] = "",
    assistant: Annotated[str, typer.Option(help="In place of the planner's own.")] = "",
    option: Annotated[list[str] | None, typer.Option(help="Of the agent, as KEY=VALUE.")] = None,
) -> None:
    """Send every request and print the outcomes."""
    go_offline()
    pairs = (text.partition("=") for text in option or ())
    options = {key: {"true": True, "false": False}.get(v, v) for key, _, v in pairs}
    first, step = map(int, every.split("/"))
    asked = [request for request in read_asked(file) if request.id.startswith(only)][first::step]
    resources, records = asking_resources(planner, profile, base_url), []
    for request in track(asked, description=file.stem):
        records.append(said(request, resources, options, assistant))
        if lines and records[-1].verdict not in RIGHTLY:
            print(msgspec.json.encode(records[-1]).decode(), flush=True)
    if out:
        out.write_bytes(b"".join(msgspec.json.encode(record) + b"\n" for record in records))
    print("\n".join(table(records)))
    for name, came in (("does nothing, says done", "done"), ("refuses all", "refused")):
        found = Counter(verdict(request, came, met=False, changed=False) for request in asked)
        print(f"control, {name}: " + ", ".join(f"{kind} {found[kind]}" for kind in VERDICTS))


def read_asked(path: Path) -> list[AskedRequest]:
    """Return the requests of a file of any of our forms, but for those that need a history."""
    lines = path.read_bytes().splitlines()
    if b'"act"' in lines[0]:
        return [msgspec.json.decode(line, type=AskedRequest) for line in lines]
    if b'"requests"' in lines[0]:
        return [_of_several(request) for request in load_several(path)]
    return [
        AskedRequest(
            id=request.id, kind=request.kind, scene=request.scene, text=request.text,
            act="do" if request.goals else "refuse", goals=request.goals,
        )
        for request in load_said(path)
        if not request.handled
    ]  # fmt: skip


def _of_several(request: SeveralRequests) -> AskedRequest:
    """Return a sentence with its final goals; a later request may undo an earlier."""
    held: dict[tuple[str, str], str] = {}
    for goal in (parse_goal(text) for part in request.requests for text in part.goals):
        kind, thing = goal.predicate, goal.arguments[-1 if goal.predicate == "HOLDON" else 0]
        held[_UNDONE_BY.get(kind, str(goal)), thing] = str(goal)
    return AskedRequest(
        id=request.id, kind=request.kind, scene=request.scene, text=request.text, act="do",
        goals=tuple(held.values()),
    )  # fmt: skip


def said(
    request: AskedRequest, resources: Resources, options: Mapping[str, Any], assistant: str = ""
) -> AskedRecord:
    """Send a request and judge its outcome."""
    told = say(request, resources, options, assistant)
    came: Came = told.reply.status if told.reply is not None else "refused"
    parts = told.reply.parts if told.reply is not None else ()
    return AskedRecord(
        id=request.id, kind=request.kind, text=request.text, act=request.act, came=came,
        verdict=verdict(
            request, came, met=not told.unmet, changed=told.changed, said=str(told.reply)
        ),
        steps=sum(result.actions for part in parts for result in part.results),
        unmet=told.unmet,
        said=tuple(str(told.error if told.reply is None else told.reply).splitlines()),
    )  # fmt: skip


def table(records: Sequence[AskedRecord]) -> Iterator[str]:
    """Yield the rows: all, then each kind, with counts of outcomes."""
    yield f"{'kind':14} {'n':>4}  " + "  ".join(f"{name:>10.10}" for name in VERDICTS)
    kinds = dict.fromkeys(record.kind for record in records)
    for kind in ("all", *kinds):
        mine = [record for record in records if kind in ("all", record.kind)]
        count = Counter(record.verdict for record in mine)
        yield f"{kind:14} {len(mine):4}  " + "  ".join(f"{count[name]:10}" for name in VERDICTS)
    yield counted("right, or asked or refused rightly", [r.verdict in RIGHTLY for r in records])
    yield counted("wrong and said done", [r.verdict == "wrong and said done" for r in records])
    plain = [r.verdict == "refused or asked wrongly" for r in records if r.kind == "plain"]
    yield counted("plain errands refused or asked about", plain)


if __name__ == "__main__":
    typer.run(main)
