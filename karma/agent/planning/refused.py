"""Refusals of a request: wrong ones, the phrases they are about, and their words for people.

Refusals of a skill by the world are in `karma.agent.body.refusals`.
"""

from collections.abc import Mapping
from dataclasses import replace

from karma.household.places import OVERLOOKED, landmark_types
from karma.household.saying import spoken
from karma.household.types import object_types
from karma.types.planning import PlanRequest, RefusalKind, RefusedRequest

NEAR = 0.6  # cosine from which on a phrase has a meaning here
KNOWN = "known, so the request is not refused for that"  # ends the reason why a refusal is wrong


def with_words(refused: RefusedRequest, request: PlanRequest) -> RefusedRequest:
    """Return a refusal with the phrases of the request that are far from all known meanings."""
    types, of_actions = object_types(), refused.kind == "deed"
    far = (
        hint.phrase
        for hint in request.hints
        if all(meaning.similarity < NEAR for meaning in hint.meanings)
        and of_actions != any(meaning.name in types for meaning in hint.meanings)
    )
    return replace(refused, words=tuple(far))


def cannot_be(refused: RefusedRequest, request: PlanRequest) -> str:
    """Return why a refusal is wrong, or "": every object that the request mentions is known.

    Each has to be an object type, and furniture has to be on the map.
    """
    objects, here = request.objects, {kind for area in request.areas for kind in area.contains}
    away = landmark_types() - here - OVERLOOKED if here else frozenset()
    known = {word for kind in object_types() if kind not in away
             for word in (kind.lower(), spoken(kind).lower())}  # fmt: skip
    if refused.kind not in ("thing", "place") or not objects or not known.issuperset(objects):
        return ""
    return f"{' and '.join(objects)}: {KNOWN}"


# ----------------------------------------------------------------- words for people

_WITH_WORDS: Mapping[RefusalKind, str] = {
    "deed": "I have no skill for {words}.",
    "thing": "I know of no {words} in a home.",
    "place": "I know of no {words} in this home.",
    "impossible": "That cannot be done: {words}.",
    "unclear": "I am not sure what is meant by {words}.",
    "time": "I cannot wait: {words}. I do things at once or not at all.",
    "condition": "I cannot tell whether that is so: {words}.",
    "alike": "I know of more than one, and cannot tell which is meant by {words}.",
}
_ALONE: Mapping[RefusalKind, str] = {
    "deed": "I have no skill for that.",
    "thing": "I know of no such thing in a home.",
    "place": "I know of no such place in this home.",
    "language": "I understand English only, and could not read this.",
    "negated": "That says only what not to do, so I do nothing.",
    "impossible": "That cannot be done with these things, or would do harm.",
    "unclear": "I am not sure what is meant.",
    "time": "I cannot wait; I do things at once or not at all.",
    "condition": "I cannot tell whether that is so.",
    "question": "That is a question; I do nothing for one, and cannot answer it yet.",
    "statement": "That asks for nothing, and I have kept nothing of it.",
    "incomplete": "Something is missing.",
    "astray": "I would not have done what was said.",
    "which": "That cannot be taken back, and I know of more than one.",
    "alike": "I know of more than one, and cannot tell which is meant.",
}


def sentence(refused: RefusedRequest) -> str:
    """Return the sentence that tells a person why a request is not carried out.

    >>> sentence(RefusedRequest(kind="thing", words=("hammer",)))
    "I know of no 'hammer' in a home."
    """
    if refused.kind == "astray":
        return f"I would not have done what was said: {', '.join(refused.words)}."
    if refused.kind == "which":
        return f"That cannot be taken back, and I know of {' and '.join(refused.words)}."
    if refused.kind == "place" and refused.by == "guard":
        return f"There is no {refused.words[0]!r} here that I know of."
    form = _WITH_WORDS.get(refused.kind) if refused.words else None
    if form is None:
        return _ALONE[refused.kind]
    quoted = refused.words if refused.by == "inspector" else map(repr, refused.words)
    return form.format(words=" or ".join(quoted))
