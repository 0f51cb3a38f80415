"""What somebody says to an agent, and a judge that looks at the world's true state."""

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from karma.assistant.agent import Agent, asking
from karma.assistant.replies import AgentReply
from karma.errors import KarmaError
from karma.goals.goals import Goal, GoalTracker
from karma.loading.models import Models, load_resources
from karma.models.endpoint import Hosted
from karma.types.roles import Resources
from karma.types.tasks import SubTask
from support.asked import AskedRequest, states_of

MAPS = Path("runs/maps-asked")


def asking_resources(
    planner: str = Models().planner, profile: str = "", base_url: str = ""
) -> Resources:
    """Return models of an agent that asks back; with a `base_url` the planner is hosted there."""
    models = Models(planner=planner, profile=profile)
    if base_url:
        hosted = Hosted.of_planner(base_url, planner)
        models = Models(planner="openai", profile=profile, hosted=hosted, constraint="free")
    return load_resources(asking(models), maps=MAPS, seed=0, learn=False)


def tracking(world: Any, text: str, goals: Sequence[Goal]) -> GoalTracker:
    """Return a tracker of what is asked for, from this moment on."""
    tracker = GoalTracker()
    tracker.start(world.last_event)
    tracker.begin_subtask(SubTask(instruction=text, goals=tuple(goals)), world.last_event)
    return tracker


@contextmanager
def watched(world: Any, *trackers: GoalTracker) -> Iterator[Callable[[], bool]]:
    """Let trackers see every step; yields what tells whether anything has changed."""
    before, inner = states_of(world.last_event.metadata["objects"]), world.step

    def step(action: str, **arguments: object) -> object:
        event = inner(action, **arguments)
        for tracker in trackers:
            tracker.update(event)
        return event

    world.step = step
    try:
        yield lambda: states_of(world.last_event.metadata["objects"]) != before
    finally:
        world.step = inner


@dataclass(frozen=True, slots=True, kw_only=True)
class Told:
    """What came of a request, as it is said and as it is."""

    reply: AgentReply | None  # None: an error
    error: str
    unmet: tuple[str, ...]  # goals that do not hold, and what must not hold and does
    changed: bool
    objects: Sequence[Mapping[str, Any]]  # the world's, afterwards


def say(
    one: AskedRequest, resources: Resources, options: Mapping[str, Any], assistant: str = ""
) -> Told:
    """Say one request to an agent of its own, whose world the judge watches."""
    with tempfile.TemporaryDirectory() as folder:
        agent = Agent(
            one.scene, resources=resources, options=options, folder=Path(folder) / "t",
            maps=MAPS, assistant=assistant,
        )  # fmt: skip
        world, reply, error = agent._world, None, ""
        tracker = tracking(world, one.text, one.wanted)
        with watched(world, tracker) as changed:
            try:
                reply = agent.do(one.text)
            except KarmaError as failure:
                error = str(failure)
    event = world.last_event
    bad = [goal for goal in one.unwanted if not tracker.unmet((goal,), event)]
    unmet = (*map(str, tracker.unmet(one.wanted, event)), *(f"not {goal}" for goal in bad))
    return Told(
        reply=reply, error=error, unmet=unmet, changed=changed(), objects=event.metadata["objects"]
    )
