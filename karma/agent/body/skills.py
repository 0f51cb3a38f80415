"""The 13 skills of KARMA's Listing 2 and two of ours, carried out with AI2-THOR's actions.

A skill acts on what the agent believes (its memory, and what it has seen since it began); when a
belief proves wrong it says so. A refusal is a value whose reason a planner can act on. `walk` moves
the body, `sightings` keeps the log and knows what a name means, `reach` brings an object within
reach and acts on it, `search` searches for objects, `handling` has the skills of the hand.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from functools import partial
from types import MappingProxyType

from karma.agent.body.handling import Handling
from karma.agent.body.reach import Reach, SkillLimits
from karma.agent.body.refusals import RefusedError
from karma.agent.body.search import Search
from karma.agent.body.walk import OutOfActionsError
from karma.agent.planning.program import OUR_SKILLS, SKILLS, SWITCH_AFTER
from karma.agent.seeing.eyes import Eyes, MetadataEyes
from karma.types.events import SkillResult
from karma.types.memory import Area, Experience
from karma.types.observation import SeenObject
from karma.types.planning import SkillCall
from karma.types.roles import Knowledge, World

_SHUT_IN = "it is in a closed container; open that first"
_GO_ON = "not all of this room was searched: Explore(robot, '{}') goes on where it stopped"
_TRY_AGAIN = "the same line may be tried again from here"
_ARITY = {s.name: (len(s.arguments) - s.optional, s.arguments) for s in (*SKILLS, *OUR_SKILLS)}


class Skills:
    """Runs skill calls in a world and keeps the log that the agent's memory is fed from.

    Without `eyes` the agent sees by the simulator's metadata. An object that was seen `before` is
    known by its id only.
    """

    def __init__(
        self,
        world: World,
        knowledge: Knowledge,
        *,
        limits: SkillLimits | None = None,
        eyes: Eyes | None = None,
        before: Mapping[str, SeenObject] = MappingProxyType({}),
    ) -> None:
        self.actions = 0  # world actions so far
        self.explorations = 0  # area nodes visited and containers opened so far
        self._taken: list[tuple[str, int]] = []  # id and turn of what the program picked up
        limits, eyes = limits or SkillLimits(), eyes or MetadataEyes()
        self.reach = Reach(world, knowledge, limits, eyes, before)

    @property
    def experience(self) -> Experience:
        """What was seen and done so far."""
        return self.reach.log.experience()

    def begin_program(self) -> None:
        """Forget which objects an earlier program picked up."""
        self._taken = []

    def look(self) -> None:
        """Note what is in view now; every skill does so too."""
        self.reach.look()

    def look_around(self) -> None:
        """Turn round once, looking down at tables and straight ahead."""
        self.reach.walker.start()
        Search(self.reach).look_around()
        self.actions += self.reach.walker.actions

    def look_for(
        self, name: str, place: Area | SeenObject, *, max_actions: int | None = None
    ) -> SkillResult:
        """Look for an object around an area, or in a container, which is closed again afterwards.

        Ok if it is in view then. Without a name it only looks; `max_actions` None: the limits' own.
        """
        search = Search(self.reach, name)
        at = place.name if isinstance(place, Area) else place.object_id

        def look() -> str:
            if isinstance(place, Area):
                found = search.look_from(place.position_m)
            else:
                found = search.look_into(place)
            if name and found is None:
                raise RefusedError(f"no {name} there")
            self.reach.used = []  # not the places searched on the way
            if found is not None:
                self.reach.use(found)
            return ""

        explore = SkillCall(skill="Explore", objects=(name,), positions=(at,))
        call = explore if name else SkillCall.of("GoToObject", at)
        return self._counted(call, look, max_actions)

    def look_over(self, place: SeenObject) -> SkillResult:
        """Look at the whole of a surface, or of a container, which is open afterwards."""
        call = SkillCall.of("GoToObject", place.object_id)
        return self._counted(call, partial(Search(self.reach).look_over, place), None)

    def run(
        self, call: SkillCall, *, max_actions: int | None = None, aside: Collection[str] = ()
    ) -> SkillResult:
        """Carry out one skill call; no name of a type means an id in `aside`.

        A program that calls two objects by one name means different objects; if no other is found,
        the first is used again.

        Raises:
            ValueError: no such skill, or a wrong number of objects.
        """
        least, kinds = _ARITY.get(call.skill, (0, ()))
        most = kinds.count("object")
        if not kinds:
            raise ValueError(f"no skill named {call.skill!r}")
        if not min(least, most) <= len(call.objects) <= most:
            raise ValueError(f"{call.skill} takes {most} object(s): {call}")
        if call.positions and "positions" not in kinds:
            raise ValueError(f"{call.skill} takes no positions: {call}")
        log, do = self.reach.log, partial(self._carry_out, call)
        earlier = frozenset(one for one, turn in self._taken if turn < call.turn)
        log.aside = earlier.union(aside)
        result = self._counted(call, do, max_actions)
        if earlier and not result.ok:
            log.aside = frozenset(aside)
            first, result = result, self._counted(call, do, max_actions)
            both = first.explorations + result.explorations
            result = replace(result, actions=first.actions + result.actions, explorations=both)
        log.aside = frozenset()
        if result.ok and call.skill == "PickupObject":
            self._taken += [(one, call.turn) for one in result.object_ids[:1]]
        return result

    def _carry_out(self, call: SkillCall) -> str:
        """Do one skill; returns a remark, raises RefusedError."""
        hand, name = Handling(self.reach), call.objects[-1]
        match call.skill:
            case "GoToObject":
                return self._go_to(name)
            case "PickupObject":
                return hand.pick_up(name)
            case "PutObject":
                thing = call.objects[0] if call.objects[1:] else None
                return hand.put(thing, name, exact=call.exact)
            case "PutNear":
                return hand.put_near(call.objects[0], name)
            case "ThrowObject":
                return hand.throw(name)
            case "EmptyObject":
                return hand.empty(name)
            case "Explore":
                Search(self.reach, name, call.positions).explore()
                return ""
            case skill if skill in SWITCH_AFTER:
                return hand.toggle(skill, name)
            case _:
                return hand.act(call.skill, name)

    def _go_to(self, name: str) -> str:
        reach = self.reach
        for area in reach.knowledge.areas():
            if area.name == name:
                reach.walker.walk_near(area.position_m)
                reach.look()
                return ""
        return "" if reach.approach(reach.resolve(name), closed_will_do=True) else _SHUT_IN

    def _counted(
        self, call: SkillCall, do: Callable[[], str], max_actions: int | None
    ) -> SkillResult:
        """Do something and count its actions; a refusal becomes a result."""
        reach = self.reach
        most = reach.limits.max_actions
        reach.walker.max_actions = most if max_actions is None else min(max_actions, most)
        try:
            reach.start()
            ok, reason, detail = True, do(), ""
        except RefusedError as refusal:
            ok, reason, detail = False, str(refusal), refusal.detail
        except OutOfActionsError:
            reach.look()
            name = call.objects[-1]
            ok, reason = False, f"gave up after {reach.walker.actions} actions on {name}"
            detail = f"{reason}; {_GO_ON.format(name) if call.skill == 'Explore' else _TRY_AGAIN}"
        self.actions += reach.walker.actions
        self.explorations += reach.explorations
        return SkillResult(
            call=call,
            ok=ok,
            reason=reason,
            detail=detail,
            actions=reach.walker.actions,
            explorations=reach.explorations,
            object_ids=tuple(dict.fromkeys(reach.used)),
        )
