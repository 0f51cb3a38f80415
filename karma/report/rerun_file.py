"""Replays as a recording for the Rerun viewer; needs the extra `rerun`."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from karma.errors import FileError, KarmaError
from karma.report.choice import episode_key
from karma.report.episodes import EpisodeReplay
from karma.report.frames import Frames
from karma.report.replay import Sight
from karma.report.room import RoomPlan
from karma.report.story import Moment, Part, unit_key

if TYPE_CHECKING:
    from rerun import RecordingStream

TIMELINE = "step"


def write_rerun(path: Path, name: str, replays: Sequence[EpisodeReplay], frames: Frames) -> None:
    """Write a recording; nothing is shown, nothing is sent.

    Each episode has a branch of its own; all begin at step 0 of the timeline "step".

    Args:
        path: of the *.rrd file.
        name: of the run.
        replays: the episodes.
        frames: the pictures that they name by number.

    Raises:
        KarmaError: rerun-sdk is not installed.
        FileError: the file cannot be written.
    """
    try:
        import rerun
    except ImportError as error:
        raise KarmaError(
            "rerun-sdk is not installed\n  To fix: pip install 'karma-offline[rerun]'"
        ) from error
    recording = rerun.RecordingStream(f"karma {name}", recording_id=name, send_properties=False)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        recording.save(path)
    except (OSError, RuntimeError) as error:
        raise FileError(path, f"cannot write: {error}", fix="choose another file") from error
    for one in replays:
        _Branch(recording, one, frames).write()
    recording.flush()
    recording.disconnect()


class _Branch:
    """One episode in a recording."""

    def __init__(
        self, recording: "RecordingStream", episode: EpisodeReplay, frames: Frames
    ) -> None:
        self._recording, self._episode, self._frames = recording, episode, frames
        self._at = "/".join(_name(part) for part in episode_key(episode.record).split("/"))

    def write(self) -> None:
        """Write what stays, then a step per moment that is shown."""
        import rerun

        steps, sights = self._episode.steps, self._episode.replay.sights
        moments = [self._episode.story.moments[number] for number in steps]
        rooms = list(self._rooms(moments))
        for room in self._episode.rooms.values():
            path = [_point(sights[n]) for n, here in zip(steps, rooms, strict=True) if here is room]
            self._furnish(room, path)
        for number, (step, moment, room) in enumerate(zip(steps, moments, rooms, strict=True)):
            self._recording.set_time(TIMELINE, sequence=number)
            self._log("log", rerun.TextLog(_said(moment), level="INFO" if moment.ok else "WARN"))
            if number and room is not rooms[number - 1]:
                self._log(f"{self._map(rooms[number - 1])}/agent", rerun.Clear(recursive=False))
            self._log(f"{self._map(room)}/agent", rerun.Points2D([_point(sights[step])], radii=8.0))
            self._see(sights[step].frame, sights[steps[number - 1]].frame if number else -1)
            if moment.part >= 0:
                self._know(moment, self._episode.story.parts[moment.part])

    def _rooms(self, moments: Sequence[Moment]) -> Iterator[RoomPlan]:
        """Yield the room that each moment is in."""
        story, rooms = self._episode.story, self._episode.rooms
        for moment in moments:
            yield rooms[story.scene_of(moment)]

    def _map(self, room: RoomPlan) -> str:
        """Return where a room stands in the branch; the only one is simply the map."""
        return "map" if len(self._episode.rooms) == 1 else f"map/{_name(room.scene)}"

    def _furnish(self, room: RoomPlan, path: Sequence[tuple[float, float]]) -> None:
        """Write what stays in a room, and the path through it."""
        import rerun

        self._log(
            f"{self._map(room)}/furniture",
            rerun.Boxes2D(
                array=[[one.x, one.y, one.width, one.height] for one in room.shapes],
                array_format=rerun.Box2DFormat.XYWH,
                labels=[one.title for one in room.shapes],
                show_labels=False,
            ),
            static=True,
        )
        if room.areas:
            self._log(
                f"{self._map(room)}/areas",
                rerun.Points2D(
                    [[one.x, one.y] for one in room.areas],
                    labels=[f"{one.name}: {', '.join(one.contains)}" for one in room.areas],
                    show_labels=False,
                ),
                static=True,
            )
        self._log(f"{self._map(room)}/path", rerun.LineStrips2D([path]), static=True)

    def _see(self, frame: int, last: int) -> None:
        import rerun

        if frame >= 0 and frame != last:
            picture = rerun.EncodedImage(contents=self._frames.webp(frame), media_type="image/webp")
            self._log("first_person", picture)

    def _know(self, moment: Moment, part: Part) -> None:
        import rerun

        if moment.kind in ("subtask", "outcome"):
            self._log("memory", rerun.TextDocument(_memory(moment, part)))
        if moment.kind == "plan":
            plan = part.plans[moment.plan]
            self._log("prompt", rerun.TextDocument(plan.prompt))
            self._log("program", rerun.TextDocument(plan.program))

    def _log(self, entity: str, what: Any, *, static: bool = False) -> None:
        self._recording.log(f"{self._at}/{entity}", what, static=static)


def _memory(moment: Moment, part: Part) -> str:
    """Return short-term memory in lines: what became of a unit, its id, states and place."""
    if moment.kind == "subtask":
        units, changes = part.before, {}
    else:
        units, changes = part.after or (), dict(part.changes)
    lines = [
        " ".join(
            filter(None, (changes.get(unit_key(one)), unit_key(one), *one.states, one.place_id))
        )
        for one in units
    ]
    lines += [f"left {key}" for key, how in changes.items() if how == "left"]
    return "\n".join(lines) or "empty"


def _point(sight: Sight) -> tuple[float, float]:
    """Return where the agent stands on the map, whose y axis points down, in centimetres."""
    return 100 * sight.x_m, -100 * sight.z_m


def _said(moment: Moment) -> str:
    return f"{moment.kind}: {moment.text}" + (f" ({moment.error})" if moment.error else "")


def _name(text: str) -> str:
    """Return a part of an entity's path: letters, digits and what needs no escape."""
    return "".join(letter if letter.isalnum() or letter in "-_." else "_" for letter in text)
