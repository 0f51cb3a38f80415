"""Questions of the log: what was done and told, by whom and when, and what has changed since."""

from collections.abc import Sequence

from karma.assistant.replies import MemoryAnswer
from karma.assistant.session_log import TOLD, PastAction, PastRequest
from karma.household.uses import without_basin
from karma.plugins.rules.deeds import DEED_KINDS
from karma.plugins.rules.language.request import RequestReader
from karma.plugins.rules.language.request_words import base_of_deed
from karma.plugins.rules.talk.asking import AskedQuestion
from karma.plugins.rules.talk.history import (
    deeds_in,
    deeds_of,
    habits_in,
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


def _is_that(done: PastAction, asked: PastAction) -> bool:
    """Return whether a deed is one that is asked about: of its things, and at its place."""
    things = {*done.things} & {*asked.things}
    places = {*map(without_basin, done.places)} & {*map(without_basin, asked.places)}
    return done.deed == asked.deed and bool(things) and bool(places or not asked.places)
