"""Trajectories of tool mode: conversations of an expert in rooms of the embedded world.

Each request is a chat in the words of the tool loop: system message, what is seen and remembered,
answers with calls, their results, an end. A chat is kept if the world confirms it: all goals hold,
or nothing has changed and the end is the right one.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from karma import registry
from karma.agent.karma import KarmaMethod
from karma.agent.loop import KarmaAgent
from karma.agent.planning.planner import Planner
from karma.agent.planning.prompt import TOOLS
from karma.agent.seeing.perceive import truth_of
from karma.agent.settings import KarmaSettings
from karma.bench.engine.episode import drawn
from karma.files import to_json, write_atomic
from karma.goals.goals import GoalTracker, WatchedWorld
from karma.models.scripted import MetadataVision
from karma.plugins.training.drawing.memories import pick, room_of, weighted
from karma.plugins.training.packs import Data
from karma.plugins.training.tool_requests import SHARES, ToolRequests, slipped
from karma.plugins.training.tool_teacher import Lesson, ToolTeacher
from karma.seeds import stream
from karma.types.events import Outcome
from karma.types.roles import Recall, World
from karma.types.space import SceneRef
from karma.types.tasks import SubTask, Task
from karma.world.core.scene import Scene

SOURCES = 3  # of requests in a conversation, at most; a task has several requests
SLIPS = 0.15  # share of conversations with mistakes in first answers
NO_MAP = 0.1  # share of conversations without long-term memory
LONGEST = 6  # answers in a chat


@dataclass(frozen=True, kw_only=True)
class ToolMaterial:
    """Input of trajectories: phrases and sentences, rooms, a recall."""

    data: Data
    scenes: Sequence[Scene]
    recall: Recall


def draw_chats(
    material: ToolMaterial, folder: Path, seed: int, name: str
) -> Iterator[dict[str, Any]]:
    """Yield the chats of a conversation; equal seeds and names give equal chats.

    `folder` takes the room's file.
    """
    rng = stream(seed, "trajectories", name)
    scene = pick(rng, material.scenes)
    path = folder / f"{scene.name}.json"
    write_atomic(path, to_json(scene))
    task = Task(id=name, kind="simple", scene=SceneRef.of(str(path)), subtasks=())
    tracker, world = GoalTracker(), registry.load("worlds", "embedded")()
    drawn(world, task, seed, 0)  # half of the movable objects lie elsewhere
    teacher = ToolTeacher({}, slip=partial(slipped, rng) if rng.random() < SLIPS else list)
    settings = KarmaSettings(long_term=rng.random() > NO_MAP)
    method = KarmaMethod(Planner(teacher, TOOLS), material.recall, MetadataVision(), settings)
    agent = method.begin(WatchedWorld(world, tracker), task.scene, seed=0, folder=folder)
    tracker.start(world.last_event)
    room = room_of(scene, scene.name, keep=1.0)
    for _ in range(1 + int(rng.integers(SOURCES))):
        objects = truth_of(world.last_event).objects
        requests = ToolRequests(rng=rng, room=room, data=material.data, objects=objects)
        for lesson in requests.draw(weighted(rng, SHARES)):
            chat = _chat(teacher, agent, tracker, world, lesson)
            if chat is None:
                return  # what follows may be about what was not done
            yield chat


def _chat(
    teacher: ToolTeacher, agent: KarmaAgent, tracker: GoalTracker, world: World, lesson: Lesson
) -> dict[str, Any] | None:
    """Let the teacher carry out a request; return its chat, or None if the world denies it."""
    if lesson.goals and not tracker.unmet(lesson.goals, world.last_event):
        return None
    subtask, before = SubTask(instruction=lesson.text, goals=lesson.goals), _states(world)
    tracker.begin_subtask(subtask, world.last_event)
    teacher.lessons = {lesson.text.strip(): lesson}
    teacher.answers.clear()
    *_, outcome = agent.do(subtask)
    assert isinstance(outcome, Outcome)
    is_right = outcome.end is not None and outcome.end.kind == lesson.end
    unmet = tracker.unmet(lesson.goals, world.last_event)
    if not is_right or unmet or not (lesson.goals or before == _states(world)):
        return None
    messages = [{"role": "system", "content": teacher.answers[0].prompt.stable}]
    for answer in teacher.answers:
        said: dict[str, Any] = {"role": "assistant", "content": answer.text}
        messages += [{"role": "user", "content": answer.prompt.changing},
                     said | ({"weight": 0} if answer.is_slip else {})]  # fmt: skip
    return {"kind": lesson.kind, "messages": messages} if len(messages) <= 2 * LONGEST else None


def _states(world: World) -> dict[str, Any]:
    objects = truth_of(world.last_event).objects
    return {one.object_id: (one.states, one.parent_ids) for one in objects}
