"""Episodes of a run made ready to be stepped through."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from karma.bench.records import EpisodeRecord
from karma.bench.run_folder import RunData
from karma.bench.steps import read_steps, steps_path
from karma.memory.scene_graph import SceneGraph
from karma.report.frames import Frames
from karma.report.replay import SIZE_PX, FrameChoice, Replay, replay
from karma.report.room import AreaMark, RoomPlan, plan_of
from karma.report.story import Story, told
from karma.world import scene as scenes
from karma.world.sim import EmbeddedWorld


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeReplay:
    """One episode that can be stepped through."""

    record: EpisodeRecord
    story: Story
    replay: Replay
    room: RoomPlan

    @property
    def areas(self) -> tuple[AreaMark, ...]:
        """Long-term memory of the room; () when the run left none."""
        return self.room.areas

    @property
    def trouble(self) -> str:
        """Where the replay left the log; "" when it did not."""
        count = len(self.replay.differing)
        if not count:
            return ""
        return (
            f"In the replay {count} of {self.replay.actions} actions did not go as logged, the "
            f"first at step {self.replay.differing[0] + 1}: what is drawn after it may be wrong."
        )


def episode_key(record: EpisodeRecord) -> str:
    """Return what names an episode on the page and in its address."""
    return f"{record.row}/{record.task}/{record.seed}"


class Replayer:
    """Replays episodes of one run.

    Args:
        run: the run.
        frames: takes the pictures.
        choice: which pictures.
    """

    def __init__(self, run: RunData, frames: Frames, choice: FrameChoice) -> None:
        self._run, self._frames, self._choice = run, frames, choice
        self._room: Callable[[str], RoomPlan] = cache(self._load_room)

    def episodes(self, records: Sequence[EpisodeRecord]) -> Iterator[EpisodeReplay]:
        """Yield those of the episodes that have a step log.

        Raises:
            FileError: a log, a scene or a map is damaged.
        """
        for record in records:
            path = steps_path(self._run.folder, *record.key)
            if path.exists():
                yield self._one(record, path)

    def _one(self, record: EpisodeRecord, path: Path) -> EpisodeReplay:
        story = told(read_steps(path))
        world = EmbeddedWorld(width=SIZE_PX, height=SIZE_PX)
        world.reset(self._place(record.scene))  # the log's first actions set the day up
        done = replay(story, world, self._frames, self._choice)
        return EpisodeReplay(record=record, story=story, replay=done, room=self._room(record.scene))

    def _place(self, name: str) -> str:
        """Return the scene's file in the run folder, or its name if it is one of ours."""
        imported = self._run.folder / "scenes" / f"{name}.json"
        return str(imported) if imported.exists() else name

    def _load_room(self, name: str) -> RoomPlan:
        path = self._run.folder / "maps" / f"{name}.json"
        graph = SceneGraph.load(path) if path.exists() else None
        return plan_of(scenes.load(self._place(name)), graph)
