"""What a planner gets right: goal sentences that it reads, and requests that it has to refuse.

How often it reads a human goal sentence right is told by five facts, read off its program by rule.
Short human sentences come twice: many of a split that is called unseen stand word for word in the
training split too. They are counted apart, and the figure to go by is that of the others.

When to refuse: doubt fitted on requests that training has not, and how far it can be trusted.

Half of the requests are to be refused and half to be done. They are drawn, so they are not those of
`eval/requests`, which nothing is fitted on. Figures are cross-validated: every request is judged by
coefficients that were fitted without its fold.
"""

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from karma.agent.journal.formats import figure_text
from karma.agent.planning.planner import Planner
from karma.agent.planning.program import parse_program
from karma.agent.planning.prompt import compact
from karma.bench.figures.statistics import ConfidenceInterval, wilson
from karma.contracts import Completion, Decoding, Hints, LanguageModel, PlanRequest
from karma.errors import ProgramError
from karma.language.lexemes import unseen_lexemes
from karma.plugins.alfred.sentences import GoalFacts, Sentence, facts_of, plain
from karma.plugins.rules.request_refusals import FEATURES, LogisticDoubt
from karma.plugins.training.drawing.memories import KnownRoom
from karma.plugins.training.drawing.phrases import Book
from karma.plugins.training.refusals import draw_held_out_refusal, draw_near_miss
from karma.plugins.training.samples import TrainingExample, draw
from karma.seeds import stream

FOLDS = 5
NEAR_MISSES = 0.2  # share of what is to be done
_PENALTY = 1.0  # of squared coefficients over standardised features
_STEPS = 50


@dataclass(frozen=True, kw_only=True)
class Judged:
    """One request, what the planner's first answer shows, and what is right."""

    example: TrainingExample
    request: PlanRequest
    completion: Completion

    @property
    def to_refuse(self) -> bool:
        """Whether it is to be refused."""
        return self.example.kind.startswith("refuse_")

    @property
    def features(self) -> dict[str, float]:
        """The figures that doubt looks at."""
        certainty = self.completion.certainty
        if certainty is None:
            raise ValueError("a planner that tells no certainty has no doubt to be fitted")
        return {name: of(certainty, self.request) for name, of in FEATURES.items()}

    @property
    def in_known_words(self) -> bool:
        """Whether none of its words is held out: it is surely within what the planner can do."""
        return not unseen_lexemes().found_in(self.example.sentence)


def drawn(
    rooms: Sequence[KnownRoom], books: Sequence[Book], count: int, seed: int
) -> Iterator[TrainingExample]:
    """Yield requests, one to be refused and one to be done in turn, in rooms and books in turn."""
    for number in range(count):
        rng = stream(seed, "doubt", str(number))
        room, book = rooms[number % len(rooms)], books[number // 2 % len(books)]
        mapped = rng.random() < 0.7
        if number % 2:
            yield draw_held_out_refusal(rng, room, book, mapped=mapped)
        elif rng.random() < NEAR_MISSES:
            yield draw_near_miss(rng, room, book, mapped=mapped)
        else:
            yield draw(rng, room, book, mapped=mapped)


def judged(
    model: LanguageModel, hints: Hints | None, examples: Iterable[TrainingExample]
) -> Iterator[Judged]:
    """Yield every request with the planner's first answer to it."""
    planner = Planner(model, "compact", Decoding(attempts=1, inspected=False, refusing=True))
    for example in examples:
        facts = replace(example.facts, error="", failures=())
        told = hints(facts.instruction) if hints is not None else ()
        request = replace(facts, hints=tuple(told))
        plan = next(planner.plan(request))
        yield Judged(example=example, request=request, completion=plan.completion)


# ----------------------------------------------------------------- fitting


def fitted(
    found: Sequence[Judged], names: Sequence[str] = tuple(FEATURES), *, refused: float = 0.02
) -> LogisticDoubt:
    """Fit the regression and set its threshold.

    `refused`: share that may be refused of requests to be done in words that training has.
    ValueError if one sort is missing.
    """
    features, right = _table(found, names)
    if len(set(right.tolist())) < 2:
        raise ValueError("doubt is fitted on requests to refuse and on requests to do")
    weights, intercept = _regression(features, right)
    scores = expit(features @ weights + intercept)
    known = np.array([one.in_known_words for one in found])
    done = np.sort(scores[(right == 0) & known])
    allowed = min(int(len(done) * refused), len(done) - 1)
    threshold = (done[-allowed - 1] + min([*scores[scores > done[-allowed - 1]], 1.0])) / 2
    coefficients = {name: round(float(one), 5) for name, one in zip(names, weights, strict=True)}
    return LogisticDoubt(
        coefficients=coefficients,
        intercept=round(float(intercept), 5),
        threshold=round(float(threshold), 4),
        fitted_on=f"{len(right)} drawn requests, {int(right.sum())} of them to be refused",
    )


def _table(
    found: Sequence[Judged], names: Sequence[str]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return features, shape (n, features), and what is to be refused, shape (n,)."""
    rows = [one.features for one in found]
    features = np.array([[row[name] for name in names] for row in rows], np.float64)
    return features, np.array([float(one.to_refuse) for one in found])


def _regression(
    features: NDArray[np.float64], right: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float]:
    """Return coefficients and intercept by Newton's method, a penalty on standardised ones."""
    mean, spread = features.mean(0), features.std(0)
    spread = np.where(spread > 0, spread, 1.0)
    rows = np.column_stack([(features - mean) / spread, np.ones(len(right))])
    penalty = np.diag([*[_PENALTY] * features.shape[1], 0.0])
    weights = np.zeros(rows.shape[1])
    for _ in range(_STEPS):
        chance = expit(rows @ weights)
        slope = rows.T @ (chance - right) + penalty @ weights
        bend = (rows * (chance * (1 - chance))[:, None]).T @ rows + penalty
        step = np.linalg.solve(bend + 1e-9 * np.eye(len(bend)), slope)
        weights = weights - step
        if np.abs(step).max() < 1e-10:
            break
    scaled = weights[:-1] / spread
    return scaled, float(weights[-1] - scaled @ mean)


# ----------------------------------------------------------------- how far it can be trusted


@dataclass(frozen=True, slots=True, kw_only=True)
class Scored:
    """A request's probability of being one to refuse, and whether it is refused."""

    judged: Judged
    chance: float
    refused: bool


def scored(doubt: LogisticDoubt, found: Iterable[Judged]) -> list[Scored]:
    """Return what doubt says of requests."""
    chances = ((one, doubt.of(one.completion, one.request) or 0.0) for one in found)
    return [
        Scored(judged=one, chance=chance, refused=chance >= doubt.threshold)
        for one, chance in chances
    ]


def cross_validated(
    found: Sequence[Judged], names: Sequence[str], *, refused: float
) -> list[Scored]:
    """Return every request as judged by what was fitted without its fold."""
    told: list[Scored] = []
    for fold in range(FOLDS):
        inside = [one for number, one in enumerate(found) if number // 2 % FOLDS == fold]
        outside = [one for number, one in enumerate(found) if number // 2 % FOLDS != fold]
        told += scored(fitted(outside, names, refused=refused), inside)
    return told


def brier(told: Sequence[Scored]) -> float:
    """Return the mean squared difference of chance and truth: 0 at best, 0.25 for "one half"."""
    return float(np.mean([(one.chance - one.judged.to_refuse) ** 2 for one in told]))


def shares(
    told: Sequence[Scored],
) -> Mapping[str, tuple[int, int, ConfidenceInterval | None]]:
    """Return how many were refused, of how many, with Wilson's interval: by sort, then by kind."""
    to_do = [one for one in told if not one.judged.to_refuse]
    to_refuse = [one for one in told if one.judged.to_refuse]
    groups = {
        "to refuse": to_refuse,
        "to do": to_do,
        "to do, known words": [one for one in to_do if one.judged.in_known_words],
    }
    for kind in sorted({one.judged.example.kind for one in to_refuse}):
        groups[kind] = [one for one in to_refuse if one.judged.example.kind == kind]
    found = {}
    for name, group in groups.items():
        count = sum(one.refused for one in group)
        found[name] = (count, len(group), wilson(count, len(group)))
    return found


# ----------------------------------------------------------------- goal sentences


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadSentence:
    """A goal sentence, and what a planner's program made of it."""

    sentence: Sentence
    found: GoalFacts | None
    seconds: float
    trained: bool  # it stands word for word in the training split

    @property
    def right(self) -> bool:
        """Whether all five facts are."""
        return self.found == self.sentence.facts


def read_goals(
    model: LanguageModel,
    sentences: Iterable[Sentence],
    training: Iterable[Sentence],
    plans: Mapping[str, KnownRoom] | None = None,
    hints: Hints | None = None,
) -> Iterator[ReadSentence]:
    """Let a planner read goal sentences, without short-term memory.

    With `plans` (floor plan -> what is known of it) a sentence is read with the map of its
    room, and left out where there is none. `training`: sentences of the training split.
    """
    known = {plain(sentence.text) for sentence in training}
    for sentence in sentences:
        if plans is not None and sentence.floor_plan not in plans:
            continue
        areas = plans[sentence.floor_plan].areas if plans is not None else ()
        told = hints(sentence.text) if hints is not None else ()
        request = PlanRequest(instruction=sentence.text, areas=areas, hints=told)
        prompt = compact(request).prompt
        begun = time.perf_counter()
        said = model.complete(prompt, spec=None, max_tokens=256, temperature=0.0, seed=0)
        yield ReadSentence(
            sentence=sentence,
            found=_facts_in(said.text),
            seconds=time.perf_counter() - begun,
            trained=plain(sentence.text) in known,
        )


def _facts_in(text: str) -> GoalFacts | None:
    try:
        return facts_of(parse_program(text))
    except ProgramError:
        return None


def tell(read: Sequence[ReadSentence]) -> Iterator[str]:
    """Yield the figures as lines of text: by kind, by fact, and in all.

    Last comes the headline: the sentences that are not in the training split.
    """
    for task in sorted({one.sentence.facts.task for one in read}):
        yield _line(task, [one for one in read if one.sentence.facts.task == task])
    for fact in (field.name for field in fields(GoalFacts)):
        same = sum(
            getattr(one.found, fact, None) == getattr(one.sentence.facts, fact) for one in read
        )
        yield f"{fact:26}       right {_share(same, read)}"
    seconds = float(np.median([one.seconds for one in read])) if read else None
    yield f"{_line('all', read)}  median {figure_text(seconds, 3)} s an instruction"
    yield _line("in the training split too", [one for one in read if one.trained])
    yield _line("not in the training split", [one for one in read if not one.trained])


def _line(name: str, read: Sequence[ReadSentence]) -> str:
    return f"{name:26} {len(read):4}  exact {_share(sum(one.right for one in read), read)}"


def _share(count: int, read: Sequence[ReadSentence]) -> str:
    return figure_text(count / len(read) if read else None, 3)
