"""Sources of training examples, and what training excludes.

Rooms come from the generator (seeds of their own) and, where the reference data lies at hand, from
AI2-THOR floor plans; phrases from our phrase book and ALFRED's annotators.

Training excludes the following; everything that feeds training asks here.

* Lexemes: words for objects, states and actions in `held_out.toml`, which names the rule.
* Sentence forms: about one template in twelve, by `Book.is_held_out`.
* Sentences: those of test tasks and test requests, word for word.
* Rooms: those that figures are taken in have seeds of their own; of AI2-THOR's floor plans, those
  of the authors' tasks.

The 48 tasks in `DEVELOPMENT` are no test: the phrase book grew after they had been read.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from itertools import chain, islice
from pathlib import Path

from karma import registry
from karma.files import read_json, to_json, write_atomic
from karma.goals.files import load_said, load_tasks, load_texts
from karma.loading.planner_files import WORDS
from karma.plugins.alfred.published_tasks import load_authors_tasks
from karma.plugins.alfred.sentences import plain
from karma.plugins.rules.language.lexemes import lexicon
from karma.plugins.rules.wording.hints import load_words, write_words
from karma.plugins.thor_tools.importing.scenes import import_dump
from karma.plugins.training.drawing.memories import (
    KnownRoom,
    generated_rooms,
    imported_rooms,
    room_of,
)
from karma.plugins.training.drawing.phrases import Book, our_book
from karma.plugins.training.goal_sentences import (
    Sentence,
    names_its_place,
    read_sentences,
)
from karma.plugins.training.hinted import (
    DrawnHints,
    KeptRows,
    called,
    phrases_to_embed,
    words_file,
)
from karma.plugins.training.packs import Data, PlannerRecipe, Unseen, draw_pack
from karma.plugins.training.samples import TrainingExample

DEVELOPMENT = Path("eval") / "alfred_l" / "tasks.jsonl"
TRAINED_ROOMS, WATCHED_ROOMS, DRAWN_ROOMS = 77, 78, 79  # added to a seed for rooms of each sort
SAMPLED = 1500  # packs whose sentences say which words are known
EMBEDDED = 9_000  # phrases of sentences, at most
WATCHED = 25  # every n-th trial of ALFRED is kept out of training, to watch it


@dataclass(frozen=True, kw_only=True)
class Sources:
    """Input folders, and the folder that caches derived data."""

    folder: Path  # keeps rooms and known words
    shared: Path  # the reference data; what is missing there is done without
    tests: tuple[Path, ...]  # task files of which training must not say a sentence
    said: tuple[Path, ...] = ()  # requests that training must not repeat either
    written: Path | None = None  # the sentences that were written by hand
    generated: int = 300  # rooms to make
    say: Callable[[str], None] = lambda line: None  # what is being made or is missing

    @property
    def demonstrations(self) -> Path:
        """ALFRED's training split."""
        return self.shared / "data" / "alfred" / "train.jsonl.gz"

    @property
    def floor_plans(self) -> tuple[Path, Path]:
        """AI2-THOR's dumps and their reachable positions."""
        data = self.shared / "data"
        return data / "thor5" / "scenes.jsonl.gz", data / "alfred" / "layouts.json.gz"

    def data(self, recipe: PlannerRecipe) -> Data:
        """Return rooms, phrases and hints of the training side."""
        found = self.material(recipe)
        return replace(found, hints=self.hints(recipe, found))

    def material(self, recipe: PlannerRecipe) -> Data:
        """Return rooms and phrases of the training side, without hints."""
        return Data(
            rooms=self.rooms(recipe),
            book=our_book().part(held_out=False),
            unseen=self.unseen(),
            written=load_said(self.written) if self.written else (),
            alfred=self.sentences(held_out=False),
        )

    def hints(self, recipe: PlannerRecipe, data: Data) -> DrawnHints:
        """Return the hints: words file and vectors, cached."""
        path, asked = self.folder / WORDS, self.folder / "phrases.json"
        rows = KeptRows(registry.load("embedders", "minilm")(), self.folder / "rows.safetensors")
        if not asked.exists():
            self.say("embedding the phrases of the training sentences ...")
            seen = [
                example.sentence
                for number in range(SAMPLED)
                for example in draw_pack(recipe, data, "words", str(number))
            ]
            said = [sentence.text for sentence in data.alfred]
            spoken = dict.fromkeys((*phrases_to_embed(seen), *phrases_to_embed(said)))
            phrases = sorted({*called(), *islice(spoken, EMBEDDED)})
            write_words(path, words_file(seen), rows)
            rows.embed(phrases)
            rows.save()
            write_atomic(asked, to_json(phrases))
        phrases = read_json(asked, list[str])
        return DrawnHints(
            words=load_words(path, rows),
            vectors=dict(zip(phrases, rows.embed(phrases), strict=True)),
            names=frozenset(name for entry in lexicon().values() for name in entry.names),
        )

    def rooms(self, recipe: PlannerRecipe) -> list[KnownRoom]:
        """Return the training rooms, made once."""
        path = self.folder / "rooms.json"
        if path.exists():
            return read_json(path, list[KnownRoom])
        self.say(f"making {self.generated} rooms ...")
        found = list(generated_rooms(self.generated, recipe.seed + TRAINED_ROOMS))
        dumps, layouts = self.floor_plans
        if dumps.exists():
            found += imported_rooms(dumps, layouts, recipe.seed)
        else:
            self.say(f"no floor plans at {dumps}: generated rooms only")
        write_atomic(path, to_json(found))
        return found

    def sentences(self, *, held_out: bool) -> tuple[Sentence, ...]:
        """Return ALFRED's goal sentences of a side of the split; () if they are missing."""
        if not self.demonstrations.exists():
            return ()
        every = filter(names_its_place, read_sentences(self.demonstrations))
        return tuple(s for n, s in enumerate(every) if (n // 3 % WATCHED == 0) == held_out)

    def unseen(self) -> Unseen:
        """Return the sentences that examples may not repeat."""
        return unseen_of(self.tests, said=self.said, shared=self.shared)

    def known_plans(self) -> dict[str, KnownRoom]:
        """Return floor plan -> complete knowledge of the room."""
        dumps, layouts = self.floor_plans
        scenes = import_dump(dumps, layouts=layouts)
        return {scene.name: room_of(scene, scene.name, keep=1.0) for scene in scenes}


def unseen_of(tests: Iterable[Path], *, said: Iterable[Path], shared: Path) -> Unseen:
    """Return the sentences of tests, which training excludes.

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


def held_out_packs(
    recipe: PlannerRecipe, book: Book, count: int, hints: DrawnHints | None = None
) -> list[list[TrainingExample]]:
    """Return packs over rooms that training never sees, with the phrases of `book`."""
    found = list(generated_rooms(24, recipe.seed + WATCHED_ROOMS))
    data = Data(rooms=found, book=book, hints=hints)
    return [draw_pack(recipe, data, "held-out", str(number)) for number in range(count)]
