"""Refusals of a request by a planner: the unknown phrases, and refusals that are wrong.

The words for people are in `refusal_text`; refusals of a skill by the world in
`karma.agent.body.refusals`.
"""

from dataclasses import replace

from karma.household.places import OVERLOOKED, landmark_types
from karma.household.saying import spoken
from karma.household.types import object_types
from karma.language.hints import bare_words, singular
from karma.language.phrases import phrases_of
from karma.types.planning import Hint, PlanRequest, RefusedRequest

NEAR = 0.6  # cosine from which on a phrase has a meaning here
KNOWN = "known, so the request is not refused for that"  # ends the reason why a refusal is wrong


def with_words(refused: RefusedRequest, request: PlanRequest) -> RefusedRequest:
    """Return a refusal with the phrases of the request that are far from all known meanings."""
    deeds = refused.kind == "deed"
    far = [hint for hint in request.hints if _is_deed(hint) == deeds and nearness(hint) < NEAR]
    return replace(refused, words=tuple(hint.phrase for hint in far))


def cannot_be(refused: RefusedRequest, request: PlanRequest) -> str:
    """Return why a refusal is wrong, or "": every object that the request names is known.

    Each name has to be that of a type, and furniture has to be on the map.
    """
    named = [singular(" ".join(bare_words(one.text.lower().split())))
             for one in phrases_of(request.instruction).nouns]  # fmt: skip
    here = {kind for area in request.areas for kind in area.contains}
    away = landmark_types() - here - OVERLOOKED if here else frozenset()
    known = {word for kind in object_types() if kind not in away
             for word in (kind.lower(), spoken(kind).lower())}  # fmt: skip
    if refused.kind not in ("thing", "place") or not named or not known.issuperset(named):
        return ""
    return f"{' and '.join(dict.fromkeys(named))}: {KNOWN}"


def nearness(hint: Hint) -> float:
    """Return how near a phrase is to its nearest meaning; 0 where it has none."""
    return max((meaning.similarity for meaning in hint.meanings), default=0.0)


def _is_deed(hint: Hint) -> bool:
    return not any(meaning.name in object_types() for meaning in hint.meanings)
