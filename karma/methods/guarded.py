"""A request carried out as it was said.

Conditions are looked at first, every thing of a plural has its turn, and what was not done is told.
"""

from collections.abc import Collection, Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Protocol

from karma import registry
from karma.agent.guard import cannot_serve, here_of, meant_by, stated
from karma.agent.perceive import place_of
from karma.agent.reading import kind_of
from karma.agent.skills import Skills
from karma.contracts import (
    Check,
    Completion,
    Condition,
    Embedder,
    Experience,
    Found,
    Mention,
    Parser,
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
from karma.household.containment import has_door
from karma.household.deeds import FOR_GOOD, able_to, deed_kind
from karma.household.ids import root_id, type_of
from karma.household.pieces import is_piece
from karma.household.saying import name_of, spoken, told_place
from karma.household.states import ENDS, OPPOSITES, SAID_AS
from karma.household.types import object_types
from karma.household.uses import BASINS, BIN, BURNER, KNOB, LAMPS
from karma.language.clauses import context_left_out, said
from karma.language.lexicon import Lexicon
from karma.language.request import RequestReader
from karma.language.request_words import request_words
from karma.methods.attempts import Programs
from karma.methods.putting_back import put_back

_PUT = SaidDeed(verb="put", deed="put", start=-1)
_PLACES = 12  # of a kind that are looked over
_MADE_SO = frozenset(("heated", "cooled", "cooked", "sliced", "filled"))  # "the hot potato"
_IN_VAIN = 2  # things of a plural that may fail before the rest is left
_SWITCHED = (*LAMPS, "LightSwitch", "Television")  # "everything" that is switched off
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


@cache
def _parser() -> Parser:
    parser: Parser = registry.load("parsers", "spacy")()
    return parser


def reader_of(embedder: Embedder | None) -> RequestReader:
    """Return a reader of requests; the parser is loaded once a process."""
    return RequestReader(_parser(), Lexicon(embedder))


def joined(requests: Sequence[Request]) -> Request | None:
    """Return the sentences of one instruction as one request; None where nothing is said."""
    if not requests:
        return None
    requests = context_left_out(requests)
    errands = [one for one in requests if one.form == "errand"]
    if not errands or any(one.form in ("question", "incomplete") for one in requests):
        return next((one for one in requests if one.form != "errand"), requests[0])
    first = errands[0]
    return replace(
        first,
        errand=". ".join(one.errand for one in errands),
        deeds=tuple(deed for one in errands for deed in one.deeds),
        forbidden=tuple(deed for one in errands for deed in one.forbidden),
        exclusions=tuple(thing for one in errands for thing in one.exclusions),
        times=tuple(time for one in errands for time in one.times),
        conditions=tuple(one for errand in errands for one in errand.conditions),
        unread=tuple(word for one in errands for word in one.unread),
    )


def guarded(
    episode: Carrier, subtask: SubTask, asked: Request, skills: Skills, came: Came
) -> Iterator[Plan | SkillResult]:
    """Carry out what was asked, or say why it is not.

    Args:
        episode: plans and acts.
        subtask: the instruction.
        asked: what its words ask for.
        skills: the body.
        came: takes what came of it.
    """
    if subtask.asked is None:
        episode.decided.clear()
    refused = cannot_serve(asked, episode.here(skills)) or _not_told_apart(episode, asked, skills)
    if refused is not None:
        yield refusal(refused)
        return
    for condition in asked.conditions:
        holds = yield from _decided(episode, condition, skills, came)
        if holds is None:
            yield refusal(RefusedRequest(kind="condition", by="guard", words=(condition.text,)))
            return
        if not holds:
            came.nothing_to_do = True
            came.told.append(Check(text=f"{condition.text}: that is not so", found="seen"))
            return
    if subtask.asked is None:  # nobody cut it: it is planned without what is no errand
        subtask = replace(subtask, asked=asked, instruction=asked.errand or subtask.instruction)
    yield from _in_turn(episode, subtask, asked, skills, came)
    if came.tried:
        came.told += [
            Check(text=f"whether that is the {' '.join(one.marks)} one", found="unseen")
            for one in asked.mentions if one.marks
        ]  # fmt: skip
        for result in put_back(asked, skills):
            came.add(result)
            yield result


def _not_told_apart(episode: Carrier, asked: Request, skills: Skills) -> RefusedRequest | None:
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
        one.object_id for one in _of_kinds(episode, skills, wholes) if not is_piece(one.object_type)
    )
    known = dict.fromkeys((*seen, *_on_map(episode, wholes)))
    return [one for one in known if one not in sights or _told_so(episode, skills, one, thing)]


def _in_turn(
    episode: Carrier, subtask: SubTask, asked: Request, skills: Skills, came: Came
) -> Iterator[Plan | SkillResult]:
    """Do what was asked, each thing of a plural in its turn."""
    alone = len(asked.deeds) == 1 and len(asked.deeds[0].things) == 1
    if alone and _is_sought(asked.deeds[0]):
        yield from _find(episode, asked, skills, came)
    elif alone and _is_several(asked.deeds[0].things[0]):
        yield from _each(episode, subtask, asked, skills, came)
    elif [one.deed for one in asked.deeds] == ["go"]:
        yield from _go(episode, asked.deeds[0], skills, came)
    elif alone:
        yield from _the_same(episode, subtask, asked, skills, came)
    else:
        yield from episode.planned(subtask, skills, came, _own(episode, asked) or None)


def _own(episode: Carrier, asked: Request) -> dict[str, str]:
    """Return the things of one's own that a request means: kind -> id; "the other mug" is none."""
    single = (
        one for one in asked.mentions
        if not (_is_several(one) or one.other or one.at or one.told)
    )  # fmt: skip
    kinds = {kind_of(kind) for one in single for kind in one.types}
    return {kind: name for kind, name in episode.mine.items() if kind in kinds}


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


def _is_several(one: Mention) -> bool:
    return one.anything or one.every or (one.number or 1) > 1


def _is_sought(deed: SaidDeed) -> bool:
    """Return whether a deed is to find things, wherever they are."""
    thing = deed.things[0]
    return deed.deed == "find" and deed.place is None and not (thing.at or thing.anything)


def _find(
    episode: Carrier, asked: Request, skills: Skills, came: Came
) -> Iterator[Plan | SkillResult]:
    """Look for things, which takes no planner: of a plural for all that there are."""
    thing, found = asked.deeds[0].things[0], list[str]()
    came.searched = True
    wanted = None if thing.every else thing.number or 1
    while wanted is None or len(found) < wanted:
        one = yield from _one_more(episode, asked, {*found}, skills, came)
        if one is None or one in found:
            break
        found.append(one)
        if not object_types()[kind_of(type_of(one))].can("pickupable"):  # known by the map
            yield skills.run(SkillCall(skill="GoToObject", objects=(one,)))
        sight = episode.sights(skills).get(one)
        if sight is not None and not (sight.pickupable or has_door(sight.object_type)):
            yield skills.look_over(sight)
        where = told_place(place_of(sight)) if sight is not None and sight.pickupable else "here"
        came.told.append(Check(text=f"the {name_of(one)} is {where}", found="seen"))
    came.nothing_to_do, came.short = bool(found), len(found) < (wanted or 1)
    if came.short:
        more = f"more than {len(found)}: " if found else "no "
        came.told.append(Check(text=f"I found {more}{thing.text}", found="otherwise"))


def _go(
    episode: Carrier, deed: SaidDeed, skills: Skills, came: Came
) -> Iterator[Plan | SkillResult]:
    """Go to a thing, which takes no planner; nobody knows where "here" is."""
    goal = deed.place or next(iter(deed.things), None)
    kinds = [] if goal is None else [*map(kind_of, meant_by(goal, episode.here(skills)))]
    if goal is None or not kinds:
        yield refusal(RefusedRequest(kind="unclear", by="guard", words=(deed.verb,)))
        return
    came.searched = True
    for way in ("GoToObject", "Explore"):  # to what is known, else it is looked for
        result = skills.run(SkillCall(skill=way, objects=(kinds[0],)))
        yield result
        if result.ok:
            break
    came.nothing_to_do, came.short = result.ok, not result.ok
    found: Found = "seen" if result.ok else "otherwise"
    came.told.append(Check(text=f"I am at the {goal.text}", found=found))


def _the_same(
    episode: Carrier, subtask: SubTask, asked: Request, skills: Skills, came: Came
) -> Iterator[Plan | SkillResult]:
    """Do one deed to one thing: to the one that the same word meant before."""
    thing = asked.deeds[0].things[0]
    kinds = {kind_of(kind) for kind in meant_by(thing, episode.here(skills))}
    key = (asked.whole or asked.text, thing.start)
    own = _own(episode, asked)
    before = episode.chosen.get(key) or next((own[kind] for kind in kinds if kind in own), None)
    if before is None:
        before = yield from _told_apart_by_words(episode, asked, kinds, skills, came)
        if before == "":
            return
    before = before and _piece_of(episode.sights(skills), before)
    if before and _holds_already(episode, skills, before, asked.deeds[0], own):
        came.nothing_to_do = True
        came.told.append(Check(text=f"the {name_of(before)}: that is so already", found="seen"))
        return
    place = yield from _place_told(episode, asked, skills, came)
    if place is None:
        return
    own = {**own, **place}
    only = {**own, kind_of(before): before} if before and kind_of(before) in kinds else own
    if before and thing.other and len(kinds) > 1:  # "the other lamp"
        subtask = _of_one(subtask, asked, kind_of(before))
    yield from episode.planned(subtask, skills, came, only)
    for result in came.programs[-1].results if came.programs else ():
        used = [one for one in result.object_ids if kind_of(one) in kinds]
        if used and result.ok and thing.start >= 0:  # else "it" of an earlier text
            episode.chosen.setdefault(key, used[0])


def _place_told(
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


def _piece_of(sights: Collection[str], object_id: str) -> str:
    """Return a piece of a thing that has been cut since; the thing itself where it is whole."""
    pieces = (one for one in sorted(sights) if is_piece(type_of(one)) and root_id(one) == object_id)
    return next(pieces, object_id)


def _told_apart_by_words(
    episode: Carrier, asked: Request, kinds: Collection[str], skills: Skills, came: Came
) -> Generator[Plan | SkillResult, None, str | None]:
    """Return the one of several that words tell of; "" where none is, None: any will do."""
    thing = asked.deeds[0].things[0]
    found: str | None = None
    if thing.at and BURNER in kinds:
        found = _under(episode, thing, skills)
        if not found:
            yield refusal(RefusedRequest(kind="unclear", by="guard", words=(thing.text,)))
    elif _is_told(asked, thing, kinds) or _left_aside(episode, asked, kinds, skills):
        found = yield from _the_one_told(episode, asked, thing, kinds, skills, came)
    elif _states_told(thing, kinds):  # "a clean plate": one that is so already, or is made so
        found = _next(episode, skills, list(kinds), set(), thing)
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
    return _lies_told(asked, thing) or bool({*_states_told(thing, kinds)} - made)


def _is_definite(asked: Request, thing: Mention) -> bool:
    said = asked.whole[thing.start :].lower()
    return thing.start < 0 or said.startswith(("the ", "my ", "that ", "this "))


def _the_one_told(
    episode: Carrier, asked: Request, thing: Mention, kinds: Collection[str], skills: Skills,
    came: Came,
) -> Generator[Plan | SkillResult, None, str]:  # fmt: skip
    """Return the thing that is as it is told, looked for there and then anywhere; "" for none."""
    wholes = list(kinds)
    one = _next(episode, skills, wholes, _left_aside(episode, asked, kinds, skills), thing)
    places = [] if one else episode.places({kind_of(kind) for kind in thing.at})
    for place in places[:_PLACES]:
        came.searched = True
        yield skills.run(SkillCall(skill="GoToObject", objects=(place,)))
        for sight in (one for one in [episode.sights(skills).get(place)] if one):
            yield skills.look_over(sight)
        one = _next(episode, skills, wholes, _left_aside(episode, asked, kinds, skills), thing)
        if one is not None:
            break
    while one is None:
        tried = {name for name in episode.sights(skills) if kind_of(name) in kinds}
        found = yield from _another(skills, wholes, tried, came)
        if found is None:
            came.short = True
            where = " or ".join(spoken(kind).lower() for kind in thing.at)
            text = f"I found no {thing.text}{f' at the {where}' if where else ''}"
            came.told.append(Check(text=text, found="otherwise"))
            return ""
        one = _next(episode, skills, wholes, _left_aside(episode, asked, kinds, skills), thing)
    return one


def _left_aside(
    episode: Carrier, asked: Request, kinds: Collection[str], skills: Skills
) -> set[str]:
    """Return the ids of known things that a request leaves out: "but not the one on the desk"."""
    told = [one for one in asked.exclusions if one.at or one.states]
    return {
        name for name in episode.sights(skills) if kind_of(name) in kinds
        for one in told
        if kind_of(name) in map(kind_of, one.types) and _told_so(episode, skills, name, one)
    }  # fmt: skip


def _states_told(thing: Mention, kinds: Collection[str]) -> tuple[str, ...]:
    """Return the states that a thing is told by: "the empty roll", "the mug that is dirty"."""
    words = thing.text.lower().split()[:-1]
    said = [request_words().seen[word] for word in words if word in request_words().seen]
    fills = any(object_types()[kind].can("canFillWithLiquid") for kind in kinds)
    states = (*said[:1], *thing.states)
    return tuple("used up" if one == "empty" and not fills else one for one in states)


def _is_all(states: Sequence[str], sight: SeenObject) -> bool:
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
    done_at = {*map(kind_of, deed.put_in or deed_kind("wash").put_in)} - {BIN}
    relative = asked.whole[thing.end :].lower().lstrip().startswith(("that", "which"))
    there = asked.deeds[0].deed in ("put", "take") or not done_at & {*map(kind_of, thing.at)}
    return bool(thing.at) and carried and (there or relative)


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
        meant = {one for one in meant if _holds_already(episode, skills, one, asked.deeds[0], {})}
    if not meant:  # "the other egg", "another mug": not the last one
        meant = _meant_before(episode, thing, skills)
    if not meant:
        return None
    meant |= {name for name in known if root_id(name) in map(root_id, meant)}  # a cracked egg
    one = _next(episode, skills, list(kinds), meant, thing)
    if one is None:
        one = yield from _another(skills, list(kinds), meant, came)
    if one is None or one in meant:
        came.short = True
        came.told.append(
            Check(text=f"I found no other {thing.text.removeprefix('other ')}", found="otherwise")
        )
        return ""
    return one


def _meant_before(episode: Carrier, thing: Mention, skills: Skills) -> set[str]:
    """Return what was handled last of a kind, which "the other egg" is not."""
    kinds = {kind_of(kind) for kind in meant_by(thing, episode.here(skills))}
    last = [one for one in episode.handled() if kind_of(one) in kinds]
    return {*(last or [one for one in episode.chosen.values() if kind_of(one) in kinds])[-1:]}


def _each(
    episode: Carrier, subtask: SubTask, asked: Request, skills: Skills, came: Came
) -> Iterator[Plan | SkillResult]:
    """Do a deed to each thing of a plural: to those that are known, then to what is found."""
    deed, thing = asked.deeds[0], asked.deeds[0].things[0]
    kinds: list[str] = []
    found: list[str] = []
    if thing.anything:
        kinds, found = yield from _whatever(episode, deed, skills, came)
        kinds = _not_ruled_out(asked, kinds)
    place = yield from _place_told(episode, asked, skills, came)
    if place is None:
        return
    wanted = thing.number
    done: list[str] = []
    failed: list[str] = []
    others = _meant_before(episode, thing, skills) if thing.other else set()  # not as they are told
    while (wanted is None or len(done) < wanted) and len(failed) < _IN_VAIN:
        if done and deed.deed == "take" and not _is_taken_out(asked):
            came.told.append(Check(text="I can hold one thing at a time", found="otherwise"))
            came.short = True
            thing = replace(thing, number=len(found) or thing.number)
            break
        tried = {*done, *failed, *others}
        if thing.anything:
            rest = (one for one in found if one not in tried and kind_of(one) in kinds)
            one = next(rest, None)
        else:
            one = yield from _one_more(episode, asked, tried, skills, came)
        if one is None or one in tried:
            break
        told = thing.anything or _told_so(episode, skills, one, thing)
        if not told or _left_aside(episode, asked, [kind_of(one)], skills) & {one}:
            told = told or bool(thing.at or _states_told(thing, [kind_of(one)]))
            (others.add if told else failed.append)(one)
            continue
        if _holds_already(episode, skills, one, deed, {}):
            done.append(one)
            continue
        step = Came()
        single = _of_one(subtask, asked, kind_of(one))
        yield from episode.planned(single, skills, step, {**place, kind_of(one): one})
        came.programs += [program for program in step.programs if program.results]
        (done if step.finished else failed).append(one)
    if not (done or failed) and _is_ended(deed, thing):
        came.nothing_to_do = True
        said_so = SAID_AS.get(thing.states[0], thing.states[0])
        came.told.append(Check(text=f"nothing that I have seen is {said_so}", found="seen"))
        return
    _tell_count(came, thing, done, failed)


def _of_one(subtask: SubTask, asked: Request, kind: str) -> SubTask:
    """Return a request that is made of one thing of a type, as it is planned."""
    deed = asked.deeds[0]
    single = replace(
        deed.things[0], types=(kind,), text=spoken(kind).lower(), number=None, every=False,
        anything=False, at=(), states=(),
    )  # fmt: skip
    request = replace(asked, deeds=(replace(deed, things=(single,)),))
    text = said(request.deeds[0])
    return replace(subtask, instruction=text, whole=text, asked=request)


def _is_taken_out(asked: Request) -> bool:
    """Return whether things are only to leave a place: "take everything out of the fridge"."""
    me = request_words().me & {*asked.text.lower().split()}
    return bool(asked.deeds[0].things[0].at) and not me


def _is_ended(deed: SaidDeed, thing: Mention) -> bool:
    """Return whether a deed ends the state that its thing is told by: "close what is open"."""
    leaves = deed_kind(deed.deed).leaves
    ends = {ENDS.get(one, "empty" if one == "filled" else "") for one in thing.states}
    return bool(leaves) and leaves in ends


def _one_more(
    episode: Carrier, asked: Request, tried: set[str], skills: Skills, came: Came
) -> Generator[SkillResult, None, str | None]:
    """Return one more thing of a plural: one that is known, else one that is searched for."""
    thing = asked.deeds[0].things[0]
    kinds = _not_ruled_out(asked, meant_by(thing, episode.here(skills)))
    one = _next(episode, skills, kinds, tried, thing)
    if one is None and kinds:
        one = yield from _another(skills, kinds, tried, came)
        if one is None and not tried:  # no bottle, but a spray bottle was seen on the way
            kinds = _not_ruled_out(asked, meant_by(thing, episode.here(skills)))
            one = _next(episode, skills, kinds, tried, thing)
    return one


def _not_ruled_out(asked: Request, kinds: Iterable[str]) -> list[str]:
    """Return the kinds of wholes that a request does not leave out."""
    whole = (one for one in asked.exclusions if not (one.at or one.states))
    ruled_out = {kind_of(kind) for one in whole for kind in one.types}
    return [kind for kind in dict.fromkeys(map(kind_of, kinds)) if kind not in ruled_out]


def _tell_count(came: Came, thing: Mention, done: Sequence[str], failed: Sequence[str]) -> None:
    """Say of how many things it was done, and of which not."""
    wanted = thing.number if thing.number is not None else len(done) + len(failed)
    text = f"{len(done)} of {wanted}: {thing.text}"
    if thing.states:
        text += f" that I saw to be {SAID_AS.get(thing.states[0], thing.states[0])}"
    if failed and len(done) < wanted:
        text += f"; not the {', the '.join(map(name_of, failed))}"
    if len(done) < wanted or not done:
        came.short = True
        if not failed:
            text = f"{text}; I found no more" if done else f"I found none: {thing.text}"
        came.told.append(Check(text=text, found="otherwise"))
    else:
        came.nothing_to_do = came.nothing_to_do or not came.programs
        came.told.append(Check(text=text, found="seen"))


def _next(
    episode: Carrier, skills: Skills, kinds: Sequence[str], tried: set[str], thing: Mention
) -> str | None:
    """Return a thing that is known and was not tried."""
    sights = sorted(episode.sights(skills))
    for one in (*sights, *_on_map(episode, kinds)):
        fresh = kind_of(type_of(one)) in kinds and type_of(one) != KNOB and one not in tried
        if fresh and _told_so(episode, skills, one, thing):
            return one
    return None


def _on_map(episode: Carrier, kinds: Collection[str]) -> list[str]:
    """Return the ids of the furniture of some kinds, each whole once: no knobs, no basins."""
    return [one for one in episode.places(kinds) if type_of(one) in kinds]


def _told_so(episode: Carrier, skills: Skills, object_id: str, thing: Mention) -> bool:
    """Return whether a thing is at the place, and in the states, that it is told by."""
    sight = episode.sights(skills).get(object_id)
    if thing.at and (sight is None or not _lies_at(sight, thing.at)):
        return False
    states = _states_told(thing, [kind_of(object_id)])
    return not states or (sight is not None and _is_all(states, sight))


def _lies_at(sight: SeenObject, places: Sequence[str]) -> bool:
    return any(kind_of(parent) in {*map(kind_of, places)} for parent in sight.parent_ids)


def _holds_already(
    episode: Carrier,
    skills: Skills,
    object_id: str,
    deed: SaidDeed,
    own: Mapping[str, str],
) -> bool:
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


def _another(
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


def _whatever(
    episode: Carrier, deed: SaidDeed, skills: Skills, came: Came
) -> Generator[SkillResult, None, tuple[list[str], list[str]]]:
    """Look at a place, or everywhere; returns the kinds and ids of what is meant there."""
    thing = deed.things[0]
    came.searched = True
    if not thing.at and (thing.states or deed.deed in ("on", "off")):
        yield from skills.look_everywhere()
    if thing.states and not thing.at:
        return _all_that_are_so(episode, deed, skills)
    if deed.deed in ("on", "off") and not thing.at:
        here = episode.here(skills)
        kinds = [kind for kind in _SWITCHED if kind in here or kind == "LightSwitch"]
        there = [
            object_id for object_id, sight in sorted(episode.sights(skills).items())
            if kind_of(sight.object_type) in kinds
        ]  # fmt: skip
        return kinds, there
    places = {kind_of(kind) for kind in here_of(thing.at, episode.here(skills))}
    for name in episode.places(places)[:_PLACES] or sorted(places)[:1]:
        yield skills.run(SkillCall(skill="GoToObject", objects=(name,)))
    for sight in _of_kinds(episode, skills, places)[:_PLACES]:
        yield skills.look_over(sight)
    there = [
        sight.object_id for sight in episode.sights(skills).values()
        if {kind_of(parent) for parent in sight.parent_ids} & places
        and object_types()[sight.object_type].can("pickupable") and _is_all(thing.states, sight)
    ]  # fmt: skip
    there.sort()
    return sorted({kind_of(one) for one in there}), there


def _all_that_are_so(
    episode: Carrier, deed: SaidDeed, skills: Skills
) -> tuple[list[str], list[str]]:
    """Return kinds and ids of what was seen in the states that a thing is told by."""
    thing, takes = deed.things[0], deed_kind(deed.deed).takes
    found = [
        name for name, sight in sorted(episode.sights(skills).items())
        if sight.states and _is_all(thing.states, sight)
        and (takes is None or able_to(kind_of(name), takes))
    ]  # fmt: skip
    return sorted({*map(kind_of, found)}), found


def _of_kinds(episode: Carrier, skills: Skills, kinds: Collection[str]) -> list[SeenObject]:
    """Return what was seen of some kinds, wholes before their basins."""
    found = [one for one in episode.sights(skills).values() if kind_of(one.object_type) in kinds]
    basins = [one for one in found if one.object_type in BASINS]
    return sorted(basins or found, key=lambda one: one.object_id)


def _decided(
    episode: Carrier, condition: Condition, skills: Skills, came: Came
) -> Generator[SkillResult, None, bool | None]:
    """Look once for what is asked "if it is on" and "otherwise", whatever is done in between."""
    thing = condition.thing.types if condition.thing else ()
    key = (condition.state, *thing, "at", *condition.at)
    if key in episode.decided:
        return episode.decided[key] == condition.holds
    holds = yield from _looked_at(episode, condition, skills, came)
    if holds is not None:
        episode.decided[key] = holds == condition.holds
    return holds


def _looked_at(
    episode: Carrier, condition: Condition, skills: Skills, came: Came
) -> Generator[SkillResult, None, bool | None]:
    """Look whether a condition holds; returns None where that cannot be seen."""
    thing = condition.thing
    if thing is None or not condition.state:
        return None
    kinds = [kind_of(kind) for kind in meant_by(thing, episode.here(skills))]
    came.searched = True
    if condition.state == "there" and condition.at:
        for place in here_of(condition.at, episode.here(skills))[:1]:
            yield skills.run(SkillCall(skill="GoToObject", objects=(kind_of(place),)))
            skills.look_around()
        wanted = {kind_of(kind) for kind in condition.at}
        found = any(
            kind_of(sight.object_type) in kinds
            and any(kind_of(parent) in wanted for parent in sight.parent_ids)
            for sight in episode.sights(skills).values()
        )
        return found == condition.holds
    states: list[bool] = []
    for kind in kinds:
        result = skills.run(SkillCall(skill="Explore", objects=(kind,)))
        yield result
        ids = [one for one in result.object_ids if kind_of(one) == kind]
        sights = episode.sights(skills)
        sight = sights.get(ids[-1]) if ids else next(iter(_of_kinds(episode, skills, {kind})), None)
        if result.ok and sight is not None:
            states.append(is_so(condition.state, sight))
    if condition.state == "there":
        return bool(states) == condition.holds
    return any(states) == condition.holds if states else None
