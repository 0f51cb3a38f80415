"""The people of a home: what they do there while the agent is away."""

from collections.abc import Iterator
from typing import Any

from karma.assistant.session_log import CLOCK_START_S
from karma.plugins.homes.residents import Household
from karma.plugins.homes.types import HomeCard
from karma.types.roles import World
from karma.world.core.scene import load
from karma.world.sim import EmbeddedWorld

DISTURBANCE = 0.25  # share of the movable things that are moved at least once a day

Deed = tuple[str, dict[str, Any]]  # an action of AI2-THOR and its arguments


def live(
    world: World, truth: EmbeddedWorld, home: HomeCard, span_s: tuple[float, float]
) -> Iterator[Deed]:
    """Let people live in a home between two times of its clock; yield what is done.

    They are drawn in a copy of the home, and done by the world's own actions, so that a log of
    these makes the home again. While the agent holds a thing they leave all as it is. `truth` is
    the world behind `world`, in which it is done.
    """
    if truth.state.held is not None:
        return
    begin_s, end_s = (CLOCK_START_S + time_s for time_s in span_s)
    household = Household(
        load(home.scene), seed=home.seed, people=home.people, disturbance=DISTURBANCE
    )
    household.skip(begin_s)  # what was done before stands in the log
    household.world.back_to(truth.last_event)
    came_from = ""
    for deed in household.until(end_s):
        target = deed.place_id if deed.action == "PutObject" else deed.object_id
        ways: list[Deed] = [(deed.action, {"objectId": target, "forceAction": True})]
        if deed.action == "PickupObject":
            came_from = deed.place_id or ""
        elif deed.action == "PutObject" and truth.state.held is None:
            continue  # it could not be taken
        elif deed.action == "PutObject":  # what finds no room there goes back, or to the floor
            ways += [
                ("PutObject", {"objectId": came_from, "forceAction": True}),
                ("DropHandObject", {"forceAction": True}),
            ]
        for action, arguments in ways:
            if world.step(action, **arguments):
                yield action, arguments
                break
