"""Which of several things is meant: told by its place, its state, or as "the other one".

What is told so is looked for until one is so; none is taken in its place.
"""

from collections.abc import Collection, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

from karma.agent.attempts import Programs
from karma.agent.body.skills import Skills
from karma.agent.planning.guard import meant_by, stated
from karma.agent.planning.reading import kind_of
from karma.agent.seeing.perceive import place_of
from karma.contracts import (
    Check,
    Completion,
    Experience,
    Mention,
    Plan,
    Prompt,
    RefusedRequest,
    Request,
    SaidDeed,
    SeenObject,
    SkillCall,
    SkillResult,
    SubTask,
)
from karma.household.deeds import FOR_GOOD, deed_kind
from karma.household.ids import root_id, type_of
from karma.household.pieces import is_piece
from karma.household.saying import name_of, spoken, told_place
from karma.household.states import OPPOSITES
from karma.household.types import object_types
from karma.household.uses import BASINS, BURNER, KNOB, LAMPS
from karma.language.request_words import request_words

_PUT = SaidDeed(verb="put", deed="put", start=-1)
PLACES = 12  # of a kind that are looked over
_MADE_SO = frozenset(("heated", "cooled", "cooked", "sliced", "filled"))  # "the hot potato"
# a look shows the other; so with "off"
_SHOWN_BY = {"clean": "dirty", "empty": "filled", "unbroken": "broken"}
_SHOWS = frozenset(("on", "off", "opened", "closed", "sliced"))  # states that are so for any deed


class Carrier(Protocol):
    """An episode that plans and acts."""

    chosen: dict[tuple[str, int], str]
    decided: dict[tuple[str, ...], bool]
    mine: Mapping[str, str]
    told: Collection[str]

    def planned(
        self, subtask: SubTask, skills: Skills, came: "Came", only: Mapping[str, str] | None = None
    ) -> Iterator[Plan | SkillResult]:
        """Plan and act until a program succeeds or the attempts are used up."""

    def here(self, skills: Skills) -> frozenset[str]:
        """Return the types that the agent knows of in this room."""

    def places(self, kinds: Collection[str]) -> list[str]:
        """Return the ids of the furniture of some kinds, by the map."""

    def sights(self, skills: Skills) -> dict[str, SeenObject]:
        """Return the latest sight of all that was seen in this room."""

    def handled(self) -> list[str]:
        """Return the ids of what was handled in this room and is remembered, the last one last."""


@dataclass(slots=True)
class Came:
    """What came of an instruction."""

    programs: list[Programs] = field(default_factory=list)
    searched: bool = False  # something was looked at beside the programs
    told: list[Check] = field(default_factory=list)  # besides
    nothing_to_do: bool = False
    short: bool = False  # fewer things than were asked for

    @property
    def tried(self) -> bool:
        """Whether anything was done."""
        return self.searched or any(one.results for one in self.programs)

    @property
    def finished(self) -> bool:
        """Whether all of it was done."""
        if self.short:
            return False
        return self.nothing_to_do or (
            bool(self.programs) and all(one.finished for one in self.programs)
        )

    def add(self, result: SkillResult) -> None:
        """Take in what was put back after the last program."""
        if self.programs and result.ok:
            self.programs[-1].go_on(result)

    def checks(self, experience: Experience) -> tuple[Check, ...]:
        """Return how it stands with all that was to be done."""
        found = [check for one in self.programs if one.results for check in one.checks(experience)]
        return (*dict.fromkeys(found), *self.told)


def not_told_apart(episode: Carrier, asked: Request, skills: Skills) -> RefusedRequest | None:
    """Return that one of several known things is told by words that no look shows: "the red"."""
    here = episode.here(skills)
    for one in asked.mentions:
        kinds = one.at if one.anything else meant_by(one, here)
        told = replace(one, at=()) if one.anything else one
        if one.marks and len(_alike(episode, skills, kinds, told)) > 1:
            return RefusedRequest(kind="alike", by="guard", words=one.marks)
    return None


def _alike(episode: Carrier, skills: Skills, kinds: Collection[str], thing: Mention) -> list[str]:
    """Return the ids of what is known of some kinds, and may be what a mention tells of."""
    wholes = {*map(kind_of, kinds)}
    sights = episode.sights(skills)
    seen = (
        one.object_id for one in of_kinds(episode, skills, wholes) if not is_piece(one.object_type)
    )
    known = dict.fromkeys((*seen, *_on_map(episode, wholes)))
    return [one for one in known if one not in sights or told_so(episode, skills, one, thing)]


def refusal(refused: RefusedRequest) -> Plan:
    """Return what stands for an answer where no planner is asked."""
    nothing = Completion(
        text="", finish="stop", prompt_tokens=0, reused_tokens=0, completion_tokens=0,
        first_token_s=None, total_s=0.0,
    )  # fmt: skip
    return Plan(
        prompt=Prompt(stable="", changing=""),
        completion=nothing,
        calls=(),
        names={},
        refused=refused,
    )


def place_told(
    episode: Carrier, asked: Request, skills: Skills, came: Came
) -> Generator[Plan | SkillResult, None, dict[str, str] | None]:
    """Return the place that words tell of, type -> id; {}: any will do, None: there is none."""
    place, told = asked.deeds[0].place, replace(asked, deeds=(_PUT,))
    kinds = [] if place is None else [*map(kind_of, meant_by(place, episode.here(skills)))]
    if place is None or place.every or not _is_told(told, place, kinds):
        return {}
    alike = _alike(episode, skills, kinds, replace(place, text="", states=(), at=()))
    if len(alike) < 2 and not object_types()[kinds[0]].can("pickupable"):
        return {}
    one = yield from _the_one_told(episode, asked, place, kinds, skills, came)
    return {kind_of(one): one} if one else None


def told_apart_by_words(
    episode: Carrier, asked: Request, kinds: Collection[str], skills: Skills, came: Came
) -> Generator[Plan | SkillResult, None, str | None]:
    """Return the one of several that words tell of; "" where none is, None: any will do."""
    thing = asked.deeds[0].things[0]
    found: str | None = None
    if thing.at and BURNER in kinds:
        found = _under(episode, thing, skills)
        if not found:
            yield refusal(RefusedRequest(kind="unclear", by="guard", words=(thing.text,)))
    elif _is_told(asked, thing, kinds) or left_aside(episode, asked, kinds, skills):
        found = yield from _the_one_told(episode, asked, thing, kinds, skills, came)
    elif thing.at or states_told(thing, kinds):  # "a clean plate": one that is so, or is made so
        found = next_known(episode, skills, list(kinds), set(), thing)
    if found is None and _is_one_of_some(asked):
        found, alike = _told_apart(episode, skills, kinds)
        if alike:
            yield refusal(RefusedRequest(kind="which", by="guard", words=alike))
            return ""
    if found is None and thing.other:
        found = yield from _the_other(episode, asked, kinds, skills, came)
    return found


def _is_told(asked: Request, thing: Mention, kinds: Collection[str]) -> bool:
    """Return whether words tell which thing is meant: where it is, or how it is by now.

    "A clean plate" and "the hot potato" may be made so; "the clean plate" is one that is.
    """
    made = _MADE_SO | {deed_kind(asked.deeds[0].deed).leaves}
    made |= set() if _is_definite(asked, thing) else {"clean", "cleaned", "empty"}
    return _lies_told(asked, thing) or bool({*states_told(thing, kinds)} - made)


def _is_definite(asked: Request, thing: Mention) -> bool:
    said = asked.whole[thing.start :].lower()
    return thing.start < 0 or said.startswith(("the ", "my ", "that ", "this "))


def _the_one_told(
    episode: Carrier, asked: Request, thing: Mention, kinds: Collection[str], skills: Skills,
    came: Came,
) -> Generator[Plan | SkillResult, None, str]:  # fmt: skip
    """Return the thing that is as it is told, looked for there and then anywhere; "" for none."""
    wholes = list(kinds)
    one = next_known(episode, skills, wholes, left_aside(episode, asked, kinds, skills), thing)
    places = [] if one else episode.places({kind_of(kind) for kind in thing.at})
    for place in places[:PLACES]:
        came.searched = True
        yield skills.run(SkillCall(skill="GoToObject", objects=(place,)))
        for sight in (one for one in [episode.sights(skills).get(place)] if one):
            yield skills.look_over(sight)
        one = next_known(episode, skills, wholes, left_aside(episode, asked, kinds, skills), thing)
        if one is not None:
            break
    while one is None:
        tried = {name for name in episode.sights(skills) if kind_of(name) in kinds}
        found = yield from another(skills, wholes, tried, came)
        if found is None and (one := _only_one(episode, asked, thing, kinds, skills)):
            where = " or ".join(told_place(kind) for kind in thing.at)
            came.told.append(Check(text=f"the {name_of(one)} was {where}", found="unseen"))
            return one
        if found is None:
            came.short = True
            where = " or ".join(spoken(kind).lower() for kind in thing.at)
            text = f"I found no {thing.text}{f' at the {where}' if where else ''}"
            came.told.append(Check(text=text, found="otherwise"))
            return ""
        one = next_known(episode, skills, wholes, left_aside(episode, asked, kinds, skills), thing)
    return one


def _only_one(
    episode: Carrier, asked: Request, thing: Mention, kinds: Collection[str], skills: Skills
) -> str:
    """Return the one thing there is that "from the desk" can be said of; "" for several."""
    comes_from = asked.whole[thing.end :].lower().lstrip().startswith("from ")
    if not comes_from or asked.deeds[0].deed in FOR_GOOD:
        return ""
    known = _alike(episode, skills, kinds, replace(thing, at=()))
    return known[0] if len(known) == 1 else ""


def left_aside(
    episode: Carrier, asked: Request, kinds: Collection[str], skills: Skills
) -> set[str]:
    """Return the ids of known things that a request leaves out: "but not the one on the desk"."""
    told = [one for one in asked.exclusions if one.at or one.states]
    return {
        name for name in episode.sights(skills) if kind_of(name) in kinds
        for one in told
        if kind_of(name) in map(kind_of, one.types) and told_so(episode, skills, name, one)
    }  # fmt: skip


def states_told(thing: Mention, kinds: Collection[str]) -> tuple[str, ...]:
    """Return the states that a thing is told by: "the empty roll", "the mug that is dirty"."""
    words = thing.text.lower().split()[:-1]
    said = [request_words().seen[word] for word in words if word in request_words().seen]
    ends = any(object_types()[kind].can("canBeUsedUp") for kind in kinds)
    states = (*said[:1], *thing.states)
    return tuple("used up" if one == "empty" and ends else one for one in states)


def is_all(states: Sequence[str], sight: SeenObject) -> bool:
    """Return whether a look shows a thing in all of some states."""
    return all(is_so(state, sight) for state in states)


def _under(episode: Carrier, thing: Mention, skills: Skills) -> str:
    """Return the burner under a thing that it is told by; "" where none is known."""
    wanted = {*map(kind_of, thing.at)}
    stands = (
        parent for sight in episode.sights(skills).values() if kind_of(sight.object_id) in wanted
        for parent in sight.parent_ids if kind_of(parent) == BURNER
    )  # fmt: skip
    return next(stands, "")


def _is_one_of_some(asked: Request) -> bool:
    """Return whether something is done for good to one thing that words say nothing else of."""
    deed = asked.deeds[0]
    thing = deed.things[0]
    bare = not (thing.at or thing.other or thing.told or thing.vague or thing.holding)
    bare = bare and not stated(asked)  # "the cooked one"
    return deed.deed in FOR_GOOD and bare and thing.start >= 0 and _is_definite(asked, thing)


def _told_apart(
    episode: Carrier, skills: Skills, kinds: Collection[str]
) -> tuple[str | None, tuple[str, ...]]:
    """Return the thing that was handled last, else in words those that fit alike: two or more."""
    seen = {
        name: one for name, one in episode.sights(skills).items()
        if kind_of(name) in kinds and not is_piece(one.object_type) and "sliced" not in one.states
    }  # fmt: skip
    last = next((one for one in reversed(episode.handled()) if one in seen), None)
    words = (f"the {name_of(name)} {told_place(place_of(one))}" for name, one in seen.items())
    places = tuple(dict.fromkeys(words))
    return last, places if last is None and len(places) > 1 else ()


def _lies_told(asked: Request, thing: Mention) -> bool:
    """Return whether the place behind a thing says which is meant, not where it is done to it."""
    deed, kinds = deed_kind(asked.deeds[0].deed), object_types()
    carried = any(kinds[kind].can("pickupable") or kind in LAMPS for kind in thing.types)
    done_at = {*map(kind_of, deed.put_in or deed_kind("wash").put_in)}
    relative = _is_relative(asked, thing)
    there = asked.deeds[0].deed in ("put", "take") or not done_at & {*map(kind_of, thing.at)}
    holds = any(kinds[place].can("receptacle") for place in thing.at)  # not "from the tap"
    return holds and carried and (relative or (there and not _goes_along(asked, thing)))


def _is_relative(asked: Request, thing: Mention) -> bool:
    return asked.whole[thing.end :].lower().lstrip().startswith(("that", "which"))


def _goes_along(asked: Request, thing: Mention) -> bool:
    """Return whether a thing may go in what is carried: "the watch in the bowl on the shelf"."""
    carries = any(object_types()[place].can("pickupable") for place in thing.at)
    return asked.deeds[0].place is not None and carries and not _is_relative(asked, thing)


def left_behind(
    episode: Carrier, asked: Request, kinds: Collection[str], skills: Skills
) -> list[Check]:
    """Return that nothing lies in what it was to go along in, where that is so."""
    thing = asked.deeds[0].things[0]
    sights = episode.sights(skills).values()
    along = (one for one in sights if kind_of(one.object_type) in kinds and _lies_at(one, thing.at))
    if not _goes_along(asked, thing) or any(along):
        return []
    return [Check(text=f"the {thing.text} is {told_place(thing.at[0])}", found="otherwise")]


def _the_other(
    episode: Carrier, asked: Request, kinds: Collection[str], skills: Skills, came: Came
) -> Generator[Plan | SkillResult, None, str | None]:
    """Return another thing than those that were meant before; "" for none, None: none was meant."""
    thing, whole = asked.deeds[0].things[0], asked.whole or asked.text
    meant = {one for (text, _), one in episode.chosen.items() if text == whole}
    meant = {one for one in (*meant, *episode.mine.values()) if kind_of(one) in kinds}
    pieces = thing.text.split()[-1] in request_words().pieces
    known = set() if pieces else {name for name in episode.sights(skills) if kind_of(name) in kinds}
    if not meant:  # "another book", said after one was put away
        meant = {one for one in episode.handled() if kind_of(one) in kinds}
        meant = {one for one in meant if holds_already(episode, skills, one, asked.deeds[0], {})}
    if not meant:  # "the other egg", "another mug": not the last one
        meant = meant_before(episode, thing, skills)
    if not meant:
        return None
    meant |= {name for name in known if root_id(name) in map(root_id, meant)}  # a cracked egg
    one = next_known(episode, skills, list(kinds), meant, thing)
    if one is None:
        one = yield from another(skills, list(kinds), meant, came)
    if one is None or one in meant:
        came.short = True
        came.told.append(
            Check(text=f"I found no other {thing.text.removeprefix('other ')}", found="otherwise")
        )
        return ""
    return one


def meant_before(episode: Carrier, thing: Mention, skills: Skills) -> set[str]:
    """Return what was handled last of a kind, which "the other egg" is not."""
    kinds = {kind_of(kind) for kind in meant_by(thing, episode.here(skills))}
    last = [one for one in episode.handled() if kind_of(one) in kinds]
    return {*(last or [one for one in episode.chosen.values() if kind_of(one) in kinds])[-1:]}


def next_known(
    episode: Carrier, skills: Skills, kinds: Sequence[str], tried: set[str], thing: Mention
) -> str | None:
    """Return a thing that is known and was not tried."""
    sights = sorted(episode.sights(skills))
    for one in (*sights, *_on_map(episode, kinds)):
        fresh = kind_of(type_of(one)) in kinds and type_of(one) != KNOB and one not in tried
        if fresh and told_so(episode, skills, one, thing):
            return one
    return None


def _on_map(episode: Carrier, kinds: Collection[str]) -> list[str]:
    """Return the ids of the furniture of some kinds, each whole once: no knobs, no basins."""
    return [one for one in episode.places(kinds) if type_of(one) in kinds]


def told_so(episode: Carrier, skills: Skills, object_id: str, thing: Mention) -> bool:
    """Return whether a thing is at the place, and in the states, that it is told by."""
    sights = episode.sights(skills)
    sight = sights.get(object_id)
    if thing.at and (sight is None or not _lies_at(sight, thing.at)):
        return False
    states = states_told(thing, [kind_of(object_id)])
    if "empty" in states and any(object_id in one.parent_ids for one in sights.values()):
        return False
    return not states or (sight is not None and is_all(states, sight))


def _lies_at(sight: SeenObject, places: Sequence[str]) -> bool:
    return any(kind_of(parent) in {*map(kind_of, places)} for parent in sight.parent_ids)


def holds_already(
    episode: Carrier,
    skills: Skills,
    object_id: str,
    deed: SaidDeed,
    own: Mapping[str, str],
) -> bool:
    """Return whether a deed would leave a thing as it is, by the agent's own eyes."""
    sight = episode.sights(skills).get(object_id)
    if sight is None or object_id in episode.told:  # so is only what its own eyes have seen
        return False
    if deed.deed == "put" and deed.place is not None and not deed.near:
        kinds = {kind_of(kind) for kind in deed.place.types}
        places = {own[kind] for kind in kinds if kind in own}
        return any(
            parent in places if places else kind_of(parent) in kinds for parent in sight.parent_ids
        )
    after = deed_kind(deed.deed).leaves
    return after in _SHOWS and bool(sight.states) and is_so(after, sight)


def is_so(state: str, sight: SeenObject) -> bool:
    """Return whether a look shows a thing in a state."""
    shown = _SHOWN_BY.get(state) or (OPPOSITES.get(state) if state in ("off", "closed") else None)
    if state == "unbroken" and is_piece(sight.object_type):
        return False
    return state in sight.states or (shown is not None and shown not in sight.states)


def another(
    skills: Skills, kinds: Sequence[str], tried: set[str], came: Came
) -> Generator[SkillResult, None, str | None]:
    """Search for one more thing of some kinds; returns its id, None if there is none."""
    came.searched = True
    for kind in kinds:
        known = any(kind_of(one) == kind for one in tried)
        if known and not object_types()[kind].can("pickupable"):
            continue  # a tour has shown what stands or hangs free
        result = skills.find_another(kind, tried)
        yield result
        fresh = [one for one in result.object_ids if kind_of(one) == kind and one not in tried]
        if result.ok and fresh:
            return fresh[0]
    return None


def of_kinds(episode: Carrier, skills: Skills, kinds: Collection[str]) -> list[SeenObject]:
    """Return what was seen of some kinds, wholes before their basins."""
    found = [one for one in episode.sights(skills).values() if kind_of(one.object_type) in kinds]
    basins = [one for one in found if one.object_type in BASINS]
    return sorted(basins or found, key=lambda one: one.object_id)
