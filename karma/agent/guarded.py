"""A request carried out as it was said.

Conditions are looked at first, every thing of a plural has its turn, and what was not done is told.
"""

from collections.abc import Collection, Generator, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cache

from karma import registry
from karma.agent.body.skills import Skills
from karma.agent.planning.guard import cannot_serve, here_of, meant_by
from karma.agent.planning.reading import kind_of
from karma.agent.putting_back import put_back
from karma.agent.seeing.perceive import place_of
from karma.agent.which_thing import (
    PLACES,
    Came,
    Carrier,
    another,
    holds_already,
    is_all,
    is_so,
    left_aside,
    left_behind,
    meant_before,
    next_known,
    not_told_apart,
    of_kinds,
    place_told,
    refusal,
    states_told,
    told_apart_by_words,
    told_so,
)
from karma.contracts import (
    Check,
    Condition,
    Embedder,
    Found,
    Mention,
    Parser,
    Plan,
    RefusedRequest,
    Request,
    SaidDeed,
    SkillCall,
    SkillResult,
    SubTask,
)
from karma.household.containment import has_door
from karma.household.deeds import able_to, deed_kind
from karma.household.ids import root_id, type_of
from karma.household.pieces import is_piece
from karma.household.saying import name_of, spoken, told_place
from karma.household.states import ENDS, SAID_AS
from karma.household.types import object_types
from karma.household.uses import LAMPS
from karma.language.clauses import context_left_out, said
from karma.language.lexicon import Lexicon
from karma.language.request import RequestReader
from karma.language.request_words import request_words

_IN_VAIN = 2  # things of a plural that may fail before the rest is left
_SWITCHED = (*LAMPS, "LightSwitch", "Television")  # "everything" that is switched off


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
    """Carry out what was asked, or say why it is not."""
    if subtask.asked is None:
        episode.decided.clear()
    refused = cannot_serve(asked, episode.here(skills)) or not_told_apart(episode, asked, skills)
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
        before = yield from told_apart_by_words(episode, asked, kinds, skills, came)
        if before == "":
            return
    before = before and _piece_of(episode.sights(skills), before)
    if before and holds_already(episode, skills, before, asked.deeds[0], own):
        came.nothing_to_do = True
        came.told.append(Check(text=f"the {name_of(before)}: that is so already", found="seen"))
        return
    place = yield from place_told(episode, asked, skills, came)
    if place is None:
        return
    own = {**own, **place}
    only = {**own, kind_of(before): before} if before and kind_of(before) in kinds else own
    if before and thing.other and len(kinds) > 1:  # "the other lamp"
        subtask = _of_one(subtask, asked, kind_of(before))
    yield from episode.planned(subtask, skills, came, only)
    came.told += left_behind(episode, asked, kinds, skills)
    for result in came.programs[-1].results if came.programs else ():
        used = [one for one in result.object_ids if kind_of(one) in kinds]
        if used and result.ok and thing.start >= 0:  # else "it" of an earlier text
            episode.chosen.setdefault(key, used[0])


def _piece_of(sights: Collection[str], object_id: str) -> str:
    """Return a piece of a thing that has been cut since; the thing itself where it is whole."""
    pieces = (one for one in sorted(sights) if is_piece(type_of(one)) and root_id(one) == object_id)
    return next(pieces, object_id)


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
    place = yield from place_told(episode, asked, skills, came)
    if place is None:
        return
    wanted = thing.number
    done: list[str] = []
    failed: list[str] = []
    others = meant_before(episode, thing, skills) if thing.other else set()  # not as they are told
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
        told = thing.anything or told_so(episode, skills, one, thing)
        if not told or left_aside(episode, asked, [kind_of(one)], skills) & {one}:
            told = told or bool(thing.at or states_told(thing, [kind_of(one)]))
            (others.add if told else failed.append)(one)
            continue
        if holds_already(episode, skills, one, deed, {}):
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
    one = next_known(episode, skills, kinds, tried, thing)
    if one is None and kinds:
        one = yield from another(skills, kinds, tried, came)
        if one is None and not tried:  # no bottle, but a spray bottle was seen on the way
            kinds = _not_ruled_out(asked, meant_by(thing, episode.here(skills)))
            one = next_known(episode, skills, kinds, tried, thing)
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
    for name in episode.places(places)[:PLACES] or sorted(places)[:1]:
        yield skills.run(SkillCall(skill="GoToObject", objects=(name,)))
    for sight in of_kinds(episode, skills, places)[:PLACES]:
        yield skills.look_over(sight)
    there = [
        sight.object_id for sight in episode.sights(skills).values()
        if {kind_of(parent) for parent in sight.parent_ids} & places
        and object_types()[sight.object_type].can("pickupable") and is_all(thing.states, sight)
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
        if sight.states and is_all(thing.states, sight)
        and (takes is None or able_to(kind_of(name), takes))
    ]  # fmt: skip
    return sorted({*map(kind_of, found)}), found


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
        sight = sights.get(ids[-1]) if ids else next(iter(of_kinds(episode, skills, {kind})), None)
        if result.ok and sight is not None:
            states.append(is_so(condition.state, sight))
    if condition.state == "there":
        return bool(states) == condition.holds
    return any(states) == condition.holds if states else None
