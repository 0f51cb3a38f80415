"""An adversary plans: of ten programs for a request, only the right one may end "done".

    python scripts/check_guard.py --requests 200

For each request that the shipped planner does, by the oracle over world state, its own program is
the right one; seven others differ from it by one change (a thing or place swapped, a deed left out,
swapped, added, undone, another thing done along), two are drawn from all legal calls. Each is all
that the planner ever answers. A false "done" is one after which a goal does not hold, something
that was ruled out does, or another thing was cut, broken or thrown away. The same without the guard
is the control row.
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

from karma.agent.program import SKILLS
from karma.contracts import Completion, Prompt, Resources, SkillCall
from karma.household.containment import goes_in
from karma.household.types import object_types
from karma.loading.models import Models, load_resources
from karma.offline import go_offline
from karma.seeds import stream
from karma.talk.agent import asking
from karma.talk.replies import AgentReply
from karma.tasks.asked import AskedRequest, states_of

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


def main() -> None:
    """Play all programs, with the guard and without."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--requests", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--lines", action="store_true", help="print each false done")
    given = parser.parse_args()
    go_offline()
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
