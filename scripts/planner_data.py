"""What planners are tuned on and measured with: examples, tasks, ALFRED's sentences, hints.

    python scripts/planner_data.py examples      # then `karma models tune` with what it wrote
    python scripts/planner_data.py evaluate ../shared/data/alfred/valid_seen.jsonl.gz
    python scripts/planner_data.py tasks runs/drawn --seed 1

What it reads, and what stays out, says `karma.plugins.training.sources`.
"""

import gzip
import multiprocessing
import os
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Annotated

import typer
from measuring import ROOT
from rich.progress import track
from support.hint_figures import asked_words, figures

from karma import registry
from karma.agent.loading.planner_files import hints_for
from karma.files import read_json, to_json
from karma.language.hints import WordFile
from karma.models.llama.opening import LlamaOptions
from karma.models.manifest import resolve_planner
from karma.offline.guard import go_offline
from karma.plugins.alfred.sentences import read_sentences
from karma.plugins.thor_tools.importing.dump import read_layouts
from karma.plugins.thor_tools.importing.scenes import import_dump
from karma.plugins.training.drawing.memories import is_authors_plan
from karma.plugins.training.drawing.phrases import disjoint_book, our_book
from karma.plugins.training.drawing.requests import KINDS, WITH_PAIRS
from karma.plugins.training.drawing.several import SEVERAL
from karma.plugins.training.figures import read_goals, tell
from karma.plugins.training.hinted import KeptRows
from karma.plugins.training.packs import Data, PlannerRecipe, draw_pack
from karma.plugins.training.samples import TrainingExample, draw_alfred
from karma.plugins.training.sources import DEVELOPMENT, Sources, held_out_packs
from karma.plugins.training.task_files import draw_tasks, fresh_rooms
from karma.seeds import stream
from karma.world.core.scene import Scene

SHARED = Path(os.environ.get("KARMA_SHARED", ROOT.parent / "shared"))
LOCKED = ROOT / "eval" / "locked" / "tasks.jsonl"
REQUESTS = ROOT / "eval" / "requests"
SETS = ("refuse", "do", "several", "asked_open", "asked_locked")
SAID = tuple(REQUESTS / f"{name}.jsonl" for name in SETS)
FOLDER = ROOT / "runs" / "planner"
AT_ONCE = 500  # packs that a worker draws at a time
WATCHED = 200  # packs, and sentences of ALFRED's, to watch
Folder = Annotated[Path, typer.Option(help="Rooms, words and examples.")]

app = typer.Typer(add_completion=False, no_args_is_help=True)
say = print


def sources(folder: Path) -> Sources:
    """Return what training reads, beside the project."""
    return Sources(
        folder=folder, shared=SHARED, tests=(ROOT / DEVELOPMENT, LOCKED), said=SAID,
        written=REQUESTS / "written.jsonl", generated=300, say=say,
    )  # fmt: skip


@app.command()
def examples(
    folder: Folder = FOLDER,
    packs: Annotated[int, typer.Option(help="Of some five examples.")] = 95_000,
    seed: int = 37,
    workers: int = 2,
) -> None:
    """Draw what a planner is tuned on: examples.jsonl.gz; then `karma models tune`.

    watched.jsonl.gz beside it has forms and words that training has not, and sentences of ALFRED's
    training trials that are kept out.
    """
    folder.mkdir(parents=True, exist_ok=True)
    recipe = PlannerRecipe(seed=seed)
    _write(folder / "watched.jsonl.gz", map(_line, _watched(folder, recipe)))
    parts = [(folder, recipe, first) for first in range(0, packs, AT_ONCE)]
    with multiprocessing.get_context("fork").Pool(workers) as pool:
        drawn = track(pool.imap(_drawn, parts), "drawing", total=len(parts))
        _write(folder / "examples.jsonl.gz", (line for part in drawn for line in part))


@cache
def _material(folder: Path, recipe: PlannerRecipe) -> Data:
    return sources(folder).data(recipe)


def _drawn(part: tuple[Path, PlannerRecipe, int]) -> list[bytes]:
    folder, recipe, first = part
    data = _material(folder, recipe)
    packs = (draw_pack(recipe, data, "train", str(n)) for n in range(first, first + AT_ONCE))
    return [_line(example) for pack in packs for example in pack]


def _watched(folder: Path, recipe: PlannerRecipe) -> Iterator[TrainingExample]:
    data = _material(folder, recipe)
    plain = replace(recipe, written=0.0)
    for pack in held_out_packs(plain, our_book().part(held_out=True), WATCHED, data.hints):
        yield from pack
    kept_out, rng = sources(folder).sentences(held_out=True), stream(recipe.seed, "watched")
    for number in range(WATCHED if kept_out else 0):
        room = data.rooms[number % len(data.rooms)]
        example = draw_alfred(rng, room, kept_out, mapped=False)
        if example is not None:
            yield example


def _line(example: TrainingExample) -> bytes:
    prompt = [example.stable, example.changing]
    return to_json({"kind": example.kind, "prompt": prompt, "answer": example.program})


def _write(path: Path, lines: Iterable[bytes]) -> None:
    with gzip.open(path, "wb", compresslevel=4) as file:
        for line in lines:
            file.write(line)


@app.command()
def evaluate(
    alfred: Annotated[Path, typer.Argument(help="Demonstrations whose goal sentences to read.")],
    planner: Annotated[str, typer.Option(help="A model or GGUF.")] = "karma-mini",
    mapped: Annotated[
        bool, typer.Option(help="The room's long-term memory is in the prompt.")
    ] = False,
    wrong: Annotated[int, typer.Option(help="Show so many misread ones.")] = 0,
    folder: Folder = FOLDER,
) -> None:
    """Print the share of human goal sentences whose five facts a GGUF's program has right.

    Read alone, or with --mapped by an agent that knows the room from an earlier exploration; of
    all of them, and (to go by) of those that do not stand word for word in the training split.
    """
    read = sources(folder)
    file = resolve_planner(planner)
    model = registry.load("language_models", "llama")(
        file.path, options=LlamaOptions(threads=1), name=file.name
    )
    plans = read.known_plans() if mapped else None
    training = read_sentences(read.demonstrations)
    sentences = list(read_sentences(alfred))
    found = list(read_goals(model, sentences, training, plans, hints_for(planner)))
    if left_out := len(sentences) - len(found):
        say(f"{left_out} of {len(sentences)} left out, as nothing is known of their rooms")
    for one in [one for one in found if not one.right][:wrong]:
        say(f"{one.sentence.text!r}\n  is   {one.sentence.facts}\n  read {one.found}")
    for line in tell(found):
        say(line)


@app.command()
def hints(
    words: Annotated[Path, typer.Argument(help="A words file.")],
    held_out: Annotated[bool, typer.Option(help="Ask for held-out words.")] = False,
    rows: Annotated[Path, typer.Option(help="Keeps vectors.")] = ROOT / "runs/rows.safetensors",
) -> None:
    """Print how often hints name the right type or deed, by class of word and way of scoring.

    Known words as if never seen; right meaning first, among the first three, 95 % intervals.
    """
    rows.parent.mkdir(parents=True, exist_ok=True)
    kept = KeptRows(registry.load("embedders", "minilm")(), rows)
    asked = list(asked_words(unseen=held_out))
    for line in figures(read_json(words, WordFile), kept, asked):
        print(line)
    kept.save()


@app.command()
def tasks(
    folder: Annotated[Path, typer.Argument(help="Takes tasks.jsonl and scenes/.")],
    each: Annotated[int, typer.Option(help="Tasks per kind.")] = 300,
    seed: int = 0,
    homes: Annotated[int, typer.Option(help="Rooms, half of them kitchens.")] = 24,
    disjoint: Annotated[bool, typer.Option(help="In forms and words that training lacks.")] = False,
    dumps: Annotated[bool, typer.Option(help="In AI2-THOR's floor plans with a layout.")] = False,
    unknown: Annotated[bool, typer.Option(help="In those that no training sees.")] = False,
    unfiltered: Annotated[bool, typer.Option(help="Also what the expert does not do.")] = False,
    pairs: Annotated[bool, typer.Option(help="Ask for two of a kind, too.")] = False,
    lexemes: Annotated[bool, typer.Option(help="In words that training has not.")] = False,
    several: Annotated[bool, typer.Option(help="First two or three things at once.")] = False,
) -> None:
    """Draw tasks of rooms and phrasings that training never sees, each done once by the expert.

    With --dumps most rooms are known to training; with --unfiltered the expert is not asked.
    """
    book = our_book().with_unseen_words() if lexemes else our_book().part(held_out=True)
    if disjoint:
        book = disjoint_book()
    plans = _floor_plans(unknown=unknown) if dumps or unknown else None
    kinds = {SEVERAL: 1.0} if several else WITH_PAIRS if pairs else KINDS
    drawn = draw_tasks(
        folder, book, scenes=plans or list(fresh_rooms(homes, seed)), each=each, seed=seed,
        filtered=not unfiltered, kinds=kinds, unseen=lexemes,
    )  # fmt: skip
    say(f"{drawn.tasks} tasks in {drawn.rooms} rooms, of {drawn.tried} drawn: {folder}/tasks.jsonl")
    for reason, count in drawn.left_out.items():
        say(f"  {count} left out: {reason}")
    for count, number in sorted(drawn.lexemes.items()) if lexemes else ():
        say(f"  {number} with {count} held-out lexemes")


def _floor_plans(*, unknown: bool) -> list[Scene]:
    """Return the rooms of the dumps of which it is known where one can stand."""
    dumps, layouts = sources(FOLDER).floor_plans
    known = read_layouts(layouts)
    found = [scene for scene in import_dump(dumps, layouts=layouts) if scene.name in known]
    return [scene for scene in found if is_authors_plan(scene.name)] if unknown else found


if __name__ == "__main__":
    go_offline()
    app()
