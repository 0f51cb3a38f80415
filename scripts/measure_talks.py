"""What comes of whole conversations: errands, questions and what is told, judged turn by turn.

    python scripts/measure_talks.py eval/talk/open.txt --lines
    python scripts/measure_talks.py eval/talk/locked.txt          # only what it adds up to

A conversation is said to one `karma.Agent`. Behind "=>" stands what is to come of a turn, and the
judge looks at the world's true state, never at what the agent believes:

    ON(Apple, Fridge); OPEN(Fridge)   an errand: all of this holds; "or" stands between several ways
    back Apple                        an errand: it lies where it lay when the conversation began
    where Apple                       a question: every place that is named has one in or on it
    is Fridge open                    a question: yes or no, as it is
    in Fridge: Apple Egg              a question: these are named, and nothing that is not there
    yes, no, says WORDS               a question: the answer begins so, or has these words
    told                              it is learnt, and nothing is done
    nothing                           nothing is done

What follows an errand that went wrong and leans on it ("yes", "says", "in") is not judged. Rows
beside it: an agent that does nothing and says "done" or "no", and one that says it does not know.
"""

import re
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from measuring import counted
from rich.progress import track
from support.judging import MAPS, asking_resources, tracking, watched

from karma.contracts import Resources
from karma.errors import KarmaError
from karma.household.ids import type_of
from karma.household.pieces import base_type
from karma.household.places import HAND
from karma.household.saying import name_of
from karma.household.types import object_types
from karma.household.uses import without_basin
from karma.loading.models import Models
from karma.offline import go_offline
from karma.talk.agent import Agent
from karma.talk.replies import AgentReply
from karma.tasks.goals import GoalTracker, parse_goal

Verdict = Literal[
    "right", "does not know", "refused", "wrong, said so", "wrong, said done", "wrong answer", "–"
]
VERDICTS: tuple[Verdict, ...] = Verdict.__args__  # type: ignore[attr-defined]
_LEANS = ("yes", "no", "says", "in")  # on what was done before
_IS: Mapping[str, Callable[[Mapping[str, Any]], bool]] = {
    "open": lambda one: one["isOpen"],
    "closed": lambda one: not one["isOpen"],
    "on": lambda one: one["isToggled"],
    "off": lambda one: not one["isToggled"],
    "dirty": lambda one: one["isDirty"],
    "clean": lambda one: not one["isDirty"],
    "sliced": lambda one: one["isSliced"] or one["objectType"].endswith("Sliced"),
    "filled": lambda one: one["isFilledWithLiquid"],
    "empty": lambda one: not one["isFilledWithLiquid"],
    "broken": lambda one: one["isBroken"],
    "hot": lambda one: one["temperature"] == "Hot",
    "cold": lambda one: one["temperature"] == "Cold",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Turn:
    """What is said, and what is to come of it."""

    text: str
    wanted: tuple[str, ...]  # any of these will do

    @property
    def kind(self) -> str:
        """Whether it is an errand, a question, or neither."""
        word = self.wanted[0].split()[0]
        if word in ("where", "is", "in", "yes", "no", "says"):
            return "question"
        return word if word in ("told", "nothing") else "errand"


@dataclass(frozen=True, slots=True, kw_only=True)
class Talk:
    """One conversation."""

    number: int
    scene: str
    turns: tuple[Turn, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """What came of a turn."""

    talk: Talk
    turn: Turn
    verdict: Verdict
    said: str


def read_talks(path: Path) -> list[Talk]:
    """Return the conversations of a file."""
    found: list[Talk] = []
    for number, block in enumerate(re.split(r"^@ ", path.read_text(), flags=re.MULTILINE)[1:], 1):
        scene, *lines = block.strip().splitlines()
        parts = (line.partition(" => ") for line in lines)
        turns = tuple(Turn(text=text, wanted=tuple(w.split(" or "))) for text, _, w in parts)
        found.append(Talk(number=number, scene=scene, turns=turns))
    return found


def main(
    file: Path,
    planner: Annotated[str, typer.Option(help="In the manifest, or a GGUF.")] = Models().planner,
    lines: Annotated[bool, typer.Option(help="Print each turn that went wrong.")] = False,
    only: Annotated[list[int] | None, typer.Option(help="Numbers of conversations.")] = None,
) -> None:
    """Hold every conversation, and print what came of its turns."""
    go_offline()
    talks = [talk for talk in read_talks(file) if not only or talk.number in only]
    resources, judged = asking_resources(planner), list[Judged]()
    for talk in track(talks, description=file.stem):
        for one in held(talk, resources):
            judged.append(one)
            if lines and one.verdict not in ("right", "–"):
                print(f"{talk.number} {one.turn.text} => {' or '.join(one.turn.wanted)}\n"
                      f"    {one.verdict}: {one.said}", flush=True)  # fmt: skip
    print("\n".join(table(judged)))


def held(talk: Talk, resources: Resources) -> Iterator[Judged]:
    """Hold one conversation; yields each turn with its verdict."""
    with tempfile.TemporaryDirectory() as folder:
        agent = Agent(talk.scene, resources=resources, folder=Path(folder, "talk"), maps=MAPS)
        judge, failed = _Judge(agent), False
        for turn in talk.turns:
            verdict, said = judge.turn(turn)
            if failed and turn.wanted[0].split()[0] in _LEANS:
                verdict = "–"
            failed = failed or (turn.kind == "errand" and verdict != "right")
            yield Judged(talk=talk, turn=turn, verdict=verdict, said=said)


class _Judge:
    """Says a turn to an agent, and looks at its world."""

    def __init__(self, agent: Agent) -> None:
        self.agent, self.world = agent, agent._world
        self.began = {one["objectId"]: one["parentReceptacles"] for one in self.objects}

    @property
    def objects(self) -> list[dict[str, Any]]:
        return self.world.last_event.metadata["objects"]

    def turn(self, turn: Turn) -> tuple[Verdict, str]:
        """Say a turn; returns its verdict, and what was said to it."""
        goals = [
            tuple(parse_goal(goal) for goal in wanted.split(";")) if "(" in wanted else ()
            for wanted in turn.wanted
        ]
        trackers = [tracking(self.world, turn.text, some) for some in goals]
        with watched(self.world, *trackers) as changed:
            try:
                reply = self.agent.do(turn.text)
            except KarmaError as error:
                return "refused", str(error)
        found = [
            self._verdict(wanted, reply, changed(), tracker, some)
            for wanted, tracker, some in zip(turn.wanted, trackers, goals, strict=True)
        ]
        return min(found, key=VERDICTS.index), repr(reply)

    def _verdict(
        self, wanted: str, reply: AgentReply, changed: bool, tracker: GoalTracker, goals: Any
    ) -> Verdict:
        word, silent = wanted.split()[0], reply.status in ("refused", "asked", "answered")
        if goals or word == "back":
            if silent and not changed:
                return "refused"
            if reply.status != "done":
                return "wrong, said so"
            so = self._is_back(wanted.split()[1]) if word == "back" else not tracker.unmet(
                goals, self.world.last_event
            )  # fmt: skip
            return "right" if so else "wrong, said done"
        if changed:
            return "wrong, said done" if reply.status == "done" else "wrong, said so"
        if word == "nothing":
            return "right"
        if reply.status != "answered":
            return "refused"
        if word == "told":
            return "right"
        answers = [part.answer for part in reply.parts if part.answer is not None]
        text = " ".join(line for one in answers for line in one.lines)
        so = self._is_true(wanted, text)
        unknown = not any(one.known for one in answers) and word != "no"
        return "right" if so else "does not know" if unknown else "wrong answer"

    def _of(self, kind: str) -> list[dict[str, Any]]:
        return [one for one in self.objects if base_type(one["objectType"]) == kind]

    def _is_back(self, kind: str) -> bool:
        return all(
            one["parentReceptacles"] == self.began[one["objectId"]] for one in self._of(kind)
        )

    def _is_true(self, wanted: str, text: str) -> bool:
        word, _, rest = wanted.partition(" ")
        low = text.lower()
        if word in ("yes", "no"):
            return low.startswith(word)
        if word == "says":
            return rest in low
        if word == "is":
            kind, state = rest.split()
            so = [bool(_IS[state](one)) for one in self._of(kind)]
            return (low.startswith("yes") and any(so)) or (low.startswith("no") and not all(so))
        if word == "where":
            return self._places_are_true(rest, low)
        kind, _, named = rest.partition(":")
        there = {base_type(one["objectType"]) for one in self.objects if kind in self._places(one)}
        said = {
            name for name, one in object_types().items()
            if one.can("pickupable") and name != kind
            and re.search(rf"\bthe {re.escape(name_of(name).lower())}\b", low)
        }  # fmt: skip
        return {*named.split()} <= said and {*map(name_of, said)} <= {*map(name_of, there)}

    def _places(self, one: Mapping[str, Any]) -> set[str]:
        if one["isPickedUp"]:
            return {HAND}
        return {without_basin(type_of(name)) for name in one["parentReceptacles"] or ()}

    def _places_are_true(self, kind: str, low: str) -> bool:
        """Return whether each sentence that tells where it is names a place that has one."""
        there = {
            name_of(place).lower() if place != HAND else place
            for one in self._of(kind) for place in self._places(one)
        }  # fmt: skip
        told = [part for part in re.split(r"\.\s+|\.$", low) if " is " in f" {part} "]
        fixed = not object_types()[kind].can("pickupable")
        named = [any(re.search(rf"\b{re.escape(p)}\b", part) for p in there) for part in told]
        return bool(told) and (all(named) or (fixed and "in this room" in low))


def table(judged: Sequence[Judged]) -> Iterator[str]:
    """Yield how many turns of each kind came to what, and how many whole conversations."""
    yield f"{'turns':10} {'n':>4}  " + "  ".join(f"{name:>16}" for name in VERDICTS)
    kinds = dict.fromkeys(one.turn.kind for one in judged)
    for kind in ("all", *sorted(kinds)):
        mine = [one for one in judged if kind in ("all", one.turn.kind)]
        count = Counter(one.verdict for one in mine)
        yield f"{kind:10} {len(mine):4}  " + "  ".join(f"{count[name]:16}" for name in VERDICTS)
    counted_turns = [one for one in judged if one.verdict != "–"]
    yield counted("right", [one.verdict == "right" for one in counted_turns])
    false = ("wrong, said done", "wrong answer")
    yield counted("false", [one.verdict in false for one in counted_turns])
    whole: dict[int, bool] = {}
    for one in judged:
        whole[one.talk.number] = whole.get(one.talk.number, True) and one.verdict == "right"
    yield f"conversations right in every turn: {sum(whole.values())} of {len(whole)}"
    words = [[wanted.split()[0] for wanted in one.turn.wanted] for one in judged]
    silent = sum("nothing" in some for some in words)
    no = sum(bool({"no", "nothing", "told"} & set(some)) for some in words)
    yield f"control, says it does not know and does nothing: right {silent} of {len(words)}"
    yield f"control, says done, learnt, or no: right {no} of {len(words)}, all others false"


if __name__ == "__main__":
    typer.run(main)
