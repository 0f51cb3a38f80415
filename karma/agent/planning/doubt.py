"""How likely it is that a request should be refused, by its answer's chances and its own words.

A logistic regression over a few figures of the planner's first answer. Its coefficients and the
threshold are data beside the weights that they were fitted for (`scripts/calibrate_doubt.py`).
"""

import math
from collections.abc import Callable, Mapping
from pathlib import Path

import msgspec

from karma.agent.planning.refused_requests import nearness
from karma.contracts import Certainty, Completion, PlanRequest
from karma.files import read_json

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
    """Coefficients by feature, and from where on a request is refused."""

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
    """Read coefficients and threshold.

    Raises:
        FileError: the file is missing or torn, or names a feature that there is not.
    """
    return read_json(path, LogisticDoubt)
