"""A memory that stays true: beliefs that age and give way, their history, and likely places.

`TrueUnits` is the same within the paper's ten units: no log, and as many beliefs as lines.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import isfinite

from karma.household.places import HAND
from karma.plugins.homes.memory.ageing import (
    SURE,
    Ageing,
    AskedFor,
    HomePrior,
    PlaceShares,
    home_prior,
)
from karma.plugins.homes.memory.beliefs import OVERLOOKED, Beliefs
from karma.plugins.homes.memory.episodes import MOST_EPISODES, Belief, EpisodeLog, EpisodeQuery
from karma.plugins.homes.memory.setting import (
    MemorySetting,
    has_states,
    is_of_past,
    is_said_place,
    ranks_of,
    types_meant,
)
from karma.plugins.homes.types import Fact, HomeMoment, HomeQuestion, LikelyPlace, SaidThing

OTHERS = 0.08  # chance that is left for places of no opinion
ELSEWHERE = 0.05  # what a place counts that is not of the kind that was said
AS_AGED = AskedFor()
FOUND = 256  # episodes that one question may be about


class TrueMemory:
    """A `HomeMemory` that corrects itself, says how sure it is, and orders searches.

    Args:
        setting: of the home.
        most_episodes: closed ones that its log keeps.
        prior: what is known of homes before one is known; None: of the training homes.
    """

    def __init__(
        self,
        setting: MemorySetting,
        *,
        most_episodes: int = MOST_EPISODES,
        prior: HomePrior | None = None,
    ) -> None:
        prior = prior or home_prior()
        self._places = setting.places
        self._ageing = Ageing(prior.types)
        self._asked = prior.asked
        self._beliefs = Beliefs(self._ageing)
        self._shares = PlaceShares(prior, setting.places)
        self.log = EpisodeLog(setting.embedder, setting.places, most_episodes=most_episodes)
        self._looked: dict[str, float] = {}  # place -> when it was looked over last

    def take_in(self, moment: HomeMoment) -> None:
        """Correct what is believed, and write down what has come about."""
        seen_well = tuple(one for one in moment.seen if all(map(isfinite, one.position_m)))
        moment = replace(moment, seen=seen_well)  # a depth camera may tell no position
        for place_id in moment.looked_over:
            self._looked[place_id] = moment.time_s
        for old, new in self._beliefs.take_in(moment):
            seen = new.sighting
            if new.reason == "not there":
                continue  # what is known is what was seen last
            if old is None or old.sighting.place_id != seen.place_id:
                self._shares.visit(seen.object_id, seen.object_type, seen.place_id)
            if old is not None:
                self.log.end(old)
            self.log.begin(new)

    def recall(self, question: HomeQuestion, k: int) -> Sequence[Fact]:
        """Return what fits: of the past from the history, of now from beliefs with chances."""
        said = question.thing
        past = said.who or said.action or said.before_s is not None
        if past or question.asked in ("time", "who"):
            return self._past(question, k)
        ranks = ranks_of(said)
        found = [one for one in self._beliefs if not ranks or one.sighting.object_type in ranks]
        found.sort(key=lambda one: self._order(one, said, ranks))
        asked = AS_AGED if question.asked == "count" else self._asked_for(said, found=said.ids)
        return [self._fact(belief, question.time_s, asked) for belief in found[:k]]

    def likely_places(self, question: HomeQuestion) -> Sequence[LikelyPlace]:
        """Return where the thing is likely to be: believed, habitual, usual for its type."""
        said = question.thing
        kinds = types_meant(said)
        known = [belief for one in said.ids if (belief := self._beliefs.get(one)) is not None]
        alike = (one for one in self._beliefs if one.sighting.object_type in kinds)
        mine = known or [one for one in alike if self._fits(one, said)]
        if not mine and not kinds:
            return ()
        kind = mine[0].sighting.object_type if len(mine) == 1 or not kinds else kinds[0]
        ids = [one.sighting.object_id for one in mine] if len(mine) == 1 else []
        shares = self._shares.of(ids, kind)
        chances: dict[str, float] = {}
        left = 1.0
        if len(mine) == 1 and mine[0].ended_s is None:
            place_id = mine[0].sighting.place_id or ""
            asked = self._asked_for(said)
            chances[place_id] = self._holds(mine[0], question.time_s, asked)
            left -= chances[place_id]
            shares.pop(place_id, None)
        since = mine[0].sighting.time_s if len(mine) == 1 else 0.0
        open_to = {
            place_id: share
            * self._unseen(ids, kind, place_id, since, question.time_s)
            * (1.0 if self._is_said(place_id, said) else ELSEWHERE)
            for place_id, share in shares.items()
        }
        scale = left * (1.0 - OTHERS) / max(sum(open_to.values()), 1e-9)
        for place_id, share in open_to.items():
            chances[place_id] = chances.get(place_id, 0.0) + scale * share
        order = sorted(chances, key=lambda one: (-chances[one], one))
        return [LikelyPlace(place_id=one, chance=chances[one]) for one in order if one != HAND]

    def size_bytes(self) -> int:
        """Return bytes of the log."""
        return self.log.size_bytes()

    def close(self) -> None:
        """Let go of the log."""
        self.log.close()

    # ------------------------------------------------------------- now

    def _fact(self, belief: Belief, time_s: float, asked: AskedFor) -> Fact:
        fact = Fact(sighting=belief.sighting, deed=belief.deed, ended_s=belief.ended_s)
        gone = belief.ended_s is not None
        return fact if gone else replace(fact, holds=self._holds(belief, time_s, asked))

    def _holds(self, belief: Belief, time_s: float, asked: AskedFor) -> float:
        """Return the chance that a thing is where it was seen: not moved, or back there.

        Looks at other places since then, which would have shown it, make that likelier (Bayes).
        """
        seen = belief.sighting
        stays, ids = self._beliefs.chance(belief, time_s), [seen.object_id]
        shares = self._shares.of(ids, seen.object_type)
        there = stays + (1.0 - stays) * shares.pop(seen.place_id or "", 0.0)
        elsewhere = (1.0 - stays) * sum(
            share * self._unseen(ids, seen.object_type, place_id, seen.time_s, time_s)
            for place_id, share in shares.items()
        )
        return asked.chance(there / max(there + elsewhere, SURE))

    def _asked_for(self, said: SaidThing, *, found: Sequence[str] = ()) -> AskedFor:
        """Return what it says about a thing that it is asked for in these words.

        Where its place is said, it is most likely there; of what is asked for by its name alone,
        much has moved; what was found by more than its name is between the two.
        """
        if found or is_described(said):
            return self._asked.get("described", AS_AGED)
        told = bool(said.place_types or said.room)
        return self._asked.get("told" if told else "named", AS_AGED)

    def _unseen(
        self, ids: Sequence[str], kind: str, place_id: str, since_s: float, time_s: float
    ) -> float:
        """Return the chance that a thing may be at a place for all that was seen there.

        A place that was looked over since the thing was seen last did not show it then: it is there
        only if it was moved there later, or was overlooked.
        """
        looked_s = self._looked.get(place_id)
        if looked_s is None or looked_s <= since_s:
            return 1.0
        hours = self._ageing.hours(kind, looked_s, max(time_s, looked_s))
        stays = self._ageing.stays(ids[0] if ids else "", kind, hours)
        return OVERLOOKED + (1.0 - OVERLOOKED) * (1.0 - stays)

    def _order(
        self, belief: Belief, said: SaidThing, ranks: dict[str, int]
    ) -> tuple[bool, int, bool, float, str]:
        seen = belief.sighting
        fits, ended = self._fits(belief, said), belief.ended_s is not None
        rank = ranks.get(seen.object_type, 0)
        return (not fits, rank, ended, -seen.time_s, seen.object_id)  # of one view by their ids

    def _fits(self, belief: Belief, said: SaidThing) -> bool:
        """Return whether states and place of a belief are as said."""
        return has_states(belief.sighting, said) and self._is_said(belief.sighting.place_id, said)

    def _is_said(self, place_id: str | None, said: SaidThing) -> bool:
        return is_said_place(self._places.get(place_id or ""), said)

    # ------------------------------------------------------------- then

    def _past(self, question: HomeQuestion, k: int) -> list[Fact]:
        """Return episodes of the asked person, deed and time, the likelier types first.

        Of a type the newest comes first; where none is known the words are looked up.
        """
        said, ranks = question.thing, ranks_of(question.thing)
        for belief in self._beliefs.fresh():
            self.log.extend(belief)
        query = EpisodeQuery(
            types=tuple(ranks),
            text="" if ranks else said.phrase or question.text,
            after_s=said.after_s if said.who or said.action else None,
            before_s=said.before_s,
            who=said.who,
            action=said.action,
            by_deed=question.asked == "who",
            state=next((one for one in said.states if one != "cleaned"), ""),  # not dirty, it is
        )
        found = self.log.recall(query, FOUND)
        if query.state and not found:  # it was never seen so
            found = self.log.recall(replace(query, state=""), FOUND)
        found.sort(key=lambda one: ranks.get(one.sighting.object_type, 0))
        return [_as_fact(one, said.before_s) for one in found[:k]]


def _as_fact(episode: Belief, before_s: float | None) -> Fact:
    """Return an episode as a fact, as it was seen last before a time."""
    seen = episode.sighting
    if before_s is not None and seen.time_s > before_s:
        seen = replace(seen, time_s=max(episode.since_s, before_s))
    return Fact(sighting=seen, deed=episode.deed)


def is_described(said: SaidThing) -> bool:
    """Return whether a thing is known by a deed, a time, a state, or what it was beside."""
    return is_of_past(said) or bool(said.states or said.beside is not None)


# ----------------------------------------------------------------- in ten units


HALF_LIFE = 60.0  # uses of all lines after which a use counts half
UNUSED = 0.2  # of a use, that a line is worth which was only seen


class TrueUnits(TrueMemory):
    """A `HomeMemory` that keeps the ten beliefs which are worth most.

    What it learns of how things move and where they go is kept, as the paper's map is.
    """

    def __init__(self, setting: MemorySetting) -> None:
        super().__init__(setting)
        self._policy = NeedTruthCost(setting.units, self._worth)
        self._now_s = 0.0

    def take_in(self, moment: HomeMoment) -> None:
        """Correct what is believed; then keep what is worth most."""
        self._now_s = moment.time_s
        super().take_in(moment)
        for seen in moment.seen:
            self._count(seen.object_id, UNUSED if moment.deed is None else 1.0)

    def _count(self, object_id: str, uses: float) -> None:
        """Count a belief in; what leaves for it is forgotten."""
        leaves = self._policy.count(object_id, uses)
        if leaves is not None:
            self._beliefs.forget(leaves)
            self.log.drop(leaves)

    def recall(self, question: HomeQuestion, k: int) -> Sequence[Fact]:
        """Return what fits; what is told was needed."""
        found = super().recall(question, k)
        for fact in found[:1]:
            if fact.sighting.object_id in self._policy:
                self._policy.count(fact.sighting.object_id, 1.0)
        return found

    def _worth(self, object_id: str) -> float:
        """Return the chance that a belief is true, times the looks that a search would take."""
        belief = self._beliefs.get(object_id)
        if belief is None or belief.ended_s is not None:
            return 0.0
        seen = belief.sighting
        shares = self._shares.of([object_id], seen.object_type)
        best = max(shares.values(), default=0.1)
        return self._beliefs.chance(belief, self._now_s) * (1.0 - best)


class NeedTruthCost:
    """Which key leaves a full memory, where another part knows what each is worth.

    A key's worth is the chance of being true times the cost of finding again; at least 0.
    """

    def __init__(self, capacity: int, worth: Callable[[str], float]) -> None:
        if capacity < 1:
            raise ValueError(f"a memory of {capacity} units")
        self._capacity, self._worth = capacity, worth
        self._needs: dict[str, tuple[float, int]] = {}  # of residents: uses, and when last halved
        self._past: dict[str, tuple[float, int]] = {}  # of those that left
        self._clock = 0

    def count(self, key: str, uses: float) -> str | None:
        """Count uses of a key, less than one where it was only seen; return the key that left."""
        self._clock += 1
        old = self._needs.pop(key, None) or self._past.pop(key, (0.0, self._clock))
        self._needs[key] = (self._aged(old) + uses, self._clock)
        if len(self._needs) <= self._capacity:
            return None
        leaves = min(self._needs, key=lambda one: (self._value(one), self._needs[one][1], one))
        self._past[leaves] = self._needs.pop(leaves)
        return leaves

    def _value(self, key: str) -> float:
        return self._aged(self._needs[key]) * self._worth(key)

    def _aged(self, need: tuple[float, int]) -> float:
        uses, when = need
        return float(uses * 0.5 ** ((self._clock - when) / HALF_LIFE))

    def __contains__(self, key: object) -> bool:
        return key in self._needs
