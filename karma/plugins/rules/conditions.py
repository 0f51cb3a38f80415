"""Check the conditions of a request by looking, before anything is done."""

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from functools import partial

from karma.household.types import object_types
from karma.household.uses import kind_of
from karma.plugins.rules.object_finder import (
    PLACES,
    ObjectFinder,
    Steps,
    is_several,
    is_so,
    refusal,
)
from karma.plugins.rules.request_checker import here_of
from karma.plugins.rules.types import Condition, Mention
from karma.types.observation import SeenObject
from karma.types.planning import RefusedRequest, SkillCall


@dataclass(slots=True)
class ConditionCheck(ObjectFinder):
    """The conditions of one request."""

    meant: dict[str, str] = field(default_factory=dict)  # objects of the conditions: type -> id

    def hold(self) -> Steps[bool]:
        """Return whether all conditions hold; report a condition that does not."""
        for condition in self.asked.conditions:
            holds = yield from self._decided(condition)
            if holds is None:
                words = (condition.text,)
                yield refusal(RefusedRequest(kind="condition", by="guard", words=words))
                return False
            if not holds:
                self.progress.nothing_to_do = True
                isnt = "" if condition.text.lower().startswith("unless") else "not "
                self.say(f"{condition.text}: that is {isnt}so", "seen")
                return False
        return True

    def _decided(self, condition: Condition) -> Steps[bool | None]:
        """Check a condition once for both "if it is on" and "otherwise"."""
        thing = condition.thing
        told = (*thing.types, "of", *thing.at) if thing is not None else ()
        key = (condition.state, condition.of, *told, "at", *condition.at)
        decided = self.earlier.decided
        if key in decided:
            return decided[key] == condition.holds
        holds = yield from self._looked_at(condition)
        if holds is not None:
            decided[key] = holds == condition.holds
        return holds

    def _looked_at(self, condition: Condition) -> Steps[bool | None]:
        """Return whether a condition holds, or None if it cannot be observed."""
        thing = condition.thing
        if thing is None or not condition.state:
            return None
        kinds = self.kinds_of(thing)
        if condition.state == "there":
            thing = replace(thing, at=condition.at)
            one = yield from self._is_there(thing, kinds)
            self._mean(thing, one)
            return one if one is None else bool(one) == condition.holds
        states: list[bool] = []
        several = condition.of != "one"
        for sight in (yield from self._looked_for(thing, kinds, several=several)):
            states.append((yield from self._is_so(condition.state, sight)))
            if states[-1] or not several:
                self._mean(thing, sight.object_id)
        whole = all if condition.of in ("all", "each") else any
        return whole(states) == condition.holds if states else None

    def _looked_for(
        self, thing: Mention, kinds: Collection[str], *, several: bool
    ) -> Steps[list[SeenObject]]:
        """Return the first object of each type, or all; or the object at the described location."""
        if thing.at and several:
            places = self.places([*map(kind_of, thing.at)])
            yield from self.looked_over(places[:PLACES], lambda: None)
            fitting = [one for one in self.of_kinds(kinds) if self.fits(one.object_id, thing)]
            return fitting if len(places) <= PLACES else []
        if thing.at:
            name = yield from self._is_there(thing, kinds)
            return [self.sights[name]] if name else []
        found: list[SeenObject] = []
        for kind in kinds:
            result = self.call(SkillCall.of("Explore", kind))
            yield result
            ids = [one for one in result.object_ids if kind_of(one) == kind]
            sight = self.sights.get(ids[-1]) if ids else next(iter(self.of_kinds({kind})), None)
            found += [sight] if result.ok and sight is not None else []
        if not several:
            return found
        carried = [kind for kind in kinds if object_types()[kind].can("pickupable")]
        places = self.places({*kinds} - {*carried})
        for name in places if len(places) <= PLACES else ():
            yield self.go_to(name)
        seen: set[str] = set()
        while carried and (yield from self.another(carried, seen)) is not None:
            seen = {name for name in self.sights if kind_of(name) in carried}
        return self.of_kinds(kinds) if len(places) <= PLACES else []

    def _is_so(self, state: str, sight: SeenObject) -> Steps[bool]:
        """Return whether an object has a state; look inside to check whether it is empty."""
        name = sight.object_id
        if state in ("empty", "filled") and object_types()[sight.object_type].can("receptacle"):
            yield self.look_over(sight)
            if self.holds_anything(name):
                return state == "filled"
        return is_so(state, self.sights.get(name) or sight)

    def _is_there(self, thing: Mention, kinds: Collection[str]) -> Steps[str | None]:
        """Search for a described object; return "" if absent, None if the search is incomplete."""
        known = partial(self.next_known, kinds, frozenset[str](), thing)
        if not thing.at:
            while (one := known()) is None:
                tried = {name for name in self.sights if kind_of(name) in kinds}
                if (yield from self.another(kinds, tried)) is None:
                    return ""
            return one
        at = [*map(kind_of, here_of(thing.at, self.here))]
        places = self.places(at) or [one.object_id for one in self.of_kinds(at)]
        if not places and (carried := (yield from self.another(at, set()))):
            places = [carried]  # it is on no map
        lain_in = {parent for one in self.of_kinds(kinds) for parent in one.parent_ids}
        places = sorted(places, key=lambda one: one not in lain_in)
        found = yield from self.looked_over(places[:PLACES], known)
        return found or (None if len(places) > PLACES else "")

    def _mean(self, thing: Mention, name: str | None) -> None:
        """Store the object whose condition was checked: the action is done to it."""
        deeds = self.asked.deeds
        said = [*(one for deed in deeds for one in deed.things), *(deed.place for deed in deeds)]
        for one in (one for one in said if one is not None and name):
            if one.types == thing.types and one.at in ((), thing.at) and not is_several(one):
                self.meant[kind_of(name or "")] = name or ""
