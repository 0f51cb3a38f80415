"""What a player is; and those that no model is behind: the demonstrator's plan, and chance.

A player is asked for a plan again and again, as a planner is. The expert looks at the truth and at
the demonstration, and says one action at a time; how the benchmark's actions carry them out is what
its score measures.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from karma.household.ids import root_id, root_type
from karma.household.uses import FAUCET
from karma.plugins.alfred.eb_world.actions import Thing, Verb, by_id, hides
from karma.plugins.alfred.eb_world.environment import Environment
from karma.plugins.alfred.replay.trial import PlannerAction
from karma.seeds import stream
from karma.types.completion import Completion

KEPT = 20_000  # characters of an answer that a record keeps
_Said = tuple[Verb, str]  # verb, and the id or type that it is about


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchmarkAnswer:
    """One planner call."""

    text: str  # the first 20,000 characters
    characters: int  # of the whole
    prompt_tokens: int | None
    completion_tokens: int | None
    finish: str = ""
    cost: float | None = None


def kept(said: Completion) -> dict[str, Any]:
    """Return what is kept of an answer."""
    return {
        "text": said.text[:KEPT],
        "characters": len(said.text),
        "prompt_tokens": said.prompt_tokens,
        "completion_tokens": said.completion_tokens,
        "finish": said.finish,
        "cost": said.cost,
    }


class BenchmarkPlayer(Protocol):
    """Plays one episode."""

    @property
    def answers(self) -> Sequence[BenchmarkAnswer]:
        """What a language model said so far."""

    def plan(self, environment: Environment) -> Sequence[int | str] | None:
        """Return numbers of actions, or what is none; () gives up, None: the answer is unusable."""


class ChancePlayer:
    """Draws one action after the other, all of them equally often: the floor.

    `use` names the benchmark and the episode.
    """

    answers = ()

    def __init__(self, seed: int, *use: str) -> None:
        self._draws = stream(seed, *use)

    def plan(self, environment: Environment) -> Sequence[int]:
        """Return one action."""
        return (int(self._draws.integers(len(environment.actions))),)


class ExpertPlayer:
    """Says the demonstration's sub-goals in the benchmark's actions."""

    answers = ()

    def __init__(self) -> None:
        self._said: Iterator[int] | None = None

    def plan(self, environment: Environment) -> Sequence[int]:
        """Return the next action; gives up when the demonstration is over."""
        if self._said is None:
            self._said = _numbers(environment)
        found = next(self._said, None)
        return () if found is None else (found,)


def _numbers(environment: Environment) -> Iterator[int]:
    for verb, about in _Script(environment).lines():
        number = _number(environment, verb, about)
        if number is not None:
            yield number


def _number(environment: Environment, verb: Verb, about: str) -> int | None:
    """Return the action that says this: the object's own, else its sink's, else its type's."""
    named = {
        (one.verb, one.object_id): place
        for place, one in enumerate(environment.actions)
        if one.object_id
    }
    for object_id in (about, root_id(about)):
        if verb in ("find", "open", "close") and (verb, object_id) in named:
            return named[verb, object_id]
    for place, one in enumerate(environment.actions):
        if one.verb == verb and one.noun in ("", root_type(about)):
            return place
    return None


class _Script:
    """Turns sub-goals into what to say, as the episode goes on.

    "pick up the Mug" takes the nearest mug: where that is not the demonstrator's, the two are
    swapped from then on.
    """

    def __init__(self, environment: Environment) -> None:
        self._environment = environment
        self._swapped: dict[str, str] = {}  # demonstrator's id -> what is taken for it
        self._held = ""  # demonstrator's id

    def lines(self) -> Iterator[_Said]:
        for goal in self._environment.trial.plan.high_pddl:
            yield from self._sub_goal(goal.planner_action)
        yield "done", ""

    def _sub_goal(self, step: PlannerAction) -> Iterator[_Said]:
        thing = step.object_id or ""
        match step.action:
            case "PickupObject":
                self._held = thing
                yield from self._take(thing)
            case "PutObject":
                yield from self._put(step.receptacle_object_id or "")
            case "SliceObject":
                yield from self._reach(thing)
                yield "slice", thing
            case "ToggleObject":
                yield from (("find", thing), ("turn on", thing))
            case "CleanObject":
                yield from self._put(thing)
                yield from self._run_water()
                yield from self._take(self._held)
            case "HeatObject":
                yield from self._put(thing)
                yield from (("close", thing), ("turn on", thing), ("turn off", thing))
                yield "open", thing
                yield from self._take(self._held)
            case "CoolObject":
                yield from self._put(thing)
                yield from (("close", thing), ("open", thing))
                yield from self._take(self._held)

    def _known(self, one: str) -> Thing | None:
        return by_id(self._environment.things, one)

    def _parents(self, one: str) -> Sequence[str]:
        known = self._known(one)
        return () if known is None else known["parentReceptacles"] or ()

    def _done(self) -> bool:
        """Return whether the last action was."""
        return self._environment.steps[-1].ok

    def _reach(self, thing: str) -> Iterator[_Said]:
        """Open what an object is shut in, and go to it."""
        thing = self._swapped.get(thing, thing)
        for place in self._parents(thing):
            if self._is_shut(place):
                yield from self._open(place, thing)
        yield "find", thing

    def _open(self, place: str, thing: str) -> Iterator[_Said]:
        """Open what an object is shut in; a nameless one of several from where the object is."""
        for near in (place,) if self._environment.protocol.numbered else (thing, place):
            if self._is_shut(place):
                yield from (("find", near), ("open", place))

    def _take(self, thing: str) -> Iterator[_Said]:
        yield from self._reach(thing)
        wanted = self._swapped.get(thing, thing)
        yield "pick up", wanted
        for place in () if self._done() else self._parents(wanted):  # perhaps seen from there
            yield from (("find", place), ("pick up", wanted))
            if self._done():
                break
        held = self._environment.held
        if held and root_id(held) != root_id(wanted):
            self._swapped |= {thing: held, held: wanted}

    def _put(self, place: str) -> Iterator[_Said]:
        place = self._swapped.get(place, place)
        yield from self._lay(place)
        if not self._done() and self._environment.held is None:  # it fell
            yield from self._take(self._held)
            yield from self._lay(place)

    def _lay(self, place: str) -> Iterator[_Said]:
        yield from self._reach(place)
        if self._is_shut(place):
            yield "open", place
        yield "put", self._held

    def _is_shut(self, place: str) -> bool:
        known = self._known(place)
        return known is not None and not known["isOpen"] and hides(known["objectType"])

    def _run_water(self) -> Iterator[_Said]:
        yield "turn on", FAUCET
        if not self._done():
            yield from (("find", FAUCET), ("turn on", FAUCET))
        yield "turn off", FAUCET
