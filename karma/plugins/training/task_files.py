"""Sample task files in new rooms or in AI2-THOR's floor plans.

The expert carries out each task once, or all tasks that the types allow are kept. Tasks left out
are counted by reason.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

from karma import registry
from karma.bench.engine.episode import run_episode
from karma.bench.methods.expert import ExpertMethod
from karma.errors import FileError
from karma.files import to_json, write_atomic
from karma.goals.files import load_tasks
from karma.plugins.rooms.generate import build_scene
from karma.plugins.rules.language.lexemes import unseen_lexemes
from karma.plugins.training.drawing.drawn_tasks import DrawnRequest, Kind, draw_task
from karma.plugins.training.drawing.memories import room_of
from karma.plugins.training.drawing.phrases import Book
from karma.plugins.training.possible import Possible
from karma.plugins.training.sources import DRAWN_ROOMS
from karma.seeds import stream
from karma.types.roles import World
from karma.world.core.scene import Scene

ORDER = ("kitchen", "living", "kitchen", "bedroom", "kitchen", "bathroom")
NO_REQUEST = "the room offers no such request"
NOT_ALLOWED = "AI2-THOR's table lets nothing of the kind in there"
NO_LEXEME = "none of its words is held out"
NOT_DONE = "the expert did not do it"


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawing:
    """Counts of sampled tasks."""

    tasks: int
    rooms: int
    left_out: Mapping[str, int]  # reason -> how many were drawn and not kept
    lexemes: Mapping[int, int]  # held-out lexemes in a task -> how many tasks have so many

    @property
    def tried(self) -> int:
        """How many were drawn, those included that were not kept."""
        return self.tasks + sum(self.left_out.values())


def draw_tasks(
    folder: Path,
    book: Book,
    *,
    scenes: Sequence[Scene],
    each: int,
    seed: int,
    filtered: bool,
    unseen: bool = False,
) -> Drawing:
    """Sample tasks of every kind; writes tasks.jsonl and scenes/ into a folder.

    `filtered`: keep tasks that the expert carries out, else all that are possible; `unseen`: keep
    tasks with a held-out lexeme.
    """
    world = registry.load("worlds", "embedded")()
    known = [room_of(scene, scene.name, keep=1.0) for scene in scenes]
    possible = [Possible(scene) for scene in scenes]
    paths = [folder / "scenes" / f"{scene.name}.json" for scene in scenes]
    for path, scene in zip(paths, scenes, strict=True):
        write_atomic(path, to_json(scene))
    lines: list[dict[str, Any]] = []
    left_out: Counter[str] = Counter()
    lexemes: Counter[int] = Counter()
    tried = 0
    for kind in get_args(Kind):
        found = 0
        while found < each:
            rng = stream(seed, "tasks", kind, str(tried))
            at = tried % len(scenes)
            tried += 1
            steps = draw_task(rng, known[at], book, kind)
            line = _task_line(f"{kind}-{found + 1:03}", kind, paths[at], steps or ())
            judge = world if filtered else possible[at]
            said = sum(unseen_lexemes().number_in(step.text) for step in steps or ())
            reason = NO_LEXEME if unseen and steps and not said else NO_REQUEST
            if steps and (said or not unseen):
                reason = _reason(line, folder, judge)
            if reason:
                left_out[reason] += 1
                continue
            lines.append(line)
            lexemes[said] += 1
            found += 1
    write_atomic(folder / "tasks.jsonl", b"".join(to_json(line) + b"\n" for line in lines))
    return Drawing(tasks=len(lines), rooms=len(scenes), left_out=left_out, lexemes=lexemes)


def fresh_rooms(count: int, seed: int) -> Iterator[Scene]:
    """Yield rooms of seeds of their own, half of them kitchens."""
    for number in range(count):
        yield build_scene(ORDER[number % len(ORDER)], 5000 + number, seed + DRAWN_ROOMS)


def _task_line(name: str, kind: str, scene: Path, steps: Sequence[DrawnRequest]) -> dict[str, Any]:
    subtasks = [
        {
            "instruction": f"{step.text[0].upper()}{step.text[1:]}.",
            "goals": [str(goal).removesuffix(": 1") for goal in step.goals],
        }
        for step in steps
    ]
    return {"id": name, "kind": kind, "scene": str(scene), "subtasks": subtasks}


def _reason(line: dict[str, Any], folder: Path, judge: World | Possible) -> str:
    """Return why a task is left out, or "" if it is kept.

    The judge is a world for the expert, or a check of what is possible.
    """
    path = folder / "one.jsonl"
    write_atomic(path, to_json(line))
    try:
        (task,) = load_tasks(path)
    except FileError:
        return NOT_ALLOWED
    finally:
        path.unlink()
    if isinstance(judge, Possible):
        return judge.refusal(goal for sub in task.subtasks for goal in sub.goals)
    record = run_episode(ExpertMethod(), judge, task, row="expert", seed=0, folder=folder)
    return NOT_DONE if record.error or any(sub.unmet for sub in record.subtasks) else ""
