"""Carry out a parsed answer of goal mode: conditions, wishes, questions."""

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace

from karma.agent.goal_mode.language import VERBS, Description, GoalAnswer, Wish
from karma.agent.goal_mode.objects import KnownObject, ObjectFinder
from karma.agent.loop import AgentSession
from karma.agent.planning.expert import ExpertView, NamedThing, solve
from karma.agent.planning.program import PUTS
from karma.household.ids import is_id, type_of
from karma.household.pieces import base_type
from karma.household.places import FLOOR, HAND
from karma.household.saying import name_of, plural_of, spoken, told_place, with_article
from karma.household.states import SAID_AS
from karma.household.uses import BIN, COFFEE_MACHINE
from karma.types.events import AgentEvent, SkillResult
from karma.types.planning import End, SkillCall
from karma.types.tasks import Goal

MAX_PROGRAMS = 5  # per object; each leaves out what the world refused
_FOUND_NO = "I found no "
_WAYS = frozenset({"GoToObject", "Explore"})  # calls without an effect to report

Work = Generator[AgentEvent, None, str]
"""Yields skill results; returns why the wish failed, or an empty text."""


@dataclass(frozen=True, slots=True)
class GoalWork:
    """Carries out one parsed answer."""

    session: AgentSession
    finder: ObjectFinder

    def carry_out(self, answer: GoalAnswer) -> Generator[AgentEvent, None, End | bool]:
        """Check the conditions, achieve the wishes, and answer the questions."""
        for avoided in answer.avoided:
            yield from self.finder.look_at_places(avoided)
        self.finder.avoid(answer.avoided)
        for description, wanted in answer.conditions:
            found = yield from self.finder.find(replace(description, count=1))
            if bool(found) != wanted:
                words = _in_words(description)
                found_words = f"no {words}" if wanted else with_article(words)
                return End(kind="tell", text=f"Nothing to do: there is {found_words}.")
        failures = []
        for wish in answer.wishes:
            failures.append((yield from self._grant(wish)))
        if reasons := list(dict.fromkeys(filter(None, failures))):
            if all(reason.startswith(_FOUND_NO) for reason in failures):  # nothing was done
                return End(kind="refuse", text=f"{'; '.join(reasons)}.")
            self.session.say("; ".join(reasons), "unseen")
            return False
        if not answer.told:
            return End(kind="done", text="")
        texts = []
        for description in answer.told:
            texts.append((yield from self._report(description)))
        return End(kind="tell", text=" ".join(texts))

    # ------------------------------------------------------------- wishes

    def _grant(self, wish: Wish) -> Work:
        """Achieve a wish for each object of its description."""
        ids = yield from self.finder.find(wish.what)
        if not ids:
            return f"{_FOUND_NO}{_in_words(wish.what)}"
        for object_id in ids:
            reason = yield from self._grant_for(wish, object_id)
            if reason:
                return reason
        if wish.what.count is not None and len(ids) < wish.what.count:
            return f"I found only {len(ids)} {_in_words(replace(wish.what, count=2))}"
        return ""

    def _grant_for(self, wish: Wish, object_id: str) -> Work:
        """Achieve a wish for one object; retry without the receptacles that the world refused."""
        where: tuple[str, ...] = ()
        if wish.where is not None:
            where = yield from self.finder.find(wish.where)
            if not where:
                return f"{_FOUND_NO}{_in_words(wish.where)}"
        refused: set[tuple[str, str]] = set()
        reason = ""
        for _ in range(MAX_PROGRAMS):
            receptacle = self._receptacle(wish, where, object_id, refused)
            if receptacle is None:
                return reason or f"there is no place left for the {name_of(object_id)}"
            goals = _goals(wish, object_id, receptacle)
            result = yield from self._run(solve(goals, self._view(wish, receptacle, refused)))
            if result is None:
                self.finder.handle(object_id)
                return ""
            reason = result.reason
            call = result.call
            if call.skill not in PUTS:
                continue
            refused.add((call.objects[0], call.objects[-1]))
            refused.add((object_id, receptacle))
        return reason

    def _receptacle(
        self,
        wish: Wish,
        where: Sequence[str],
        object_id: str,
        refused: set[tuple[str, str]],
    ) -> str | None:
        """Return the id or type to put an object; None if all were refused; "" without a place."""
        if wish.verb == "trash":
            return BIN
        if wish.where is None:
            return ""
        others = self.finder.matching(replace(wish.where, count=None))
        ids = (*where, *(entry.object_id for entry in others))
        return next((i for i in ids if i != object_id and (object_id, i) not in refused), None)

    def _run(self, program: Sequence[SkillCall]) -> Generator[AgentEvent, None, SkillResult | None]:
        """Run a program; return the result of the call that failed, or None."""
        for call in program:
            exact = is_id(call.objects[-1])
            result = self.session.call(replace(call, exact=exact), reported=call.skill not in _WAYS)
            yield result
            if not result.ok:
                return result
        return None

    def _view(self, wish: Wish, receptacle: str, refused: set[tuple[str, str]]) -> ExpertView:
        """Return the agent's knowledge as the expert reads it."""
        known = self.finder.known()
        held = self.session.remembered().held
        things = [
            _thing(entry, near=wish.verb == "near" and entry.object_id == receptacle)
            for entry in known
            if not (receptacle == type_of(receptacle) == entry.object_type)  # any of them will do
        ]
        fixtures = self.session.remembered().fixtures
        return ExpertView(
            things=tuple(things),
            landmarks=frozenset(fixtures.values()),
            held=next((t for t in things if held and t.name == held.object_id), None),
            refused=frozenset(refused),
        )

    # ------------------------------------------------------------- questions

    def _report(self, description: Description) -> Generator[AgentEvent, None, str]:
        """Search for the objects of a question; return their locations and states."""
        ids = yield from self.finder.find(description)
        known = {entry.object_id: entry for entry in self.finder.known()}
        objects = [known[entry] for entry in ids if entry in known]
        if not objects:
            return f"I found no {_in_words(description)}."
        fixed = all(
            type_of(entry.object_id) == FLOOR or entry.place_id is None for entry in objects
        )
        if fixed:
            texts = []
            for entry in objects[:4]:
                yield from self.finder.look_over(entry.object_id)
                texts.append(self._contents(entry.object_id))
            return " ".join(texts)
        told = [f"the {_name(entry)} is {told_place(entry.place_id)}" for entry in objects]
        count = f"{len(objects)}: " if len(objects) > 1 else ""
        return f"{count}{'; '.join(told)}."

    def _contents(self, object_id: str) -> str:
        """Return the state and the contents of a fixture."""
        known = {entry.object_id: entry for entry in self.finder.known()}
        entry = known[object_id]
        inside = [o for o in known.values() if o.place_id and o.place_id.startswith(object_id)]
        states = [SAID_AS.get(word, word) for word in entry.states if word != "none"]
        text = f"The {name_of(object_id)} is {' and '.join(states)}" if states else ""
        if inside:
            names = ", ".join(_name(o) for o in inside)
            link = told_place(object_id).partition(" ")[0]
            text = (
                f"{text}; {link} it: {names}" if text else f"On the {name_of(object_id)}: {names}"
            )
        return f"{text or f'I see the {name_of(object_id)}'}."


def _goals(wish: Wish, object_id: str, receptacle: str) -> list[Goal]:
    """Return the goals of a wish for an object id."""
    _, predicate, state = VERBS[wish.verb]
    if predicate == "STATE":
        goals = [Goal(predicate=predicate, arguments=(object_id, state))]
        if wish.verb == "coffee":
            goals.append(Goal(predicate="TOGGLEON", arguments=(COFFEE_MACHINE,)))
        return goals
    if predicate == "HOLDON":
        return [Goal(predicate=predicate, arguments=("robot", object_id))]
    if predicate in ("ON", "NEAR"):
        return [Goal(predicate="ON", arguments=(object_id, receptacle))]
    return [Goal(predicate=predicate, arguments=(object_id,))]


def _thing(entry: KnownObject, *, near: bool) -> NamedThing:
    place = entry.place_id if entry.place_id != HAND else None
    return NamedThing(
        name=entry.object_id,
        object_type=entry.object_type,
        states=entry.states,
        place=place,
        place_type=type_of(place) if place else None,
        holds=not near,
        now=entry.states,
    )


def _name(entry: KnownObject) -> str:
    shown = [SAID_AS.get(w, w) for w in entry.states if w not in ("none", "closed", "off")]
    return " ".join([*shown, spoken(base_type(entry.object_type))])


def _in_words(description: Description) -> str:
    words = spoken(description.name)
    if description.count != 1:
        words = plural_of(words)
    parts = [("" if holds else "not ") + state for state, holds in description.states]
    parts += [("" if holds else "not ") + f"in the {spoken(p)}" for p, holds in description.places]
    return " ".join([words, *(["that is " + " and ".join(parts)] if parts else [])])
