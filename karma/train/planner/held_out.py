"""What no planner is trained on; everything that feeds training asks here.

* Lexemes: words for things, states and deeds, in `held_out.toml`, which says where the rule is.
* Sentence forms: about one template in twelve, by `Book.is_held_out`.
* Sentences: what the test tasks and requests say, word for word.
* Rooms: those that figures are taken in have seeds of their own; of AI2-THOR's floor plans, those
  of the authors' tasks.

The 48 tasks in `DEVELOPMENT` are no test: the phrase book grew after they had been read.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from karma.agent.goals.files import load_tasks, load_texts
from karma.agent.loading.alfred_sentences import plain
from karma.bench.engine.published_tasks import load_authors_tasks
from karma.language.lexemes import unseen_lexemes

DEVELOPMENT = Path("eval") / "alfred_l" / "tasks.jsonl"
TRAINED_ROOMS, WATCHED_ROOMS, DRAWN_ROOMS = 77, 78, 79  # added to a seed for rooms of each sort


@dataclass(frozen=True, kw_only=True)
class Unseen:
    """What examples may not say, besides held-out lexemes."""

    sentences: frozenset[str] = frozenset()  # as `plain` has them

    def admits(self, sentence: str) -> bool:
        """Return whether an example may say a sentence."""
        return not unseen_lexemes().found_in(sentence) and plain(sentence) not in self.sentences


def unseen_of(tests: Iterable[Path], *, said: Iterable[Path], shared: Path) -> Unseen:
    """Return what training may not know of the tests.

    Of the authors' tasks in `shared`, what is missing is done without.
    """
    folder = shared / "data" / "alfred_l"
    files = [folder / f"{kind}_tasks.json" for kind in ("simple", "composite", "complex")]
    tasks = [task for path in tests for task in load_tasks(path)]
    tasks += load_authors_tasks([path for path in files if path.exists()])
    told = [sub.instruction for task in tasks for sub in task.subtasks]
    told += chain(*map(load_texts, said))
    sentences = frozenset(map(plain, told)) - {""}  # what has no Latin letters has no plain form
    return Unseen(sentences=sentences)
