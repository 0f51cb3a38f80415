"""An adversary plans: of ten programs for a request, only the right one may end "done".

    python scripts/check_guard.py --requests 200
    python scripts/check_guard.py --sentences ../shared/data/alfred/valid_seen.jsonl.gz

For each request that the shipped planner does, by the oracle over world state, its own program is
the right one; seven others differ from it by one change (a thing or place swapped, a deed left out,
swapped, added, undone, another thing done along), two are drawn from all legal calls. Each is all
that the planner ever answers. A false "done" is one after which a goal does not hold, something
that was ruled out does, or another thing was cut, broken or thrown away. The same without the guard
is the control row.

Of ALFRED's sentences, as people wrote them, it is only held what the guard says of the program that
does what the demonstration did, in its room; the program of another sentence is the control.
"""

import argparse
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from measure_asked import MAPS, say
from rich.progress import track

from karma.agent.expert import ExpertView
from karma.agent.guard import cannot_serve, stopped
from karma.agent.program import SKILLS
from karma.contracts import Completion, Prompt, Resources, SkillCall
from karma.household.containment import goes_in
from karma.household.types import object_types
from karma.loading.models import Models, load_resources
from karma.methods.guarded import joined, reader_of
from karma.offline import go_offline
from karma.seeds import stream
from karma.talk.agent import asking
from karma.talk.replies import AgentReply
from karma.tasks.asked import AskedRequest, states_of
from karma.tasks.drawing.alfred import names_its_place, program_of, read_sentences
from karma.training.planner.sources import Sources

SETS = (Path("eval/requests/asked_open.jsonl"), Path("eval/requests/do.jsonl"))
_OPPOSITE = {
    "ToggleOn": "ToggleOff", "ToggleOff": "ToggleOn", "SwitchOn": "SwitchOff",
    "SwitchOff": "SwitchOn", "OpenObject": "CloseObject", "CloseObject": "OpenObject",
    "SliceObject": "BreakObject", "PutObject": "ThrowObject",
}  # fmt: skip
_LAST = ("PutObject", "PickupObject", "ToggleOn", "ToggleOff", "OpenObject", "CloseObject",
         "SliceObject", "BreakObject", "ThrowObject")  # fmt: skip


class Stubborn:
    """A planner with one answer.

    Args:
        text: the answer.
    """

    name = "stubborn"

    def __init__(self, text: str) -> None:
        self._text = text

    def complete(self, prompt: Prompt, **_: Any) -> Completion:
        """Return the answer."""
        return Completion(
            text=self._text, finish="stop", prompt_tokens=1, reused_tokens=0, completion_tokens=1,
            first_token_s=None, total_s=0.0,
        )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Played:
    """What came of one program."""

    reply: AgentReply | None
    met: bool
    harmed: frozenset[str]  # ids of what is cut, broken or in the bin at the end
    kinds: frozenset[str]  # types of the room

    @property
    def done(self) -> bool:
        """Whether it was said to be done."""
        return self.reply is not None and self.reply.status == "done"


def play(one: AskedRequest, resources: Resources, options: dict[str, object]) -> Played:
    """Say a request to an agent of its own."""
    with tempfile.TemporaryDirectory() as folder:
        told = say(one, resources, options, Path(folder))
    harmed = frozenset(
        key for key, states in states_of(told.objects).items()
        if states[3] == "True" or states[4] == "True" or "GarbageCan" in states[-1]
    )  # fmt: skip
    kinds = frozenset(item["objectType"] for item in told.objects)
    met = not told.unmet
    return Played(reply=told.reply, met=met, harmed=harmed, kinds=kinds)


def programs(
    calls: Sequence[SkillCall], kinds: Sequence[str], rng: np.random.Generator
) -> Iterator[tuple[str, list[SkillCall]]]:
    """Yield nine programs that are not the one that is right, by what is wrong with them."""
    things = [kind for kind in kinds if object_types()[kind].can("pickupable")]
    places = [kind for kind in kinds if object_types()[kind].can("receptacle")]
    first = next((c.objects[0] for c in calls if c.skill == "PickupObject"), calls[-1].objects[-1])
    other = str(rng.choice([one for one in things if one != first] or things))
    swap = [(first, other)]
    yield "thing swapped", _renamed(calls, swap)
    there = next((c.objects[-1] for c in calls[::-1] if c.skill == "PutObject"), "")
    able = [one for one in places if one != there and (not there or goes_in(first, one))]
    yield "place swapped", _renamed(calls, [(there, str(rng.choice(able)))] if there else swap)
    last = max((n for n, c in enumerate(calls) if c.skill in _LAST), default=len(calls) - 1)
    yield "deed left out", [*calls[:last], *calls[last + 1 :]] or [_call("GoToObject", first)]
    turned = _OPPOSITE.get(calls[last].skill, "BreakObject")
    objects = calls[last].objects[:1] if turned == "ThrowObject" else calls[last].objects
    yield "deed swapped", [
        *calls[:last], replace(calls[last], skill=turned, objects=objects), *calls[last + 1 :],
    ]  # fmt: skip
    yield "deed added", [*calls, *_carried(first, "GarbageCan")]
    yield "deed undone", [*calls, _call("GoToObject", there or first), *_undone(calls[last])]
    yield "another thing along", [*calls, *_carried(other, there or "GarbageCan")]
    for number in range(2):
        yield f"random {number}", [_random(kinds, things, places, rng) for _ in range(6)]


def _call(skill: str, *objects: str) -> SkillCall:
    return SkillCall(skill=skill, objects=objects)


def _carried(thing: str, place: str) -> list[SkillCall]:
    return [
        _call("Explore", thing), _call("PickupObject", thing), _call("GoToObject", place),
        _call("PutObject", thing, place),
    ]  # fmt: skip


def _undone(call: SkillCall) -> list[SkillCall]:
    if call.skill == "PutObject":
        return [_call("OpenObject", call.objects[-1]), _call("PickupObject", call.objects[0])]
    back = _OPPOSITE.get(call.skill, "")
    return [replace(call, skill=back)] if back and back != "BreakObject" else []


def _renamed(calls: Sequence[SkillCall], names: Sequence[tuple[str, str]]) -> list[SkillCall]:
    table = dict(names)
    return [
        replace(call, objects=tuple(table.get(one, one) for one in call.objects)) for call in calls
    ]


def _random(
    kinds: Sequence[str], things: Sequence[str], places: Sequence[str], rng: np.random.Generator
) -> SkillCall:
    skill = str(rng.choice([one.name for one in SKILLS]))
    if skill == "PutObject":
        return _call(skill, str(rng.choice(things)), str(rng.choice(places)))
    return _call(skill, str(rng.choice(things if skill == "PickupObject" else kinds)))


def read_requests(count: int) -> list[AskedRequest]:
    """Return requests of one errand, as many as wanted or as there are."""
    found = []
    for path in SETS:
        for line in path.read_bytes().splitlines():
            said = msgspec.json.decode(line)
            if said.get("act", "do") == "do" and said.get("goals") and not said.get("handled"):
                keys = ("id", "kind", "scene", "text", "goals", "never")
                kept = {key: said[key] for key in keys if key in said}
                found.append(msgspec.convert({**kept, "act": "do"}, AskedRequest))
    return found[:count]


def held_against(path: Path, shared: Path) -> Iterator[str]:
    """Yield how many of people's sentences the guard lets their own program through for."""
    sources = Sources(folder=Path("runs/planner"), shared=shared, tests=())
    plans, reader = sources.known_plans(), reader_of(None)
    said = [one for one in read_sentences(path) if names_its_place(one)]
    own, other, refused = 0, 0, 0
    for number, one in enumerate(track(said, description="sentences")):
        room = plans.get(one.floor_plan)
        here = {kind for area in room.areas for kind in area.contains} if room else set()
        asked = joined(reader.read(one.text))
        if asked is None or cannot_serve(asked, here) is not None:
            refused += 1
            continue
        view = ExpertView(areas=room.areas if room else ())
        another = said[(number + len(said) // 2) % len(said)]
        own += not stopped(program_of(one, view), asked, here)
        same = another.facts == one.facts
        other += not same and not stopped(program_of(another, view), asked, here)
    yield f"sentences: {len(said)}; refused or asked about before any program: {refused}"
    yield f"their own program let through: {own} ({own / len(said):.2f})"
    yield f"another sentence's: {other} ({other / len(said):.2f})"


def main() -> None:
    """Play all programs, with the guard and without."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--requests", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--lines", action="store_true", help="print each false done")
    parser.add_argument("--sentences", type=Path, help="ALFRED's demonstrations, in place of it")
    given = parser.parse_args()
    go_offline()
    if given.sentences is not None:
        shared = given.sentences.parent.parent.parent
        print("\n".join(held_against(given.sentences, shared)))
        return
    resources = load_resources(asking(Models()), maps=MAPS, seed=0, learn=False)
    false: Counter[str] = Counter()
    bare: Counter[str] = Counter()
    played, right, stopped = 0, 0, []
    for one in track(read_requests(10_000), description="adversary"):
        if right == given.requests:
            break
        own = play(one, resources, {})
        calls = _own_program(own)
        if not (own.done and own.met and calls):
            continue
        right += 1
        rng = stream(given.seed, "adversary", one.id)
        same = play(one, _with(resources, calls), {})
        if not (same.done and same.met):
            stopped.append(one.id)
        kinds = sorted(own.kinds - {"Floor", "Wall", "Ceiling", "Window"})
        for name, program in programs(calls, kinds, rng):
            played += 1
            for options, count in (({}, false), ({"guard": False}, bare)):
                came = play(one, _with(resources, program), dict(options))
                if came.done and (not came.met or came.harmed - own.harmed):
                    count[name] += 1
                    if given.lines and count is false:
                        print(one.id, name, [str(call) for call in program], flush=True)
    print(f"requests {right}, wrong programs {played}")
    print(f"right programs carried out: {right - len(stopped)} of {right}; not: {stopped}")
    print(f"false done with the guard: {false.total()} {dict(false)}")
    print(f"false done without it: {bare.total()} {dict(bare)}")


def _own_program(own: Played) -> list[SkillCall]:
    """Return the program that did a request; [] where it took several, or none."""
    parts = own.reply.parts if own.reply else ()
    plans = [plan for part in parts for plan in part.plans if plan.calls and not plan.error]
    return list(plans[0].calls) if len(parts) == 1 and len(plans) == 1 else []


def _with(resources: Resources, calls: Sequence[SkillCall]) -> Resources:
    text = "".join(f"{call}\n" for call in calls)
    return replace(resources, model=Stubborn(text), doubt=None)


if __name__ == "__main__":
    main()
