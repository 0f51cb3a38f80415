"""What comes of requests as people put them, of all kinds, judged by the world's true state.

    python scripts/measure_asked.py eval/requests/asked_open.jsonl --lines
    python scripts/measure_asked.py eval/requests/asked_locked.jsonl     # only what it adds up to
    python scripts/measure_asked.py eval/requests/several.jsonl --every 3/4

Each request is said to `karma.Agent` in its room, which it has toured. The oracle is
`karma.tasks.asked`: goals over world state, and whether anything changed at all where nothing was
to be done. Rows beside it: one that does nothing and says "done", and one that refuses all.
"""

import argparse
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
from rich.progress import track

from karma.bench.statistics import interval_text, rate
from karma.contracts import Resources, SubTask
from karma.errors import KarmaError
from karma.loading.models import Models, load_resources
from karma.offline import go_offline
from karma.talk.agent import Agent, asking
from karma.talk.replies import AgentReply
from karma.tasks.asked import VERDICTS, AskedRequest, Came, Verdict, states_of, verdict
from karma.tasks.goals import GoalTracker, parse_goal
from karma.tasks.requests import SeveralRequests, load_said, load_several

MAPS = Path("runs/maps-asked")
RIGHTLY = ("right", "asked rightly", "refused rightly")


class AskedRecord(msgspec.Struct, frozen=True, kw_only=True):
    """What came of one request."""

    id: str
    kind: str
    text: str
    act: str
    came: Came
    verdict: Verdict
    steps: int
    unmet: tuple[str, ...] = ()
    said: tuple[str, ...] = ()


def main() -> None:
    """Say every request, and print what came of them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("file", type=Path)
    parser.add_argument("--planner", default=Models().planner, help="in the manifest, or a GGUF")
    parser.add_argument("--out", type=Path, help="takes a line for each request")
    parser.add_argument("--lines", action="store_true", help="print each request that went wrong")
    parser.add_argument("--only", default="", help="ids that begin so")
    parser.add_argument("--every", default="0/1", help='of them some: "1/2" is every other one')
    parser.add_argument("--option", action="append", default=[], help="of the agent, as KEY=VALUE")
    given = parser.parse_args()
    go_offline()
    options = {key: _value(value) for key, _, value in (o.partition("=") for o in given.option)}
    first, step = map(int, given.every.split("/"))
    asked = [one for one in read_asked(given.file) if one.id.startswith(given.only)][first::step]
    resources = load_resources(
        asking(Models(planner=given.planner)), maps=MAPS, seed=0, learn=False
    )
    records = []
    for one in track(asked, description=given.file.stem):
        records.append(said(one, resources, options))
        if given.lines and records[-1].verdict not in RIGHTLY:
            print(msgspec.json.encode(records[-1]).decode(), flush=True)
    if given.out:
        given.out.write_bytes(b"".join(msgspec.json.encode(one) + b"\n" for one in records))
    print("\n".join(table(records)))
    print("\n".join(controls(asked)))


def _value(text: str) -> object:
    return {"true": True, "false": False}.get(text, text)


def read_asked(path: Path) -> list[AskedRequest]:
    """Return the requests of a file of any of our forms, but for those that need a history."""
    lines = path.read_bytes().splitlines()
    if b'"act"' in lines[0]:
        return [msgspec.json.decode(line, type=AskedRequest) for line in lines]
    if b'"requests"' in lines[0]:
        return [_of_several(one) for one in load_several(path)]
    return [
        AskedRequest(
            id=one.id, kind=one.kind, scene=one.scene, text=one.text,
            act="do" if one.goals else "refuse", goals=one.goals,
        )
        for one in load_said(path)
        if not one.handled
    ]  # fmt: skip


def _of_several(one: SeveralRequests) -> AskedRequest:
    """Return a sentence with what holds in the end; a later request may undo an earlier one."""
    held: dict[tuple[str, str], str] = {}
    for goal in (parse_goal(text) for part in one.requests for text in part.goals):
        kind, thing = goal.predicate, goal.arguments[0]
        if kind == "HOLDON":
            kind, thing = "at", goal.arguments[-1]
        elif kind in ("ON", "INSIDE"):
            kind = "at"
        elif kind in ("OPEN", "CLOSED"):
            kind = "door"
        elif kind.startswith("TOGGLE"):
            kind = "switch"
        else:
            kind = str(goal)
        held[kind, thing] = str(goal)
    return AskedRequest(
        id=one.id, kind=one.kind, scene=one.scene, text=one.text, act="do",
        goals=tuple(held.values()),
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Told:
    """What came of a request, as it is said and as it is."""

    reply: AgentReply | None  # None: an error
    error: str
    unmet: tuple[str, ...]  # goals that do not hold, and what must not hold and does
    changed: bool
    objects: Sequence[Mapping[str, Any]]  # the world's, afterwards


def say(one: AskedRequest, resources: Resources, options: Mapping[str, Any], folder: Path) -> Told:
    """Say one request to an agent of its own, whose world the judge watches."""
    agent = Agent(one.scene, resources=resources, options=options, folder=folder / "t", maps=MAPS)
    tracker, world = GoalTracker(), agent._world
    tracker.start(world.last_event)
    tracker.begin_subtask(SubTask(instruction=one.text, goals=one.wanted), world.last_event)
    before, inner = states_of(world.last_event.metadata["objects"]), world.step

    def step(action: str, **arguments: object) -> object:
        event = inner(action, **arguments)
        tracker.update(event)
        return event

    world.step = step  # type: ignore[method-assign,assignment]
    reply, error = None, ""
    try:
        reply = agent.do(one.text)
    except KarmaError as failure:
        error = str(failure)
    event = world.last_event
    bad = [goal for goal in one.unwanted if not tracker.unmet((goal,), event)]
    unmet = (*map(str, tracker.unmet(one.wanted, event)), *(f"not {goal}" for goal in bad))
    objects = event.metadata["objects"]
    changed = states_of(objects) != before
    return Told(reply=reply, error=error, unmet=unmet, changed=changed, objects=objects)


def said(one: AskedRequest, resources: Resources, options: Mapping[str, Any]) -> AskedRecord:
    """Say one request, and judge what came of it."""
    with tempfile.TemporaryDirectory() as folder:
        told = say(one, resources, options, Path(folder))
    came: Came = told.reply.status if told.reply is not None else "refused"
    parts = told.reply.parts if told.reply is not None else ()
    return AskedRecord(
        id=one.id, kind=one.kind, text=one.text, act=one.act, came=came,
        verdict=verdict(one, came, met=not told.unmet, changed=told.changed),
        steps=sum(result.actions for part in parts for result in part.results),
        unmet=told.unmet,
        said=tuple(str(told.error if told.reply is None else told.reply).splitlines()),
    )  # fmt: skip


def table(records: Sequence[AskedRecord]) -> Iterator[str]:
    """Yield the rows: all, then each kind, with how many came to what."""
    yield f"{'kind':14} {'n':>4}  " + "  ".join(f"{name:>10.10}" for name in VERDICTS)
    kinds = dict.fromkeys(one.kind for one in records)
    for kind in ("all", *kinds):
        mine = [one for one in records if kind in ("all", one.kind)]
        count = Counter(one.verdict for one in mine)
        yield f"{kind:14} {len(mine):4}  " + "  ".join(f"{count[name]:10}" for name in VERDICTS)
    flags = {
        "right, or asked or refused rightly": [one.verdict in RIGHTLY for one in records],
        "wrong and said done": [one.verdict == "wrong and said done" for one in records],
        "plain errands refused or asked about": [
            one.verdict == "refused or asked wrongly" for one in records if one.kind == "plain"
        ],
    }
    for name, each in flags.items():
        found = rate([[float(x)] for x in each])
        yield f"{name}: {sum(each)} of {len(each)} {interval_text(found)}"


def controls(asked: Iterable[AskedRequest]) -> Iterator[str]:
    """Yield what two that never act would come to."""
    for name, came in (("does nothing, says done", "done"), ("refuses all", "refused")):
        found = Counter(verdict(one, came, met=False, changed=False) for one in asked)
        yield f"control, {name}: " + ", ".join(f"{kind} {found[kind]}" for kind in VERDICTS)


if __name__ == "__main__":
    main()
