"""Task files drawn afresh: rooms that training never sees, each task done once by the expert."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

from karma import registry
from karma.bench.episode import run_episode
from karma.errors import FileError
from karma.files import to_json, write_atomic
from karma.methods.expert import ExpertMethod
from karma.seeds import stream
from karma.tasks.drawing import rooms
from karma.tasks.drawing.drawn_tasks import DrawnRequest, Kind, draw_task
from karma.tasks.drawing.memories import KnownRoom
from karma.tasks.drawing.phrases import Book
from karma.tasks.files import load_tasks
from karma.world.generation.generate import build_scene

ORDER = ("kitchen", "living", "kitchen", "bedroom", "kitchen", "bathroom")


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawing:
    """What came of drawing tasks."""

    tasks: int
    rooms: int
    tried: int  # drawn, those included that nobody could do


def draw_tasks(folder: Path, book: Book, *, each: int, seed: int, homes: int) -> Drawing:
    """Draw tasks of every kind; writes tasks.jsonl and scenes/ into a folder.

    Args:
        folder: takes them.
        book: phrases to ask with.
        each: tasks of each kind.
        seed: of rooms and tasks.
        homes: rooms, half of them kitchens.
    """
    world = registry.load("worlds", "embedded")()
    drawn = list(_draw_homes(folder, seed, homes))
    lines: list[dict[str, Any]] = []
    tried = 0
    for kind in get_args(Kind):
        found = 0
        while found < each:
            rng = stream(seed, "tasks", kind, str(tried))
            path, room = drawn[tried % len(drawn)]
            tried += 1
            steps = draw_task(rng, room, book, kind)
            line = _task_line(f"{kind}-{found + 1:03}", kind, path, steps) if steps else None
            if line is not None and _can_be_done(line, world, folder):
                lines.append(line)
                found += 1
    write_atomic(folder / "tasks.jsonl", b"".join(to_json(line) + b"\n" for line in lines))
    return Drawing(tasks=len(lines), rooms=len(drawn), tried=tried)


def _draw_homes(folder: Path, seed: int, homes: int) -> Iterator[tuple[Path, KnownRoom]]:
    """Yield rooms of seeds of their own, each written as a scene file."""
    for number in range(homes):
        kind = ORDER[number % len(ORDER)]
        scene = build_scene(kind, 5000 + number, seed + 79)
        path = folder / "scenes" / f"{scene.name}.json"
        write_atomic(path, to_json(scene))
        yield path, rooms.room_of(scene, scene.name, keep=1.0)


def _task_line(name: str, kind: str, scene: Path, steps: Sequence[DrawnRequest]) -> dict[str, Any]:
    subtasks = [
        {
            "instruction": f"{step.text[0].upper()}{step.text[1:]}.",
            "goals": [str(goal).removesuffix(": 1") for goal in step.goals],
        }
        for step in steps
    ]
    return {"id": name, "kind": kind, "scene": str(scene), "subtasks": subtasks}


def _can_be_done(line: dict[str, Any], world: Any, folder: Path) -> bool:
    """Return whether the expert, knowing everything, does it in the world."""
    path = folder / "one.jsonl"
    write_atomic(path, to_json(line))
    try:
        (task,) = load_tasks(path)
    except FileError:
        return False  # the type table lets nothing of the kind in there
    finally:
        path.unlink()
    record = run_episode(ExpertMethod(), world, task, row="expert", seed=0, folder=folder)
    return not record.error and not any(sub.unmet for sub in record.subtasks)
