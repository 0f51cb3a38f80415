"""ALFRED's trials as tasks for our own agents: in others' lists, or all that people said of them.

Rooms are those of the trials, with what can be moved, dirt, switches and the robot's place as they
were at the demonstration's start; goals are ALFRED's conditions, in our language. What cannot be
asked stays in as a task without goals, whose note says why.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Literal

import msgspec

from karma.agent.loading.demonstrations import plain, sentences_in
from karma.bench.tasks.alfred import task_of
from karma.bench.tasks.alfred_lists import ListedTask, read_lists
from karma.contracts import SceneRef, SubTask, Task
from karma.errors import FileError, KarmaError
from karma.files import to_json
from karma.world.alfred.facts import RoomFacts, gather, side_files
from karma.world.alfred.replay import fitted
from karma.world.alfred.trial import Trial, read_trials


class AlfredTasks(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Which of ALFRED's tasks are asked."""

    trials: str  # demonstrations
    lists: str = ""  # file of lists of tasks; "" = everything that people said of every trial
    names: tuple[str, ...] = ()  # of those lists; () = all
    by: Literal["type", "list"] = "type"  # of task; what is counted apart
    training: str = ""  # demonstrations whose sentences a planner was trained on

    def __post_init__(self) -> None:
        """Refuse what needs a file of lists without one."""
        if not self.lists and (self.names or self.by == "list"):
            raise ValueError("names and by = 'list' need `lists`")


def alfred_tasks(source: AlfredTasks) -> tuple[tuple[Task, ...], dict[str, bytes]]:
    """Return the tasks, and the rooms that they play in by name.

    Raises:
        FileError: a file is missing, torn or of another form, or a list is not in it. A training
            file that is missing is none: then it is not known what is in it.
    """
    trials = {trial.id: trial for trial in read_trials(source.trials)}
    listed = (
        read_lists(Path(source.lists), source.names)
        if source.lists
        else tuple(_all_said(trials.values()))
    )
    known = _known(source.training)
    rooms = _Rooms(trials, gather(trials.values(), side_files()))
    tasks = tuple(_grouped(_task(one, rooms), one, source, known) for one in listed)
    return tasks, rooms.scenes


def _all_said(trials: Iterable[Trial]) -> Iterator[ListedTask]:
    for trial in trials:
        for number in range(len(trial.annotations)):
            yield ListedTask(
                list=trial.id,
                position=number,
                folder=trial.task_type,
                trial=trial.id,
                repeat=number,
            )


def _known(training: str) -> frozenset[str] | None:
    return sentences_in(Path(training)) if training and Path(training).exists() else None


def _grouped(
    task: Task, one: ListedTask, source: AlfredTasks, known: frozenset[str] | None
) -> Task:
    said = (plain(sub.instruction) for sub in task.subtasks)
    return replace(
        task,
        group=one.list if source.by == "list" else one.folder.partition("-")[0],
        trained=None if known is None else all(text in known for text in said),
    )


class _Rooms:
    """The rooms of trials, each built once, when it is first asked for."""

    def __init__(self, trials: Mapping[str, Trial], facts: Mapping[str, RoomFacts]) -> None:
        self.trials, self._facts = trials, facts
        self.scenes: dict[str, bytes] = {}

    def of(self, trial: Trial) -> SceneRef:
        """Return the room of a trial.

        Raises:
            KarmaError: the trial contradicts itself, or there is nothing to stand on.
        """
        plan = trial.scene.floor_plan
        ref = SceneRef(name=f"{plan}-{trial.id}")
        if ref.name not in self.scenes:
            if not self._facts[plan].cells:
                raise KarmaError(f"there is nothing to stand on in {plan}")
            scene = fitted(trial, self._facts[plan])
            self.scenes[ref.name] = to_json(msgspec.structs.replace(scene, name=ref.name))
        return ref


def _task(one: ListedTask, rooms: _Rooms) -> Task:
    """Return one task; without goals where it cannot be asked."""
    text = one.instruction
    try:
        trial = rooms.trials.get(one.trial)
        if trial is None:
            raise KarmaError(f"there is no trial {one.trial}")
        if not text and not 0 <= one.repeat < len(trial.annotations):
            raise KarmaError(f"trial {one.trial} has no annotation {one.repeat}")
        text = text or trial.annotations[one.repeat].task_desc
        return task_of(trial, text, scene=rooms.of(trial), id=one.id)
    except KarmaError as error:
        reason = error.reason if isinstance(error, FileError) else str(error)
        return Task(
            id=one.id,
            kind="simple",
            scene=SceneRef(name=one.trial),
            subtasks=(SubTask(instruction=text, whole=text),),
            notes=(f"unresolved {one.id}: {reason}",),
        )
