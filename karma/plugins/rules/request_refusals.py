"""How likely a request is to be refused, and what in it was not understood.

Refusals of a skill by the world are in `refusals`; the words for people in
`karma.agent.planning.refusal_text`.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import msgspec

from karma.contracts import Certainty, Completion, Hint, PlanRequest, RefusalKind, RefusedRequest
from karma.files import read_json
from karma.household.places import OVERLOOKED, landmark_types
from karma.household.saying import spoken
from karma.household.types import object_types
from karma.language.hints import bare_words, singular
from karma.language.phrases import phrases_of

NEAR = 0.6  # cosine from which on a phrase has a meaning here
KNOWN = "known, so the request is not refused for that"  # ends why a refusal cannot be


def with_words(refused: RefusedRequest, request: PlanRequest) -> RefusedRequest:
    """Return a refusal with the phrases of the request that no meaning here is near to."""
    deeds = refused.kind == "deed"
    far = [hint for hint in request.hints if _is_deed(hint) == deeds and nearness(hint) < NEAR]
    return replace(refused, words=tuple(hint.phrase for hint in far))


def cannot_be(refused: RefusedRequest, request: PlanRequest) -> str:
    """Return why a refusal is none: "I know of no such thing" of things that are known; else "".

    All that the request names has to be a type by its name, and furniture to be on the map.
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


def doubted(request: PlanRequest) -> RefusedRequest:
    """Return the refusal of a request that was answered, but not surely enough."""
    far = [hint for hint in request.hints if nearness(hint) < NEAR]
    kind: RefusalKind = "unclear"
    if far:
        kind = "deed" if all(map(_is_deed, far)) else "thing"
    return RefusedRequest(kind=kind, by="doubt")


def nearness(hint: Hint) -> float:
    """Return how near a phrase is to its nearest meaning; 0 where it has none."""
    return max((meaning.similarity for meaning in hint.meanings), default=0.0)


def _is_deed(hint: Hint) -> bool:
    return not any(meaning.name in object_types() for meaning in hint.meanings)


_LEAST = 1e-5  # chances are taken as this far from 0 and 1 at least
Feature = Callable[[Certainty, PlanRequest], float]


def _refusing(certainty: Certainty, _: PlanRequest) -> float:
    """Return the log-odds that the planner would refuse."""
    chance = min(max(certainty.refusing or 0.0, _LEAST), 1 - _LEAST)
    return math.log(chance / (1 - chance))


def far_words(request: PlanRequest) -> float:
    """Return the share of a request's words that stand in phrases which the planner has not learnt.

    >>> far_words(PlanRequest(instruction="put it there"))
    0.0
    """
    words = len(request.instruction.split())
    far = sum(len(hint.phrase.split()) for hint in request.hints)
    return min(far / words, 1.0) if words else 0.0


def weakest_hint(request: PlanRequest) -> float:
    """Return how near the phrase is that is farthest from any meaning; 1 where all are known."""
    return min(map(nearness, request.hints), default=1.0)


FEATURES: Mapping[str, Feature] = {
    "refusing": _refusing,
    "mean_logprob": lambda certainty, _: certainty.mean_logprob,
    "least_logprob": lambda certainty, _: certainty.least_logprob,
    "weakest_hint": lambda _, request: weakest_hint(request),
    "far_words": lambda _, request: far_words(request),
}


class LogisticDoubt(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How likely it is that a request should be refused: a logistic regression.

    Over a few figures of the planner's first answer. Coefficients and threshold are data beside the
    weights that they were fitted for (their cards name the commit).
    """

    coefficients: dict[str, float]
    intercept: float
    threshold: float  # a probability
    fitted_on: str  # what, with how many requests

    def __post_init__(self) -> None:
        """Refuse a feature that there is not, and a threshold that is no probability."""
        if unknown := sorted(set(self.coefficients) - set(FEATURES)):
            raise ValueError(f"there is no feature {unknown[0]!r}; known: {', '.join(FEATURES)}")
        if not 0 <= self.threshold <= 1:
            raise ValueError(f"threshold = {self.threshold} is no probability")

    def of(self, completion: Completion, request: PlanRequest) -> float | None:
        """Return the probability that a request should be refused; None where nothing tells."""
        certainty = completion.certainty
        if certainty is None or certainty.refusing is None:
            return None
        total = self.intercept + sum(
            factor * FEATURES[name](certainty, request)
            for name, factor in sorted(self.coefficients.items())
        )
        return round(1 / (1 + math.exp(-max(min(total, 50.0), -50.0))), 6)


def read_doubt(path: Path) -> LogisticDoubt:
    """Read a doubt; FileError where the file is torn, or names a feature that there is not."""
    return read_json(path, LogisticDoubt)
