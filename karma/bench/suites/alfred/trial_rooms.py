"""ALFRED's demonstrations, whose rooms, starts and goals its benchmarks take."""

from collections.abc import Collection, Mapping
from dataclasses import astuple, dataclass
from pathlib import Path

from karma.errors import FileError
from karma.world.alfred.facts import RoomFacts, gather, side_files
from karma.world.alfred.trial import Trial, read_trials, trial_files


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


def read_rooms(path: Path, listed: Collection[str] = ()) -> TrialRooms:
    """Read the demonstrations of a file, and what is known of their rooms.

    Args:
        path: the file.
        listed: ids of those that are to be begun.

    Raises:
        FileError: a file is missing, torn or of another form, or most that are listed are not
            there: the list is of other demonstrations.
    """
    trials = {trial.id: trial for trial in read_trials(path)}
    there = len({*listed} & trials.keys())
    if 2 * there < len({*listed}):
        reason = f"holds {there} of the {len({*listed})} trials that are listed"
        raise FileError(path, reason, fix="trials = the file of the split that the list is of")
    return TrialRooms(trials=trials, facts=gather(trials.values(), side_files()))


def room_files(path: Path) -> list[Path]:
    """Return the files of demonstrations, and those that tell of their rooms."""
    return [*trial_files(path), *filter(None, astuple(side_files()))]
