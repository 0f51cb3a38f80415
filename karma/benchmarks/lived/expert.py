"""The expert's memory: all that the robot ever learnt, nothing lost, and the truth of now."""

from collections.abc import Callable, Mapping, Sequence

from karma.contracts import Fact, HomeMoment, HomeQuestion, LikelyPlace, Sighting
from karma.memory.lived.setting import KnownPlace
from karma.methods.lived.recalling import fits, is_of_past, types_meant


class ExpertMemory:
    """A `HomeMemory` that is never wrong about the present; a ceiling, no design.

    It knows where everything is that the robot has ever seen, and only that: of things never seen
    it knows nothing, as every other memory.

    Args:
        now: tells where every movable thing is now.
        places: furniture of the home.
    """

    name = "expert"

    def __init__(
        self, now: Callable[[], Mapping[str, Sighting]], places: Mapping[str, KnownPlace]
    ) -> None:
        self._now, self._places = now, places
        self._facts: list[Fact] = []
        self._seen: dict[str, Sighting] = {}

    def take_in(self, moment: HomeMoment) -> None:
        """Keep everything."""
        for seen in moment.seen:
            self._facts.append(Fact(sighting=seen, deed=moment.deed))
            self._seen[seen.object_id] = seen

    def recall(self, question: HomeQuestion, k: int) -> Sequence[Fact]:
        """Return what fits: the truth of now, and what was, the newest first."""
        said, found = question.thing, []
        past = is_of_past(said) or question.asked in ("time", "who")
        if not past:
            now = self._now()
            types = types_meant(said)
            for object_id in self._seen:
                seen = now.get(object_id)
                if seen is not None and (not types or seen.object_type in types):
                    found.append(Fact(sighting=seen, holds=1.0))
            found.sort(key=lambda fact: not fits(fact, said, self._places))
            return found[:k]
        then = question.asked == "place" and not said.who and not said.action
        for fact in reversed(self._facts):
            earlier = said.before_s is None or fact.sighting.time_s <= said.before_s
            before = then and earlier and self._is_meant(fact, question)
            if before or fits(fact, said, self._places):
                found.append(fact)
                if len(found) == k:
                    break
        return found

    def _is_meant(self, fact: Fact, question: HomeQuestion) -> bool:
        types = types_meant(question.thing)
        return not types or fact.sighting.object_type in types

    def likely_places(self, question: HomeQuestion) -> Sequence[LikelyPlace]:
        """Return nothing: it knows."""
        return ()

    def size_bytes(self) -> int:
        """Return 0: it is no memory that anybody could keep."""
        return 0

    def close(self) -> None:
        """Nothing is kept."""
