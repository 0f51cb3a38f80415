"""Find the object that an action means: by its id, or by a place in the picture."""

import inspect
from collections.abc import Callable
from functools import wraps
from math import radians, tan
from typing import Any

import numpy as np

from karma.household.types import Capability
from karma.world.actions.moving import lacks, unknown
from karma.world.core.boxes import Floats
from karma.world.core.rays import cut
from karma.world.core.scene import SceneObject
from karma.world.core.state import Performed, Refusal, Result, WorldState, refuse
from karma.world.core.thing import is_inert
from karma.world.core.view import camera, camera_axes

Handler = Callable[..., Result]


def on_object(
    action: str, capability: Capability | None = None, *, done: str | None = None
) -> Callable[[Handler], Handler]:
    """Return the decorator of an action that takes the state, an object and arguments of its own.

    The arguments that say which object are added to those.

    Args:
        action: its name, for refusals.
        capability: what the object must be able to do or suffer.
        done: field of the object; where it is true already, the action silently succeeds.
    """

    def decorate(act: Handler) -> Handler:
        @wraps(act, assigned=("__name__", "__doc__"))
        def handler(
            state: WorldState,
            *,
            objectId: str | None = None,
            x: float | None = None,
            y: float | None = None,
            forceAction: bool = False,
            **own: Any,
        ) -> Result:
            if done and getattr(state.objects.get(objectId or ""), done, False):
                return Performed(state)
            thing = target(state, action, objectId, x, y, forceAction)
            if isinstance(thing, Refusal):
                return thing
            if capability is not None and capability not in thing.capabilities:
                return Refusal(f"{thing.name} does not have the property {capability}!")
            return act(state, thing, **own)

        aims = list(inspect.signature(handler, follow_wrapped=False).parameters.values())[:-1]
        owns = list(inspect.signature(act).parameters.values())[2:]
        handler.__signature__ = inspect.Signature([*aims, *owns])  # type: ignore[attr-defined]
        return handler

    return decorate


def target(
    state: WorldState,
    action: str,
    objectId: str | None,
    x: float | None,
    y: float | None,
    force: bool,
) -> SceneObject | Refusal:
    """Return the object that an action means, or why it cannot be acted on.

    Checked in AI2-THOR's order: it exists, is in view, and is not only seen through glass.
    """
    if objectId is None and (x is None or y is None):
        return lacks(action, "objectId")
    if objectId is None:
        return _aimed(state, x or 0.0, y or 0.0)
    if objectId not in state.objects:
        return unknown(objectId)
    thing = state.objects[objectId]
    if is_inert(thing):
        return refuse("NullReferenceException", "Target object is not there any more.")
    if force:
        return thing
    if objectId not in state.sight.visible:
        message = "Target object not found within the specified visibility."
        return refuse("NullReferenceException", message)
    if objectId not in state.sight.interactable:
        return Refusal(f"{thing.name} is visible but not interactable.", "ObjectNotInteractable")
    return thing


def _aimed(state: WorldState, x: float, y: float) -> SceneObject | Refusal:
    if refusal := outside(x, y):
        return refusal
    found = shown_at(state, x, y)
    if found is None:
        return refuse("NullReferenceException", "No object at the given screen coordinates.")
    return state.objects[found]


def outside(x: float, y: float) -> Refusal | None:
    """Return why there is no such place in the picture, if so."""
    if 0 <= x <= 1 and 0 <= y <= 1:
        return None
    message = f"x and y must be in [0:1] not (x={x:g}, y={y:g})."
    return refuse("ArgumentOutOfRangeException", message)


def shown_at(state: WorldState, x: float, y: float) -> str | None:
    """Return the id of what a place in the picture shows and the hand can reach, the nearest."""
    boxes, found = state.objects.boxes, []
    eye, ray = ray_through(state, x, y)
    for object_id in state.sight.interactable - state.in_hand:
        row = state.objects.rows[object_id]
        if cut(eye, (eye + ray * 20.0)[None], boxes.low[row], boxes.high[row])[0]:
            size = float(np.prod(boxes.half[row]))
            found.append((float(np.linalg.norm(boxes.center[row] - eye)), size, object_id))
    return min(found)[2] if found else None


def ray_through(state: WorldState, x: float, y: float) -> tuple[Floats, Floats]:
    """Return the camera's place and the way to a place in the picture, 1 long straight ahead."""
    settings, pose = state.settings, state.pose
    scale = tan(radians(settings.fov_deg) / 2)
    right, up, forward = camera_axes(pose.yaw_deg, pose.horizon_deg)
    ray = forward + right * (2 * x - 1) * scale * settings.aspect + up * (1 - 2 * y) * scale
    return np.array(camera(pose)), ray
