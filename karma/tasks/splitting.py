"""Which goal falls due in which clause of an instruction."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from karma.contracts import Goal, SubTask
from karma.household.places import HAND
from karma.household.states import DONE_BY, END_STATES, OPPOSITES
from karma.household.types import object_type
from karma.tasks.clauses import Phrase, halves, read_clauses
from karma.tasks.goals import is_position, object_names
from karma.tasks.loose_names import ANYTHING, key_of, meaning, state_of

BEAM = 200  # assignments of goals to clauses kept at a time
FITS = 4  # the least score at which a goal belongs to a clause at all
_NAMED, _MEANT, _HINTED = 4, 3, 2  # the goal's object in the clause
_ASKED = 12  # the clause asks for the goal, in so many words
_DEED = 6  # the clause's verb brings the goal about
_PLACED, _DONE_AT, _ELSEWHERE = 8, 6, -4  # the goal's place in the clause, by name, by the verb
_EXACT = 1  # a name as the goal has it
_BACK = 4  # cost of a step back in the order of clauses
_UNDONE = 6  # of two goals that exclude each other in one clause, in their order
_DOORS = ("OPEN", "CLOSED")
_TORN = 40  # of such goals in the wrong order


def assign(goals: Sequence[Goal], clauses: Sequence[str]) -> tuple[SubTask, ...]:
    """Return one sub-task per clause, each goal in the clause where it becomes due.

    Goals that exclude each other (a second place for the same object) go to different clauses, for
    which a clause may be cut at "and <verb>". Where it cannot be cut, the earlier ones need only
    have held. A goal that fits no clause goes where its neighbours leave room for it, rather late.
    """
    chosen = _best_assignment(goals, read_clauses(clauses))
    for number, text in enumerate(clauses):
        due = [goal for goal, clause in zip(goals, chosen, strict=True) if clause == number]
        parts = halves(text) if _excluding(due) else ()
        if parts:
            return assign(goals, (*clauses[:number], *parts, *clauses[number + 1 :]))
    return tuple(
        _subtask(text, [g for g, c in zip(goals, chosen, strict=True) if c == number])
        for number, text in enumerate(clauses)
    )


def _subtask(text: str, goals: Sequence[Goal]) -> SubTask:
    """Return a clause with its goals; on the way are means to a deed, and what a later one ends."""
    (phrases,) = read_clauses([text])
    due = tuple(dict.fromkeys(goals))
    passing = tuple(
        goal
        for number, goal in enumerate(due)
        if any(exclude(goal, later) for later in due[number + 1 :])
        or any(_is_means(goal, phrase, due) for phrase in phrases)
    )
    return SubTask(instruction=text, goals=due, passing=passing)


def _is_means(goal: Goal, phrase: Phrase, due: Sequence[Goal]) -> bool:
    """Return whether a place is not named, but goes with a deed that is asked for as well."""
    if not is_placement(goal) or is_position(goal.arguments[1]):
        return False
    place = meaning(goal.arguments[1])
    deeds = {state_of(g.arguments[1]) for g in due if g.predicate == "STATE"}
    named = place & (phrase.places | phrase.objects)
    return bool(place & phrase.done_at and not named and deeds & phrase.states)


# ----------------------------------------------------------------- the best assignment


@dataclass(frozen=True, slots=True)
class _Partial:
    """Clause numbers of the first goals."""

    score: int
    chosen: tuple[int, ...]
    early: int  # by how much goals that fit nowhere come before the last clause

    def rank(self) -> tuple[int, int, int, tuple[int, ...]]:
        """Best first: the score, then evenly spread, then goals that fit nowhere late."""
        counts = (self.chosen.count(clause) for clause in set(self.chosen))
        return -self.score, sum(n * n for n in counts), self.early, self.chosen


def _best_assignment(goals: Sequence[Goal], clauses: Sequence[Sequence[Phrase]]) -> tuple[int, ...]:
    """Search, by beam, for the clause numbers with the best sum of fits.

    Of equal sums the one that spreads the goals evenly is best; goals keep their order at a price.
    """
    last = len(clauses) - 1
    beam = [_Partial(0, (), 0)]
    for number, goal in enumerate(goals):
        fits = [
            max(_fit(goal, one) + _ASKED * asks(one, goal) for one in clause) for clause in clauses
        ]
        fitting = max(fits) >= FITS
        before = [i for i in range(number) if goals[i] == goal or exclude(goals[i], goal)]
        beam = sorted(
            (
                _Partial(
                    one.score + (fits[clause] if fitting else 0) - _price(one, clause, before),
                    (*one.chosen, clause),
                    one.early + (0 if fitting else last - clause),
                )
                for one in beam
                for clause in range(len(clauses))
            ),
            key=_Partial.rank,
        )[:BEAM]
    return beam[0].chosen


def _price(one: _Partial, clause: int, before: Sequence[int]) -> int:
    back = _BACK if one.chosen and clause < one.chosen[-1] else 0
    together = sum(one.chosen[i] == clause for i in before)
    torn = sum(one.chosen[i] > clause for i in before)
    return back + _UNDONE * together + _TORN * torn


# ----------------------------------------------------------------- what words ask for


def unasked(goals: Sequence[Goal], clauses: Sequence[str]) -> tuple[Goal, ...]:
    """Return the goals that no clause asks for: another thing, place or deed than the words have.

    What a deed needs or leaves behind is asked for with it: the sink of "wash", the door of a
    fridge that something is put into. Of a verb that is not known anything is believed.
    """
    phrases = [phrase for clause in read_clauses(clauses) for phrase in clause]
    return tuple(goal for goal in goals if not any(asks(phrase, goal) for phrase in phrases))


def asks(phrase: Phrase, goal: Goal) -> bool:
    """Return whether a phrase asks for a goal: for its object and for what becomes of that."""
    if not (phrase.does or phrase.speaks):
        return True  # "do it": nobody can say what that does not ask
    name = object_names(goal)[0]
    subject = meaning(name)
    means = bool(subject & phrase.done_at)
    if not means and not _spoken_of(subject, key_of(name), phrase):
        return goal.predicate in _DOORS and bool(subject & phrase.places)
    if not phrase.verbs:
        return True  # unknown
    if is_placement(goal):
        return _asks_place(phrase, goal)
    if goal.predicate == "STATE":
        return state_of(goal.arguments[1]) in phrase.states | phrase.described
    if goal.predicate == "HOLDON" and not phrase.does:
        return True  # "find the mug"
    done = goal.predicate in phrase.predicates or END_STATES.get(goal.predicate) in phrase.states
    return means or done or (goal.predicate in _DOORS and bool(subject & phrase.places))


def _asks_place(phrase: Phrase, goal: Goal) -> bool:
    """Return whether a phrase lets a thing that it speaks of be where a goal has it."""
    if is_position(goal.arguments[1]):
        return phrase.moves
    place = meaning(goal.arguments[1])
    if place & (phrase.places | phrase.done_at):
        return True
    if not phrase.moves:
        return bool(place & phrase.objects)  # "see the phone by the lamp"
    return not phrase.done_at and not _receptacles(phrase.places)


def _receptacles(kinds: Iterable[str]) -> bool:
    return any(object_type(kind).can("receptacle") for kind in kinds)


# ----------------------------------------------------------------- how well they fit


def _fit(goal: Goal, phrase: Phrase) -> int:
    """Return how well a goal suits a phrase: by its object, then by its place or the verb."""
    name = object_names(goal)[0]
    subject = meaning(name)
    score = _spoken_of(subject, key_of(name), phrase)
    if is_placement(goal):
        return score + _fit_place(goal, phrase, other=score == 0)
    if goal.predicate == "STATE":
        return score + _DEED * (state_of(goal.arguments[1]) in phrase.states)
    if subject & phrase.done_at:
        return score + _DEED
    done = goal.predicate in phrase.predicates or END_STATES.get(goal.predicate) in phrase.states
    return score + _DEED * (score > 0 and done)


def _spoken_of(subject: frozenset[str], key: str, phrase: Phrase) -> int:
    if subject & (phrase.objects | phrase.places):
        return _NAMED + _EXACT * (key in phrase.keys)
    if subject & phrase.meant:
        return _MEANT
    return _HINTED if subject & phrase.hints or ANYTHING in phrase.hints else 0


def _fit_place(goal: Goal, phrase: Phrase, *, other: bool) -> int:
    """Return how well a placement suits a phrase, its object left aside.

    Args:
        goal: ON or INSIDE, or a STATE that names a place.
        phrase: what it is held against.
        other: the phrase does not speak of the goal's object.
    """
    score = 2 * phrase.moves - 4 * (other and bool(phrase.objects | phrase.meant))
    if is_position(goal.arguments[1]):
        return score + (0 if phrase.places else 2)  # "back where it belongs"
    place = meaning(goal.arguments[1])
    if place & phrase.places:
        return score + _PLACED + _EXACT * (key_of(goal.arguments[1]) in phrase.keys)
    if place & phrase.done_at:
        return score + _DONE_AT
    return score + _ELSEWHERE if place and _receptacles(phrase.places) else score


def is_placement(goal: Goal) -> bool:
    """Return whether a goal says where something is to be, if only by STATE(book, sofa)."""
    if goal.predicate == "STATE":
        return state_of(goal.arguments[1]) is None and bool(meaning(goal.arguments[1]))
    return goal.predicate in ("ON", "INSIDE")


def exclude(one: Goal, other: Goal) -> bool:
    """Return whether two goals cannot both become due at once: same object, other outcome."""
    if key_of(object_names(one)[0]) != key_of(object_names(other)[0]):
        return False
    (aspect, outcome), (same, another) = _outcome(one), _outcome(other)
    return aspect != "" and aspect == same and outcome != another


def _outcome(goal: Goal) -> tuple[str, str]:
    """Return what a goal decides about its object, and how; ("", ...) where nothing excludes it."""
    if goal.predicate == "HOLDON":
        return "place", HAND
    if is_placement(goal):
        place = goal.arguments[1]
        return "place", place if is_position(place) else key_of(place)
    state = END_STATES.get(goal.predicate) or state_of(goal.arguments[-1]) or ""
    state = DONE_BY.get(state, state)
    return (min(state, OPPOSITES[state]), state) if state in OPPOSITES else ("", state)


def _excluding(goals: Sequence[Goal]) -> bool:
    return any(exclude(a, b) for i, a in enumerate(goals) for b in goals[:i])
