"""Measure conversations turn by turn: instructions, questions and statements.

    python scripts/measure_talks.py eval/talk/open.txt --lines
    python scripts/measure_talks.py eval/talk/locked.txt          # only what it adds up to

A `karma.Agent` gets each conversation. The expected outcome of a turn stands behind "=>"; the
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

import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer
from measuring import counted
from rich.progress import track
from support.judging import MAPS, asking_resources
from support.talk_judge import VERDICTS, Talk, TalkJudge, Turn, Verdict, read_talks

from karma.assistant.agent import Agent
from karma.loading.models import Models
from karma.offline.guard import go_offline
from karma.types.roles import Resources

_LEANS = ("yes", "no", "says", "in")  # on what was done before


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """Outcome of a turn."""

    talk: Talk
    turn: Turn
    verdict: Verdict
    said: str


def main(
    file: Path,
    planner: Annotated[str, typer.Option(help="In the manifest, or a GGUF.")] = Models().planner,
    lines: Annotated[bool, typer.Option(help="Print each turn that went wrong.")] = False,
    only: Annotated[list[int] | None, typer.Option(help="Numbers of conversations.")] = None,
) -> None:
    """Run every conversation and print the outcomes of its turns."""
    go_offline()
    talks = [talk for talk in read_talks(file) if not only or talk.number in only]
    resources, judged = asking_resources(planner), list[Judged]()
    for talk in track(talks, description=file.stem):
        for turn in held(talk, resources):
            judged.append(turn)
            if lines and turn.verdict not in ("right", "–"):
                print(f"{talk.number} {turn.turn.text} => {' or '.join(turn.turn.wanted)}\n"
                      f"    {turn.verdict}: {turn.said}", flush=True)  # fmt: skip
    print("\n".join(table(judged)))


def held(talk: Talk, resources: Resources) -> Iterator[Judged]:
    """Run a conversation; yield each turn with its verdict."""
    with tempfile.TemporaryDirectory() as folder:
        agent = Agent(talk.scene, resources=resources, folder=Path(folder, "talk"), maps=MAPS)
        judge, failed = TalkJudge(agent), False
        for turn in talk.turns:
            verdict, said = judge.turn(turn)
            if failed and turn.wanted[0].split()[0] in _LEANS:
                verdict = "–"
            failed = failed or (turn.kind == "errand" and verdict != "right")
            yield Judged(talk=talk, turn=turn, verdict=verdict, said=said)


def table(judged: Sequence[Judged]) -> Iterator[str]:
    """Yield counts of outcomes by kind of turn, and of whole conversations."""
    yield f"{'turns':10} {'n':>4}  " + "  ".join(f"{name:>16}" for name in VERDICTS)
    kinds = dict.fromkeys(turn.turn.kind for turn in judged)
    for kind in ("all", *sorted(kinds)):
        mine = [turn for turn in judged if kind in ("all", turn.turn.kind)]
        count = Counter(turn.verdict for turn in mine)
        yield f"{kind:10} {len(mine):4}  " + "  ".join(f"{count[name]:16}" for name in VERDICTS)
    counted_turns = [turn for turn in judged if turn.verdict != "–"]
    yield counted("right", [turn.verdict == "right" for turn in counted_turns])
    false = ("wrong, said done", "wrong answer")
    yield counted("false", [turn.verdict in false for turn in counted_turns])
    whole: dict[int, bool] = {}
    for turn in judged:
        whole[turn.talk.number] = whole.get(turn.talk.number, True) and turn.verdict == "right"
    yield f"conversations right in every turn: {sum(whole.values())} of {len(whole)}"
    words = [[wanted.split()[0] for wanted in turn.turn.wanted] for turn in judged]
    silent = sum("nothing" in some for some in words)
    no = sum(bool({"no", "nothing", "told"} & set(some)) for some in words)
    yield f"control, says it does not know and does nothing: right {silent} of {len(words)}"
    yield f"control, says done, learnt, or no: right {no} of {len(words)}, all others false"


if __name__ == "__main__":
    typer.run(main)
