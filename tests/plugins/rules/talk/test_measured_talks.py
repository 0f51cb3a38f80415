"""The conversations that are measured: locked by hash, readable, and judged by truth."""

from collections import Counter
from hashlib import sha256
from pathlib import Path

import pytest
from support.talk_judge import TalkJudge, Turn, read_talks
from support.talking import STORE, TAKE, WASH, agent_saying

from karma.goals.goals import parse_goal
from karma.world.core import scene

TALKS = Path("eval/talk")
LOCKED = "0157e7e5a1c0ae9cfd1384e190026ef7b0118edc3c46969552ba7e4551240943"


def test_locked_conversations_are_as_they_were_written():
    assert sha256((TALKS / "locked.txt").read_bytes()).hexdigest() == LOCKED


@pytest.mark.parametrize("name", ["open.txt", "locked.txt"])
def test_conversations_are_a_hundred_each_in_rooms_that_exist(name):
    talks = read_talks(TALKS / name)
    assert len(talks) == 100
    for talk in talks:
        scene.find(talk.scene)
        for turn in talk.turns:
            assert turn.text
            for wanted in turn.wanted:
                for goal in wanted.split(";") if "(" in wanted else ():
                    parse_goal(goal)
    kinds = Counter(turn.kind for talk in talks for turn in talk.turns)
    assert set(kinds) == {"errand", "question", "told", "nothing"}


def test_the_judge_goes_by_the_world_and_not_by_what_was_said(tmp_path):
    agent = agent_saying(tmp_path, [TAKE + WASH, STORE], home=tmp_path / "home")
    judge = TalkJudge(agent)

    def verdict(text, *wanted):
        return judge.turn(Turn(text=text, wanted=wanted))[0]

    assert verdict("wash the apple", "ON(Apple, Fridge)") == "wrong, said done"
    assert verdict("put it in the fridge", "OPEN(Fridge)", "ON(Apple, Fridge)") == "right"
    assert verdict("where is the apple?", "where Apple") == "right"
    assert verdict("where is the apple?", "where Knife") == "wrong answer"
    assert verdict("is the fridge open?", "is Fridge open") == "right"
    assert verdict("is the fridge open?", "yes") == "wrong answer"
    assert verdict("what is in the fridge?", "in Fridge: Apple") == "right"
    assert verdict("what is in the fridge?", "in Fridge: Knife") == "wrong answer"
    assert verdict("where is the vase?", "where Vase") == "does not know"
    assert verdict("why is the apple round?", "says apple") == "refused"
    assert verdict("did you wash the apple?", "no") == "wrong answer"
