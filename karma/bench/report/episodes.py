"""Episodes of a run, and of long ones instructions, chosen and made ready to be stepped through."""

import re
from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

from karma.agent.journal.records import EpisodeRecord
from karma.agent.journal.run_folder import RunData
from karma.agent.journal.steps import read_steps, steps_path
from karma.bench.report.html import Frames
from karma.bench.report.replay import FrameChoice, Replay, Rooms, automatic, replaying
from karma.bench.report.results import SHORT, episode_key
from karma.bench.report.room import RoomPlan, plan_of
from karma.bench.report.story import EpisodeStory, FailedAt, broke_off_at, failed_at, told
from karma.errors import KarmaError
from karma.memory.scene_graph import SceneGraph
from karma.world.core import scene as scenes

TOGETHER, LEAST = 200, 8  # instructions of all long episodes of a page; of each, at least


def choose(records: Sequence[EpisodeRecord], wanted: str) -> list[EpisodeRecord]:
    """Return the chosen episodes, in the run's order.

    What is wanted is "all"; a number: so many, failures first, taken from the rows in turn; a
    task's id: all episodes of it; or an episode's key, "ROW/TASK/SEED".

    Raises:
        KarmaError: it is none of these.
    """
    if wanted == "all":
        return list(records)
    tasks = list(dict.fromkeys(record.task for record in records))
    if wanted in tasks:
        return [record for record in records if record.task == wanted]
    if one := [record for record in records if episode_key(record) == wanted]:
        return one
    if not wanted.isdecimal():
        raise KarmaError(
            f"--episodes {wanted!r}: neither a number nor a task nor an episode of the run\n"
            f"  To fix: all, a number, ROW/TASK/SEED, or one of {', '.join(tasks[:6])}"
            + (f" and {len(tasks) - 6} more" if len(tasks) > 6 else "")
        )
    failed = _in_turn([record for record in records if not record.success])
    solved = _in_turn([record for record in records if record.success])
    kept = {id(record) for record in [*failed, *solved][: int(wanted)]}
    return [record for record in records if id(record) in kept]


def _in_turn(records: Sequence[EpisodeRecord]) -> list[EpisodeRecord]:
    """Return the first of each row, then the second of each, and so on."""
    rows: dict[str, list[EpisodeRecord]] = {}
    for record in records:
        rows.setdefault(record.row, []).append(record)
    longest = max(map(len, rows.values()), default=0)
    return [mine[turn] for turn in range(longest) for mine in rows.values() if turn < len(mine)]


def choose_instructions(records: Sequence[EpisodeRecord], wanted: str) -> list[tuple[int, ...]]:
    """Return the numbers of the instructions that are shown of each episode, from 0.

    What is wanted is "all"; numbers from 1 and spans of them such as "1-40,77"; or "auto": all of
    short episodes; of long ones those that failed first and then others, spread evenly, so that the
    page stays usable.

    Raises:
        KarmaError: it is none of these, or no episode has such an instruction.
    """
    counts = [len(record.subtasks) + bool(record.error) for record in records]
    if wanted == "all":
        return [tuple(range(count)) for count in counts]
    if wanted != "auto":
        numbers = _numbers(wanted, max(counts, default=0))
        return [tuple(n for n in numbers if n < count) for count in counts]
    long = sum(count > SHORT for count in counts)
    share = max(LEAST, TOGETHER // long) if long else 0
    return [
        tuple(range(count)) if count <= max(SHORT, share) else _worth(record, count, share)
        for record, count in zip(records, counts, strict=True)
    ]


def _worth(record: EpisodeRecord, count: int, share: int) -> tuple[int, ...]:
    """Return so many instructions: those that failed before the others."""
    failed = [
        n for n in range(count) if n == len(record.subtasks) or not record.subtasks[n].success
    ]
    shown = _spread(failed, share)
    others = sorted(set(range(count)) - set(failed))
    return tuple(sorted((*shown, *_spread(others, share - len(shown)))))


def _spread(numbers: Sequence[int], most: int) -> list[int]:
    """Return at most so many of the numbers, evenly spread, the first among them.

    >>> _spread(range(10), 4)
    [0, 2, 5, 7]
    """
    if len(numbers) <= most:
        return list(numbers)
    return [numbers[n * len(numbers) // most] for n in range(most)]


def _numbers(wanted: str, most: int) -> list[int]:
    """Return the numbers from 0 that a text names from 1."""
    found: set[int] = set()
    for piece in map(str.strip, wanted.split(",")):
        span = re.fullmatch(r"(\d+)(?:-(\d+))?", piece, re.ASCII)
        first, last = (int(span[1]), int(span[2] or span[1])) if span else (0, 0)
        if not 1 <= first <= min(last, most):
            raise KarmaError(
                f"--instructions {wanted!r}: {piece!r} names none of 1 to {most}\n"
                f"  To fix: auto, all, or numbers and spans such as 1-{min(most, 25)}"
            )
        found.update(range(first - 1, min(last, most)))
    return sorted(found)


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeReplay:
    """One episode that can be stepped through."""

    record: EpisodeRecord
    story: EpisodeStory
    replay: Replay
    rooms: Mapping[str, RoomPlan]  # by scene, in the order in which they are entered
    shown: frozenset[int]  # numbers of the instructions that can be stepped through
    goals: tuple[tuple[str, ...], ...] = ()  # of each instruction of the task, as far as is known

    @property
    def steps(self) -> tuple[int, ...]:
        """Numbers of the moments that can be stepped through."""
        parts = {-1, *self.shown}
        moments = self.story.moments[: len(self.replay.sights)]
        return tuple(number for number, moment in enumerate(moments) if moment.part in parts)

    @property
    def failed(self) -> FailedAt | None:
        """Where it failed; None if it did not, or not in what can be stepped through."""
        if self.record.success:
            return None
        found = failed_at(self.story, self.shown)
        if found is None and self.record.error and self.steps:
            return broke_off_at(self.story, self.steps[-1] + 1)
        return found

    @property
    def opens_at(self) -> int:
        """Which of `steps` a reader wants to see first: where it failed, else the first."""
        return bisect_left(self.steps, self.failed.moment) if self.failed else 0

    @property
    def trouble(self) -> str:
        """Where the replay left the log; "" when it did not."""
        count = len(self.replay.differing)
        if not count:
            return ""
        first = bisect_left(self.steps, self.replay.differing[0]) + 1
        return (
            f"In the replay {count} of {self.replay.actions} actions did not go as logged, the "
            f"first at step {first}: what is drawn after it may be wrong."
        )


def goals_of(records: Sequence[EpisodeRecord], task: str) -> tuple[tuple[str, ...], ...]:
    """Return the goals of each instruction of a task, by its longest record."""
    mine = (record.subtasks for record in records if record.task == task)
    return tuple(sub.goals for sub in max(mine, key=len, default=()))


def _actions(record: EpisodeRecord, numbers: Sequence[int]) -> int:
    """Return the world actions of some instructions of an episode."""
    parts = (record.subtasks[n] for n in numbers if n < len(record.subtasks))
    return sum(call.actions for part in parts for call in part.calls)


class Replayer:
    """Replays episodes of one run.

    With the choice "auto" there are the fewer pictures the more there is to show on the page.
    """

    def __init__(self, run: RunData, frames: Frames, choice: FrameChoice) -> None:
        self._run, self._frames, self._choice = run, frames, choice
        self._room: Callable[[str], RoomPlan] = cache(self._load_room)

    def replaying(
        self, records: Sequence[EpisodeRecord], instructions: str = "all"
    ) -> "Iterator[EpisodeReplay | float]":
        """Yield those of the episodes that have a step log with a beginning, and how far it is.

        That is a number between them: the share that is done of all, in [0, 1].

        An episode that was lost with its worker has none, nor one whose method did not get to work.

        For `instructions` see `choose_instructions`.

        Raises:
            FileError: a log, a scene or a map is damaged.
            KarmaError: there are no such instructions.
        """
        there = [r for r in records if steps_path(self._run.folder, *r.key).exists()]
        chosen = choose_instructions(there, instructions)
        choice = self._choice
        if choice == "auto":
            choice = automatic(sum(map(_actions, there, chosen)))
        for count, (record, numbers) in enumerate(zip(there, chosen, strict=True)):
            story = told(read_steps(steps_path(self._run.folder, *record.key)))
            if not story.moments:
                continue
            shown = frozenset(numbers) & frozenset(range(len(story.parts)))
            goals = goals_of(self._run.records, record.task)
            rooms = {name: self._room(name) for name in story.scenes}
            home = Rooms(self._place)  # the log's first actions set the day up
            for one in replaying(story, home, self._frames, choice, shown, goals):
                if isinstance(one, Replay):
                    yield EpisodeReplay(
                        record=record, story=story, replay=one, rooms=rooms, shown=shown,
                        goals=goals,
                    )  # fmt: skip
                else:
                    yield (count + one) / len(there)

    def _place(self, name: str) -> str:
        """Return the scene's file in the run folder, or its name if it is one of ours."""
        imported = self._run.folder / "scenes" / f"{name}.json"
        return str(imported) if imported.exists() else name

    def _load_room(self, name: str) -> RoomPlan:
        path = self._run.folder / "maps" / f"{name}.json"
        graph = SceneGraph.load(path) if path.exists() else None
        return replace(plan_of(scenes.load(self._place(name)), graph), scene=name)
