"""Episodes of a run made ready to be stepped through."""

from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

from karma.agent.journal.records import EpisodeRecord
from karma.agent.journal.run_folder import RunData
from karma.agent.journal.steps import read_steps, steps_path
from karma.bench.report.choice import choose_instructions
from karma.bench.report.html import Frames
from karma.bench.report.replay import FrameChoice, Replay, Rooms, automatic, replaying
from karma.bench.report.room import RoomPlan, plan_of
from karma.bench.report.story import EpisodeStory, FailedAt, broke_off_at, failed_at, told
from karma.memory.scene_graph import SceneGraph
from karma.world.core import scene as scenes


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
