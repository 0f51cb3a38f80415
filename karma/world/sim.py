"""Simulate AI2-THOR 5.0.0's vocabulary over a scene file, headless and deterministic.

Covered: the actions in `ACTIONS`, all event and object fields, containment, visibility, heat,
cold, water, coffee, slicing, breaking, pictures. Not covered: mesh physics;
docs/world/simplifications.md lists every simplification.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from karma.errors import KarmaError
from karma.types.space import Vec3
from karma.world.actions.setup import unfit
from karma.world.actions.table import ACTIONS
from karma.world.core.effects import settle
from karma.world.core.placement import land, lying_below, parents_in, resting
from karma.world.core.scene import Scene, SceneObject, load
from karma.world.core.state import Images, Performed, Refusal, Result, Settings, WorldState, begin
from karma.world.core.thing import GRAVITY_MS2, bottom, difference, moved, top
from karma.world.event import WorldEvent

MISUSE = frozenset({"InvalidAction", "MissingArguments", "AmbiguousAction", "InvalidArgument"})
RENDER_FLAGS: Mapping[str, str] = {  # AI2-THOR's flag -> field of state.Images
    "renderImage": "rgb",
    "renderDepthImage": "depth",
    "renderInstanceSegmentation": "instances",
    "renderSemanticSegmentation": "classes",
    "renderNormalsImage": "normals",
    "renderObjectImage": "instances",  # the names of older versions
    "renderClassImage": "classes",
}
_PLAYER_ARGUMENTS = frozenset({"agentId", "sequenceId", "visibilityDistance"})
_PAST = (0.0, -0.05, 0.0)  # what it has slipped through does not catch it


class EmbeddedWorld:
    """A household of boxes; implements `karma.types.roles.World`.

    A scene, by name or path or read already, is loaded at once when given. AI2-THOR's names and
    units; gridSize None = the scene's own; flags as `renderDepthImage=True` say which pictures are
    drawn when asked for.

    Raises:
        TypeError: an unknown flag.
        ValueError: what Initialize or ChangeResolution would refuse.
    """

    def __init__(
        self,
        scene: str | Path | Scene | None = None,
        *,
        gridSize: float | None = None,
        visibilityDistance: float = 1.5,
        fieldOfView: float = 90.0,
        width: int = 300,
        height: int = 300,
        rotateStepDegrees: float = 90.0,
        snapToGrid: bool = True,
        **render: bool,
    ) -> None:
        if unknown := sorted(render.keys() - RENDER_FLAGS.keys()):
            raise TypeError(f"EmbeddedWorld has no argument {unknown[0]!r}")
        self._grid_m = gridSize
        self._settings = Settings(
            visibility_m=visibilityDistance,
            fov_deg=fieldOfView,
            width=width,
            height=height,
            rotate_deg=rotateStepDegrees,
            snap=snapToGrid,
            images=_images(Images(), render),
        )
        wrong = unfit(replace(self._settings, grid_m=gridSize or self._settings.grid_m))
        if wrong is not None:
            raise ValueError(wrong.message)
        self._event: WorldEvent | None = None
        if scene is not None:
            self.reset(scene)

    @property
    def last_event(self) -> WorldEvent:
        """The event of the last `reset` or `step`.

        Raises:
            KarmaError: no scene is loaded.
        """
        if self._event is None:
            raise KarmaError("no scene is loaded\n  To fix: world.reset('<scene name or path>')")
        return self._event

    @property
    def state(self) -> WorldState:
        """The present moment; the world's truth, not for agents."""
        return self.last_event.state

    def reset(self, scene: str | Path | Scene) -> WorldEvent:
        """Load a scene by name or path, or one already read.

        Raises:
            FileError: there is no such scene, or it is damaged.
        """
        loaded = scene if isinstance(scene, Scene) else load(scene)
        settings = replace(self._settings, grid_m=self._grid_m or loaded.grid_m)
        planes = {"cameraNearPlane": 0.01, "cameraFarPlane": 20.0}
        state = settle(begin(loaded, settings))
        self._event = WorldEvent(state=state, action="Initialize", value=planes, first=True)
        return self._event

    def back_to(self, event: WorldEvent) -> None:
        """Make an earlier event of this world its last one: what came after it never happened."""
        self._event = event

    def step(self, action: str | Mapping[str, Any], **arguments: Any) -> WorldEvent:
        """Do one action, by name or as a mapping with it under "action" and its arguments.

        `raise_for_failure=True` turns a refusal into RuntimeError, as in AI2-THOR's Controller.

        Raises:
            ValueError: the action is unknown, or its arguments do not fit; nothing changes.
        """
        if not isinstance(action, str):
            given: object = action
            if not isinstance(given, Mapping):
                kind = type(given).__name__
                raise ValueError(f"an action is a name, or a mapping with one, not {kind}")
            arguments = {**given, **arguments}
            action = str(arguments.pop("action", None))
        loud = bool(arguments.pop("raise_for_failure", False))
        event = _act(self.last_event, action, arguments)
        self._event = event
        if event.code in MISUSE:
            raise ValueError(event.message)
        if loud and not event.success:
            raise RuntimeError(event.message)
        return event

    def stop(self) -> None:
        """Forget the scene."""
        self._event = None


def _images(usual: Images, given: Mapping[str, Any]) -> Images:
    """Return the usual pictures with AI2-THOR's flags applied."""
    flags = {RENDER_FLAGS[k]: bool(v) for k, v in given.items() if v is not None}
    return replace(usual, **flags) if flags else usual


def _act(last: WorldEvent, name: str, arguments: Mapping[str, Any]) -> WorldEvent:
    """Return the event of one action."""
    action = ACTIONS.get(name)
    taken: Mapping[str, Any] = {} if action is None else action.kinds  # Initialize takes flags
    aside = _PLAYER_ARGUMENTS - taken.keys()
    given = {k: v for k, v in arguments.items() if v is not None and k not in aside}
    flags = {k: given.pop(k) for k in RENDER_FLAGS if k in given and k not in taken}
    agent = arguments.get("agentId")
    if action is None:
        result: Result = Refusal(f"Invalid action: {name}", "InvalidAction")
    elif agent is not None and (isinstance(agent, bool) or agent != 0):
        result = Refusal(f"agentId {agent!r}: this world has one agent, 0", "InvalidArgument")
    else:
        ready = action.ready(given)
        result = ready if isinstance(ready, Refusal) else action.handler(last.state, **ready)
    state = last.state
    if isinstance(result, Performed) and not (result.state is state and not result.seconds):
        state = replace(result.state, time_s=result.state.time_s + result.seconds)
        state = settle(come_down(state) if state.falling else state)
    images = _images(state.settings.images, flags)
    before = last if state is last.state else None
    event = partial(WorldEvent, state=state, action=name, images=images, before=before)
    if isinstance(result, Performed):
        return event(value=result.value, first=name == "Initialize")
    return event(success=False, message=result.message, code=result.code)


def come_down(state: WorldState) -> WorldState:
    """Return the state with what has fallen for long enough lying where it comes to rest."""
    changes, still = dict[str, SceneObject](), set[str]()
    for object_id in sorted(state.falling):
        thing = state.objects.get(object_id)
        if thing is None or thing.parents or object_id in state.in_hand:  # taken away, or caught
            continue
        middle, holder = _rest(state, thing)
        if GRAVITY_MS2 / 2 * state.time_s**2 < thing.center[1] - middle[1]:
            still.add(object_id)
            continue
        there = moved(thing, difference(middle, thing.center))
        parents = () if holder is None else parents_in(state.objects, there, holder)
        changes[object_id] = msgspec.structs.replace(there, parents=parents)
    objects = state.objects.changed(changes) if changes else state.objects
    return replace(state, objects=objects, falling=frozenset(still))


def _rest(state: WorldState, thing: SceneObject) -> tuple[Vec3, str | None]:
    """Return where a thing's middle comes to rest, and in or on what."""
    x, y, z = thing.center
    round_it = [
        one
        for one in lying_below(state, x, z)
        if "openable" in one.capabilities and bottom(one) < bottom(thing) and y < top(one)
    ]
    if not round_it:
        return land(state, moved(thing, _PAST), x, z)
    holder = max(round_it, key=bottom)
    return (x, resting(thing, bottom(holder)), z), holder.id
