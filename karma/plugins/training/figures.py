"""Which goal sentences a planner reads right.

How often it reads a human goal sentence right is told by five facts, read off its program by rule.
Short human sentences come twice: many of a split that is called unseen stand word for word in the
training split too. They are counted apart, and the figure to go by is that of the others.
"""

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from karma.agent.journal.formats import figure_text
from karma.agent.planning.program import parse_program
from karma.agent.planning.prompt import compact
from karma.contracts import Hints, LanguageModel, PlanRequest
from karma.errors import ProgramError
from karma.plugins.alfred.sentences import GoalFacts, Sentence, facts_of, plain
from karma.plugins.training.drawing.memories import KnownRoom


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
