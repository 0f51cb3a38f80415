"""One day of a run, lived again and written down: who went where, and what was asked and said."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from karma.benchmarks.lived.experiment import HomeSpec, LivedExperiment, LivedRow
from karma.benchmarks.lived.play import HomeLife
from karma.benchmarks.lived.records import LivedRecord, ServedRequest
from karma.contracts import Deed, Embedder, HomeAnswer, Sighting
from karma.errors import KarmaError
from karma.household.places import HAND
from karma.methods.lived.body import HomeRobot
from karma.tasks.lived import LivedRequest, Reader
from karma.world.core.scene import Scene


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotStep:
    """Where the robot is from a time on."""

    time_s: float
    x_m: float
    z_m: float
    yaw_deg: float
    held: str  # id of what is in its hand; "" nothing


@dataclass(frozen=True, slots=True, kw_only=True)
class TracedDeed:
    """A deed of the log of truth, and where its thing lies from then on."""

    time_s: float
    who: str
    action: str
    object_id: str
    place_id: str | None
    x_m: float
    z_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TracedRequest:
    """A request with what memory had, what was so, and what was said."""

    begin_s: float
    end_s: float
    speaker: str
    served: ServedRequest
    believed: Sighting | None  # what memory took to be meant, and where
    truth: tuple[Sighting, ...]  # the things that are meant, where they were then
    answer: HomeAnswer


@dataclass(frozen=True, slots=True, kw_only=True)
class DayTrace:
    """A day."""

    scene: Scene
    record: LivedRecord
    people: tuple[tuple[str, str], ...]  # name, and the room they begin the day in
    things: tuple[Sighting, ...]  # where everything is at midnight
    steps: tuple[RobotStep, ...]
    deeds: tuple[TracedDeed, ...]
    requests: tuple[TracedRequest, ...]


@dataclass(slots=True)
class DayWatch:
    """Writes down what it sees of a home, and changes nothing."""

    robot: HomeRobot
    steps: list[RobotStep] = field(default_factory=list)
    deeds: list[TracedDeed] = field(default_factory=list)
    requests: list[TracedRequest] = field(default_factory=list)
    logged: int = 0  # deeds of the log that are written down

    def acted(self) -> None:
        """Take note of where the robot is, and of what has been done since."""
        household, pose = self.robot.household, self.robot.household.world.state.pose
        x, _, z = pose.position_m
        step = RobotStep(
            time_s=self.robot.time_s, x_m=x, z_m=z, yaw_deg=pose.yaw_deg, held=self.robot.held or ""
        )
        if not self.steps or self.steps[-1] != step:
            self.steps.append(step)
        new = household.log[self.logged :]
        last = {deed.object_id: number for number, deed in enumerate(new)}
        self.deeds += [
            self._traced(deed, is_last=last[deed.object_id] == number)
            for number, deed in enumerate(new)
        ]
        self.logged = len(household.log)

    def served(
        self, request: LivedRequest, served: ServedRequest, believed: Sighting | None,
        truth: Sequence[Sighting], answer: HomeAnswer,
    ) -> None:  # fmt: skip
        """Take note of a request that is over."""
        one = TracedRequest(
            begin_s=request.time_s, end_s=self.robot.time_s, speaker=request.speaker,
            served=served, believed=believed, truth=tuple(truth), answer=answer,
        )  # fmt: skip
        self.requests.append(one)

    def _traced(self, deed: Deed, *, is_last: bool) -> TracedDeed:
        """Return a deed with where its thing then lies; between two, the middle of its place."""
        objects = self.robot.household.world.state.objects
        there = objects.get(deed.object_id if is_last else deed.place_id or deed.object_id)
        x, _, z = there.center if there is not None else (0.0, 0.0, 0.0)
        return TracedDeed(
            time_s=deed.time_s, who=deed.who, action=deed.action, object_id=deed.object_id,
            place_id=deed.place_id, x_m=x, z_m=z,
        )  # fmt: skip


def trace_day(
    experiment: LivedExperiment, row: LivedRow, spec: HomeSpec, seed: int, day: int,
    embedder: Embedder, reader: Reader, *, expected: Sequence[LivedRecord],
) -> DayTrace:  # fmt: skip
    """Live a home again up to a day, and write that day down.

    Args:
        experiment: of the run.
        row: of it.
        spec: the home.
        seed: of the run.
        day: the last to be lived, from 0.
        embedder: of the run.
        reader: of its requests.
        expected: what the run recorded of those days.

    Raises:
        KarmaError: another day came out than the run recorded.
    """
    life = HomeLife(experiment, row, spec, seed, embedder, reader)
    try:
        lived = [life.day(number) for number in range(day)]
        things = tuple(one for one in life.now().values() if one.place_id != HAND)
        people, watch = life.people(), DayWatch(life.robot, logged=life.logged())
        life.watch(watch)
        lived.append(life.day(day))
    finally:
        life.close()
    for number, record in enumerate(lived):
        if record != expected[number]:
            raise KarmaError(
                f"{record.task} of row {row.name!r} comes out otherwise than this run recorded it\n"
                "  To fix: use the version of karma that its run.json names, or karma eval --fresh"
            )
    return DayTrace(
        scene=life.scene, record=lived[day], people=people, things=things,
        steps=tuple(watch.steps), deeds=tuple(watch.deeds), requests=tuple(watch.requests),
    )  # fmt: skip
