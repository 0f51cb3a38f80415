"""ALFRED's demonstrations, whose rooms, starts and goals its benchmarks take."""

from collections.abc import Mapping
from dataclasses import astuple, dataclass
from pathlib import Path

from karma.world.alfred.facts import RoomFacts, gather, side_files
from karma.world.alfred.trial import Trial, read_trials


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialRooms:
    """The demonstrations by id, and what is known of their rooms."""

    trials: Mapping[str, Trial]
    facts: Mapping[str, RoomFacts]

    def missing(self, trial: str) -> str:
        """Return why a trial cannot be begun; "" if it can."""
        if trial not in self.trials:
            return f"there is no trial {trial}"
        if not self.facts[self.trials[trial].scene.floor_plan].cells:
            return f"there is nothing to stand on in {self.trials[trial].scene.floor_plan}"
        return ""


def read_rooms(path: Path) -> TrialRooms:
    """Read the demonstrations of a file, and what is known of their rooms.

    Raises:
        FileError: a file is missing, torn or of another form.
    """
    trials = {trial.id: trial for trial in read_trials(path)}
    return TrialRooms(trials=trials, facts=gather(trials.values(), side_files()))


def room_files(path: Path) -> list[Path]:
    """Return the file of demonstrations, and those beside it that tell of their rooms."""
    return [path, *filter(None, astuple(side_files()))]
