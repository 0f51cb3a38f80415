"""Replays as a recording for the Rerun viewer; needs the extra `rerun`."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from karma.errors import FileError, KarmaError
from karma.report.episodes import EpisodeReplay, episode_key
from karma.report.frames import Frames
from karma.report.replay import Sight
from karma.report.story import Moment, Part

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
        """Write what stays, then a step per moment."""
        import rerun

        room = self._episode.room
        self._log(
            "map/furniture",
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
                "map/areas",
                rerun.Points2D(
                    [[one.x, one.y] for one in room.areas],
                    labels=[f"{one.name}: {', '.join(one.contains)}" for one in room.areas],
                    show_labels=False,
                ),
                static=True,
            )
        sights = self._episode.replay.sights
        path = [_point(sight) for sight in sights]
        self._log("map/path", rerun.LineStrips2D([path]), static=True)
        for number, moment in enumerate(self._episode.story.moments):
            self._recording.set_time(TIMELINE, sequence=number)
            self._log("log", rerun.TextLog(_said(moment), level="INFO" if moment.ok else "WARN"))
            self._log("map/agent", rerun.Points2D([path[number]], radii=8.0))
            self._see(sights, number)
            if moment.part >= 0:
                self._know(moment, self._episode.story.parts[moment.part])

    def _see(self, sights: Sequence[Sight], number: int) -> None:
        import rerun

        frame = sights[number].frame
        if frame >= 0 and (not number or frame != sights[number - 1].frame):
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
            filter(None, (changes.get(one.object_id), one.object_id, *one.states, one.place_id))
        )
        for one in units
    ]
    lines += [f"left {object_id}" for object_id, how in changes.items() if how == "left"]
    return "\n".join(lines) or "empty"


def _point(sight: Sight) -> tuple[float, float]:
    """Return where the agent stands on the map, whose y axis points down, in centimetres."""
    return 100 * sight.x_m, -100 * sight.z_m


def _said(moment: Moment) -> str:
    return f"{moment.kind}: {moment.text}" + (f" ({moment.error})" if moment.error else "")


def _name(text: str) -> str:
    """Return a part of an entity's path: letters, digits and what needs no escape."""
    return "".join(letter if letter.isalnum() or letter in "-_." else "_" for letter in text)
