"""Questions of the log: what was done and told, by whom and when, and what has changed since."""

from collections import Counter
from collections.abc import Sequence

from karma.agent.journal.formats import plural
from karma.agent.seeing.perceive import place_of
from karma.assistant.replies import MemoryAnswer
from karma.assistant.session_log import TOLD, PastAction, PastRequest
from karma.household.containment import has_door
from karma.household.deeds import DEED_KINDS
from karma.household.ids import type_of
from karma.household.pieces import base_type
from karma.household.places import HAND
from karma.household.saying import name_of, told_place
from karma.household.uses import without_basin
from karma.plugins.rules.language.request import RequestReader
from karma.plugins.rules.language.request_words import base_of_deed, deed_verbs
from karma.plugins.rules.talk.asking import AskedQuestion
from karma.plugins.rules.talk.history import (
    Move,
    deeds_in,
    deeds_of,
    done_to,
    habits_in,
    looked_into,
    moves,
)
from karma.plugins.rules.talk.remembering import MOST, answer, unknown


def what_it_can(q: AskedQuestion) -> MemoryAnswer | None:
    """Answer "what can you do?" and "who are you?"."""
    asks = q.says(
        r"\b(?:can|could) you (?:all )?do\b|\byou able to do\b|^(?:who|what) are you\b(?! \w)"
    )
    if not asks or q.asks not in ("what", "who") or q.things:
        return None
    deeds = ", ".join(kind.said for kind in DEED_KINDS.values() if kind.said and kind.takes)
    can = f"I look after this room. I can put things somewhere, {deeds}."
    tells = "Ask me where something is, how it is or what I did; tell me what I should know."
    return answer(can, tells)


def what_was_done(q: AskedQuestion) -> MemoryAnswer | None:
    """Answer "what did you do yesterday?", "what did I ask you to do?", "what went wrong?"."""
    all_of_it = q.asks == "what" or q.has("anything", "something")
    failed = q.has("'t", "not", "failed") or q.says(r"\bwent wrong\b")
    did = q.has("did", "done") or q.says(r"\b(?:you|we|i)\b.* do\b|\bwent wrong\b")
    if not (all_of_it and did and (q.has("you", "i", "we") or failed)):
        return None
    if q.things or (q.has("here") and q.has("see", "seen")):
        return None
    rest = _words_of_the_deed(q)
    if (
        q.has("anything", "something")
        and rest
        and (deed := deed_verbs().get(base_of_deed(rest[0]) or ""))
    ):
        names = done_to([one for one in q.knows.past if q.then(one.at_s)], deed, q.reader)
        told = dict.fromkeys(f"the {name_of(name)}" for name in names)
        return answer(f"Yes: {', '.join(told)}." if told else "No, not that I remember.")
    past = [
        f"{q.knows.ago(one.at_s)}: {one.plain or one.said} ({one.status})"
        for one in q.knows.past
        if one.status not in TOLD and q.then(one.at_s) and not (failed and one.status == "done")
    ]
    if not past and failed:
        return answer("Nothing that I know of.")
    if not past:
        return answer("Nothing then." if q.knows.past else "Nothing yet.")
    if q.has("first", "just"):
        return answer(past[0 if q.has("first") else -1], *q.of_no_time)
    left = len(past) - MOST
    more = (f"and {left} before that",) if left > 0 else ()
    return answer(*reversed(past[-MOST:]), *more, *q.of_no_time)


def what_was_told(q: AskedQuestion) -> MemoryAnswer | None:
    """Answer "what did I tell you about the apple?" and "did I tell you where it is?"."""
    if not q.says(r"\bi (?:ever |just |already )?(?:tell|told|teach|taught)\b"):
        return None
    kinds = {kind for one in q.things for kind in one.types}
    lines = [
        f"{q.knows.ago(one.at_s).capitalize()}: {one.said.rstrip('.!')}."
        for one in q.knows.past
        if (one.status in TOLD or habits_in(one.said, q.reader)) and q.then(one.at_s)
        if not kinds or kinds & _spoken_of(one.said, q.reader)
    ]
    return answer(*reversed(lines[-MOST:])) if lines else unknown("Nothing that I remember.")


def _spoken_of(text: str, reader: RequestReader) -> set[str]:
    named = (one for asked in reader.read(text) for one in (*asked.alone, *asked.mentions))
    return {kind for one in named for kind in one.types}


def whether_it_was_done(q: AskedQuestion) -> MemoryAnswer | None:
    """Answer "did you wash the apple?", "when did you?", "why did you?"."""
    if q.asks not in ("", "when", "why") or not q.has("did", "have", "has") or q.has("see", "seen"):
        return None
    if q.has("leave", "left") and q.state:
        return None
    rest = _words_of_the_deed(q)
    return _whether_i_did(q, rest) if rest and (q.things or q.unknown) else None


def how_often(q: AskedQuestion) -> MemoryAnswer | None:
    """Answer "how often did you open the fridge?" and "how many times did you?"."""
    if q.asks != "how" or not (q.has("often") or q.says(r"\bhow many times\b")):
        return None
    if not q.has("you"):  # what others do is not in the log
        return None
    rest = _words_of_the_deed(q)
    past = _that_was_done(q, rest) if rest and q.things else None
    if past is None:
        return None
    done = [errand for errand, deeds in past if any(one.done for one in deeds)]
    if not done:
        return answer("Never, that I remember.")
    last = f"{q.knows.ago(done[0].at_s)}: {done[0].plain or done[0].said}"
    return answer(f"{plural(len(done), 'time')} that I remember, the last {last}.")


def _words_of_the_deed(q: AskedQuestion) -> list[str]:
    """Return the words after "you": what somebody is asked to have done."""
    at = next((n for n, word in enumerate(q.words) if word in ("you", "i", "we")), len(q.words))
    return [word for word in q.words[at + 1 :] if word not in ("last", "ever", "already", "yet")]


def _that_was_done(
    q: AskedQuestion, rest: Sequence[str]
) -> list[tuple[PastRequest, list[PastAction]]] | None:
    """Return past errands, the last first, with the deeds that some words ask for.

    None where the words ask for nothing.
    """
    order = " ".join([base_of_deed(rest[0]) or rest[0], *rest[1:]])
    read = q.reader.read(order, q.things)
    asked = [one for request in read for one in deeds_of(request, (), done=True)]
    if not asked:
        return None
    found = []
    for past in (one for one in reversed(q.knows.past) if q.then(one.at_s)):
        known = deeds_in(past, q.reader)
        those = [one for one in known if any(_is_that(one, other) for other in asked)]
        found += [(past, those)] if those else []
    return found


def _whether_i_did(q: AskedQuestion, rest: Sequence[str]) -> MemoryAnswer | None:
    """Tell whether the agent has done what some words ask for: "washed", "the", "apple"."""
    those = _that_was_done(q, rest)
    if those is None:
        return None
    if those:
        past, found = those[0]
        when, said = q.knows.ago(past.at_s), past.plain or past.said
        if not any(one.done for one in found):
            return answer(f"I tried {when}, and it came out {past.status}: {said}.")
        why = f"You asked for it {when}"
        how = {"when": when.capitalize(), "why": why}
        return answer(f"{how.get(q.asks, f'Yes, {when}')}: {said}.")
    return answer("No, not that I remember.")


def what_changed(q: AskedQuestion) -> MemoryAnswer | None:
    """Tell of each thing that was moved where it was and where it is, the last one first."""
    asks = q.asks == "what" or q.has("anything", "something")
    if not asks or not q.has("changed", "change", "different", "moved") or q.things:
        return None
    known = [one for one in moves(q.knows.past) if q.then(one.at_s)]
    last = {one.object_id: one for one in known}
    if not last:
        return answer("Nothing that I have seen.", *q.of_no_time)
    first: dict[str, Move] = {}
    for one in known:
        first.setdefault(one.object_id, one)
    told = sorted(last.values(), key=lambda one: -one.at_s)
    lines = [
        f"The {name_of(one.object_id)} went {_way(first[one.object_id].before, one.after)}, "
        f"{q.knows.ago(one.at_s)}: {_by(one)}."
        for one in told
        if first[one.object_id].before != one.after
    ]
    more = (f"and {len(lines) - MOST} more",) if len(lines) > MOST else ()
    again = ", the ".join(name_of(one.object_id) for one in told[:MOST])
    lasted = f"Nothing that lasted: where it was before is the {again}."
    return answer(*((*lines[:MOST], *more) or (lasted,)), *q.of_no_time)


def _by(one: Move) -> str:
    if one.told:
        return "so you told me"
    return f'I did it when you said "{one.said}"' if one.said else "somebody did, not I"


def _way(before: str, after: str | None) -> str:
    start, end = _place_words(before), _place_words(after)
    return f"from one {name_of(before)} to another" if start == end else f"from {start} to {end}"


def _place_words(place: str | None) -> str:
    if place == HAND:
        return "my hand"
    return f"the {name_of(place)}" if place else "somewhere"


def how_long(q: AskedQuestion) -> MemoryAnswer | None:
    """Answer "how long did that take?" of the last errand."""
    if not q.says(r"^how long (?:did (?:it|that|this) take|has (?:it|that|this) taken)\b"):
        return None
    last = next((one for one in reversed(q.knows.past) if one.status not in TOLD), None)
    if last is None:
        return answer("Nothing yet.")
    steps = plural(len(last.actions), "step")
    return answer(f"{steps}, a second each by the home's clock: {last.plain or last.said}.")


def which_it_was_done_to(q: AskedQuestion) -> MemoryAnswer | None:
    """Answer "which mug did you wash?" and "which drawers did you open?"."""
    rest = _words_of_the_deed(q)
    deed = deed_verbs().get(base_of_deed(rest[0]) or "", "") if rest else ""
    asks = q.asks == "which" and q.has("did", "have") and q.has("you") and len(q.things) == 1
    if not (asks and deed):
        return None
    done = _done_to(q, deed, rest)
    if not done:
        return answer("None that I remember.")
    lines = [f"The {name_of(name)}{_now(q, name)}, {q.knows.ago(at_s)}." for name, at_s in done]
    if len(done) > 1 and len(set(lines)) == 1:  # no words tell them apart
        return answer(f"{plural(len(done), name_of(done[0][0]))}, {q.knows.ago(done[0][1])}.")
    return answer(*lines[:MOST])


def _done_to(q: AskedQuestion, deed: str, rest: Sequence[str]) -> list[tuple[str, float]]:
    """Return the things of the asked kind that a deed was done to, and when, the last first."""
    order = [base_of_deed(rest[0]) or rest[0], "the", q.things[0].text, *rest[1:]]
    known = _that_was_done(q, order) or ()
    asked = [errand for errand, deeds in known if any(one.done for one in deeds)]
    past = [
        one for one in q.knows.past if q.then(one.at_s) and (deed == "open" or one in asked)
    ]  # a search opens, too
    done = done_to(past, deed, q.reader).items()
    return [one for one in done if base_type(type_of(one[0])) in q.things[0].types][::-1]


def _now(q: AskedQuestion, name: str) -> str:
    """Return where a thing that can be carried is by now, in words; "" for any other."""
    sight = q.knows.sights.get(name)
    if sight is None or not sight[0].pickupable:
        return ""
    return f" that is now {told_place(place_of(sight[0]))}"


def whether_all_is_shut(q: AskedQuestion) -> MemoryAnswer | None:
    """Answer "did you close everything you opened?"."""
    asks = q.first in ("did", "have") and q.open and q.has("you")
    if not (asks and q.has("close", "closed", "shut") and q.has("opened", "open")) or q.things:
        return None
    sights = (q.knows.sights.get(name) for name in sorted(looked_into(q.knows.past)))
    opened = [one[0] for one in sights if one is not None]
    left = [one.object_id for one in opened if "opened" in one.states]  # as it was seen last
    if not opened:
        return answer("I have opened nothing.")
    if not left:
        return answer(f"Yes, all that I opened ({len(opened)}).")
    return answer(f"No: I left open the {', the '.join(map(name_of, left))}.")


def not_looked_into(q: AskedQuestion) -> MemoryAnswer | None:
    """Answer "what have you not seen?": what has a door, and was not opened."""
    if not (q.has("not", "'t", "never") and q.has("seen", "see", "looked", "searched")) or q.things:
        return None
    into = looked_into(q.knows.past)
    shut = [name for name in q.knows.sights if has_door(type_of(name)) and name not in into]
    if not shut:
        return answer("I have looked into all that has a door and that I know of.")
    counts = Counter(name_of(name) for name in sorted(shut))
    told = ", ".join(plural(count, name) for name, count in counts.items())
    return answer(f"I have not looked into {len(shut)} places: {told}.")


def _is_that(done: PastAction, asked: PastAction) -> bool:
    """Return whether a deed is one that is asked about: of its things, and at its place."""
    things = {*done.things} & {*asked.things}
    places = {*map(without_basin, done.places)} & {*map(without_basin, asked.places)}
    return done.deed == asked.deed and bool(things) and bool(places or not asked.places)
