"""What was so and when: the episodes that beliefs begin and end, over the episodic log."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

from karma.contracts import Asked, SaidThing
from karma.memory.lived.beliefs import Belief
from karma.memory.lived.episodes import EpisodeLog, EpisodeQuery, LoggedEpisode

FOUND = 256  # episodes that one question may be about


class EpisodeHistory:
    """Episodes as beliefs make them.

    Args:
        log: keeps them; those that go on are extended when it is committed.
    """

    def __init__(self, log: EpisodeLog) -> None:
        self._log = log
        self._open: dict[str, tuple[int, Belief]] = {}  # by object id: number of its row

    def __len__(self) -> int:
        return len(self._log)

    def add(self, belief: Belief) -> None:
        """Begin an episode."""
        episode = LoggedEpisode(sighting=belief.sighting, since_s=belief.since_s, deed=belief.deed)
        self._open[belief.sighting.object_id] = (self._log.begin(episode), belief)

    def take_over(self, number: int, belief: Belief) -> None:
        """Go on with an episode of before a restart."""
        self._open[belief.sighting.object_id] = (number, belief)

    def close(self, belief: Belief) -> None:
        """End the episode of a belief, with its last sighting."""
        found = self._open.pop(belief.sighting.object_id, None)
        if found is not None:
            self._log.end(found[0], belief.sighting.time_s)

    def extend(self, belief: Belief) -> None:
        """Write down when a thing was seen last."""
        found = self._open.get(belief.sighting.object_id)
        if found is not None and found[1].sighting.time_s != belief.sighting.time_s:
            self._log.extend(found[0], belief.sighting.time_s)
            self._open[belief.sighting.object_id] = (found[0], belief)

    def drop(self, object_id: str) -> None:
        """Forget all episodes of a thing."""
        self._open.pop(object_id, None)
        self._log.drop(object_id)

    def find(
        self, ranks: Mapping[str, int], said: SaidThing, asked: Asked, text: str = ""
    ) -> Iterator[LoggedEpisode]:
        """Yield episodes of some types: those of the asked person, deed and time, newest first.

        Args:
            ranks: types that may be meant, the likelier ones lower; {}: not known.
            said: of the question.
            asked: what for.
            text: to look up where no type is known.
        """
        deeds = said.who or said.action
        query = EpisodeQuery(
            types=tuple(ranks),
            text="" if ranks else text,
            after_s=said.after_s if deeds else None,
            before_s=said.before_s,
            who=said.who,
            action=said.action,
            by_deed=asked == "who",
            state=next((one for one in said.states if one != "cleaned"), ""),  # not dirty, it is
        )
        found = self._log.recall(query, FOUND)
        if query.state and not found:  # it was never seen so
            found = self._log.recall(replace(query, state=""), FOUND)
        found.sort(key=lambda one: ranks.get(one.sighting.object_type, 0))
        return iter(found)
