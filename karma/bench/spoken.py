"""Requests as people say them, said to an agent in its room: what it did, or that it refused.

The agent knows the room from a tour, and has handled nothing, or what the request says. A sentence
of several requests is cut into clauses by whoever is measured, and each clause is an instruction.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from karma.agent.perceive import place_of, truth_of
from karma.contracts import MemoryUnit, Outcome, Plan, SceneRef, SkillResult, SubTask, World
from karma.methods.karma import KarmaEpisode, KarmaMethod
from karma.tasks.goals import GoalTracker, WatchedWorld
from karma.tasks.requests import SaidRequest, SeveralRequests, WantedClause, split_right

Splitter = Callable[[SeveralRequests], Sequence[str]]
_IN_ORDER = ("before", "after")  # kinds of sentences that say what comes first


class SaidRecord(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What was said, and what came of it."""

    id: str
    kind: str
    text: str
    splitter: str = ""  # of a sentence of several requests
    clauses: tuple[str, ...] = ()  # as they were said
    programs: tuple[tuple[str, ...], ...] = ()  # one for each answer of the planner
    refused: str = ""  # why, in the planner's word
    split: bool | None = None  # the clauses are the requests
    reached: bool | None = None  # all that was asked for was done, in its order


@dataclass(frozen=True, kw_only=True)
class Talk:
    """An agent that is talked to, and where.

    Args:
        method: the agent.
        world: takes any room.
        folder: takes pictures that were looked at.
    """

    method: KarmaMethod
    world: World
    folder: Path

    def one(self, said: SaidRequest) -> SaidRecord:
        """Say one request; of one that is to be refused the first answer counts."""
        tracker = GoalTracker()
        episode = self._begin(said.scene, tracker, said.handled)
        tracker.begin_subtask(
            SubTask(instruction=said.text, goals=said.wanted), self.world.last_event
        )
        heard = _Heard()
        for plan in _plans(episode.do(SubTask(instruction=said.text, whole=said.text))):
            heard.hear(plan)
            if not said.goals and (plan.calls or plan.refused):
                break
        reached = not tracker.unmet(said.wanted, self.world.last_event) if said.goals else None
        return SaidRecord(
            id=said.id,
            kind=said.kind,
            text=said.text,
            clauses=(said.text,),
            programs=tuple(heard.programs),
            refused=heard.refused,
            reached=reached,
        )

    def several(self, said: SeveralRequests, name: str, splitter: Splitter) -> SaidRecord:
        """Say a sentence clause by clause."""
        clauses = tuple(splitter(said))
        tracker = GoalTracker()
        episode = self._begin(said.scene, tracker, ())
        watch = _Watch(tracker, said, self.world)
        heard = _Heard()
        for clause in clauses:
            for moment in episode.do(SubTask(instruction=clause, whole=said.text)):
                if isinstance(moment, Plan):
                    heard.hear(moment)
                watch.look()
        return SaidRecord(
            id=said.id,
            kind=said.kind,
            text=said.text,
            splitter=name,
            clauses=clauses,
            programs=tuple(heard.programs),
            refused=heard.refused,
            split=split_right(clauses, said.requests),
            reached=watch.reached,
        )

    def _begin(self, room: str, tracker: GoalTracker, handled: Iterable[str]) -> KarmaEpisode:
        """Enter a room that the agent has toured, with what it handled before in memory."""
        self.world.reset(room)
        watched = WatchedWorld(self.world, tracker)
        episode = self.method.begin(watched, SceneRef.of(room), seed=0, folder=self.folder)
        tracker.start(self.world.last_event)
        for unit in _handled(self.world, SceneRef.of(room).name, handled):
            episode.short_term.remember(unit)
        return episode


class _Heard:
    """What the planner answered, clause by clause."""

    def __init__(self) -> None:
        self.programs: list[tuple[str, ...]] = []
        self.refused = ""  # the first refusal

    def hear(self, plan: Plan) -> None:
        """Take in one answer."""
        self.programs.append(tuple(map(str, plan.calls)) or (str(plan.refused or plan.error),))
        if plan.refused is not None:
            self.refused = self.refused or plan.refused.kind


class _Watch:
    """Sees whether the requests of a sentence are done, one after the other.

    Args:
        tracker: that sees the world's events.
        said: the sentence.
        world: where.
    """

    def __init__(self, tracker: GoalTracker, said: SeveralRequests, world: World) -> None:
        self._tracker, self._world, self._requests = tracker, world, said.requests
        self._strict = said.kind in _IN_ORDER
        self._done = 0
        self._too_early = False
        self._at_start = [self._holds(one) for one in said.requests]
        self._begin()

    @property
    def reached(self) -> bool:
        """Whether all were done, none that was to come later before its time."""
        return self._done == len(self._requests) and not self._too_early

    def look(self) -> None:
        """Go on to the next request for each that is done."""
        while self._done < len(self._requests) and self._holds(self._requests[self._done]):
            self._done += 1
            self._begin()

    def _begin(self) -> None:
        if self._done == len(self._requests):
            return
        one = self._requests[self._done]
        early = self._done > 0 and self._holds(one) and not self._at_start[self._done]
        self._too_early = self._too_early or (self._strict and early)
        subtask = SubTask(instruction=one.clause, goals=one.wanted)
        self._tracker.begin_subtask(subtask, self._world.last_event)

    def _holds(self, one: WantedClause) -> bool:
        return not self._tracker.unmet(one.wanted, self._world.last_event)


def _plans(moments: Iterable[Plan | SkillResult | Outcome]) -> Iterator[Plan]:
    return (moment for moment in moments if isinstance(moment, Plan))


def _handled(world: World, room: str, types: Iterable[str]) -> Iterator[MemoryUnit]:
    """Yield a unit for the first thing of each type."""
    things = truth_of(world.last_event).objects
    for kind in types:
        thing = next(one for one in things if one.object_type == kind)
        yield MemoryUnit(
            object_id=thing.object_id,
            object_type=kind,
            position_m=thing.position_m,
            place_id=place_of(thing),
            handled=True,
            scene=room,
        )
