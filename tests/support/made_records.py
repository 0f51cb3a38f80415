"""Records made by hand, with only what a test speaks of."""

import msgspec
from hypothesis import strategies as st

from karma.bench.figures.metrics import needs
from karma.files import to_json
from karma.journal.entries import Answer, Call
from karma.journal.folder import EPISODES, HEADER, TIMINGS
from karma.journal.header import Header
from karma.journal.records import EpisodeRecord, SubTaskRecord


def answer(program="GoToObject(robot, 'Apple')\n", error="", **changes):
    usual = {"finish": "stop", "prompt_tokens": 100, "completion_tokens": 10}
    return Answer(program=program, error=error, **{**usual, **changes})


def call(text, reason="", *, actions=10, explorations=0):
    return Call(text=text, ok=not reason, reason=reason, actions=actions, explorations=explorations)


def sub(*goals, unmet=(), recalled=(), hits=0, queries=0, answers=None, calls=(), finished=True,
        instruction="Do it."):  # fmt: skip
    """Return a sub-task; `unmet=True` misses every goal."""
    first, *others = (answer(),) if answers is None else (*answers, None)
    if first is not None:
        first = msgspec.structs.replace(first, recalled=tuple(recalled))
    return SubTaskRecord(
        instruction=instruction,
        goals=goals,
        unmet=goals if unmet is True else tuple(unmet),
        finished=finished,
        answers=tuple(one for one in (first, *others) if one is not None),
        calls=tuple(calls),
        queries=queries,
        hits=hits,
    )


def episode(*subtasks, row="KARMA", task="t1", kind="simple", seed=0, error=""):
    return EpisodeRecord(
        row=row, task=task, kind=kind, scene="kitchen_1", seed=seed, notes=(),
        subtasks=tuple(subtasks), error=error,
    )  # fmt: skip


def plain(solved, *, places=0, steps=10, row="KARMA", task="t1", kind="simple", seed=0):
    """Return an episode of one sub-task that was solved or not, and what it took."""
    done = call("Explore(robot, 'Apple')", actions=steps, explorations=places)
    one = sub("HOLDON(robot, Apple): 1", unmet=not solved or (), calls=[done])
    return episode(one, row=row, task=task, kind=kind, seed=seed)


APPLE, KNIFE, MUG = "Apple|+01.00|+00.90|+00.50", "Knife|-01.00|+00.90|+00.00", "Mug|+0|+1|+2"
_GOALS = ("INSIDE(Apple, Fridge): 1", "STATE(Apple, sliced): 1", "HOLDON(robot, Mug): 1",
          "ON(Apple/Mug, Plate): 1", "TOGGLEON(Faucet): 1")  # fmt: skip


@st.composite
def subtasks(draw, goals):
    """Draw what became of a sub-task with these goals."""
    queries = len(needs(goals))
    done = call(
        "Explore(robot, 'Apple')",
        draw(st.sampled_from(("", "could not find Apple; searched 3 places"))),
        actions=draw(st.integers(0, 50)),
        explorations=draw(st.integers(0, 9)),
    )
    return sub(
        *goals,
        unmet=draw(st.lists(st.sampled_from(goals), unique=True)),
        recalled=draw(st.lists(st.sampled_from((APPLE, KNIFE, MUG)), unique=True)),
        queries=queries,
        hits=draw(st.integers(0, queries)),
        answers=[answer()] * draw(st.integers(0, 2)),
        calls=[done] * draw(st.integers(0, 2)),
        finished=draw(st.booleans()),
    )


@st.composite
def runs(draw, rows=("KARMA", "memory off")):
    """Draw the records of a small run: each row over the same tasks and seeds."""
    records = []
    for number in range(draw(st.integers(1, 3))):
        kind = draw(st.sampled_from(("simple", "composite")))
        goals = st.lists(st.sampled_from(_GOALS), min_size=1, max_size=2, unique=True)
        asked = [tuple(one) for one in draw(st.lists(goals, min_size=1, max_size=3))]
        for seed in range(draw(st.integers(1, 2))):
            for row in rows:
                stops = draw(st.sampled_from((None, None, None, 0, 1)))  # an error ends it there
                parts = [draw(subtasks(one)) for one in asked[:stops]]
                error = (
                    ""
                    if stops is None
                    else draw(st.sampled_from(("WorldLost: x", "KarmaError: x")))
                )
                records.append(
                    episode(*parts, row=row, task=f"t{number}", kind=kind, seed=seed, error=error)
                )
    return records


def write_run(folder, records, *, name="made", timings=(), **header):
    """Write records as a run's folder."""
    usual = {"versions": {}, "options": {"rows": []}, "files": {"tasks": "0" * 64}}
    header = Header(name=name, **{**usual, **header})
    folder.mkdir(parents=True)
    (folder / HEADER).write_bytes(to_json(header, indent=2))
    for place, lines in ((EPISODES, records), (TIMINGS, timings)):
        (folder / place).write_bytes(b"".join(map(to_json, lines)))
    return folder
