"""Train the nano planner: tokenizer, weights, GGUF and held-out figures; resumes where it stopped.

    python scripts/train_planner.py train                # some hours on 2 cores, less with --half
    python scripts/train_planner.py export models/nano/planner.gguf
    python scripts/train_planner.py evaluate

What it reads, and what stays out, says `karma.training.planner.sources`.
"""

import os
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from karma import registry
from karma.bench.planner_words import WORDS, hints_for
from karma.files import read_json, write_atomic
from karma.infer.llama.options import LlamaOptions
from karma.infer.manifest.manifest import resolve_planner
from karma.offline import go_offline
from karma.tasks.drawing.alfred import read_sentences
from karma.tasks.drawing.lexicon import HELD_OUT, every_word
from karma.tasks.drawing.phrases import disjoint_book, our_book
from karma.tasks.drawing.requests import KINDS, WITH_PAIRS
from karma.tasks.drawing.rooms import is_authors_plan
from karma.tasks.drawing.several import SEVERAL
from karma.training.planner.checkpoints import export_gguf, load_weights
from karma.training.planner.choosing import candidates, choose, trained_on_before, write_held_out
from karma.training.planner.held_out import DEVELOPMENT
from karma.training.planner.packs import PlannerRecipe
from karma.training.planner.processes import train_in_processes
from karma.training.planner.reading import read_goals, tell
from karma.training.planner.sources import Sources, held_out_packs
from karma.training.planner.task_files import draw_tasks, fresh_rooms
from karma.training.planner.train import exact_by_kind
from karma.world.core.scene import Scene
from karma.world.importing.dump import read_layouts
from karma.world.importing.scenes import import_dump

ROOT = Path(__file__).parents[1]
SHARED = Path(os.environ.get("KARMA_SHARED", ROOT.parent / "shared"))
LOCKED = ROOT / "eval" / "locked" / "tasks.jsonl"
SAID = tuple(ROOT / "eval" / "requests" / f"{name}.jsonl" for name in ("refuse", "do", "several"))
FOLDER = ROOT / "runs" / "planner"
START = "nano/start.gguf"
Folder = Annotated[Path, typer.Option(help="Checkpoints, tokenizer and rooms.")]
Disjoint = Annotated[
    bool,
    typer.Option(help="Ask in forms and words that training has not, not in held-out templates."),
]
Average = Annotated[bool, typer.Option(help="The averaged weights, not the last.")]

app = typer.Typer(add_completion=False, no_args_is_help=True)
console = Console()


def say(line: str) -> None:
    """Print a line as it is."""
    console.print(line, markup=False, highlight=False)


def sources(folder: Path, generated: int = 300) -> Sources:
    """Return what training reads, beside the project."""
    models = ROOT / "models"
    return Sources(
        folder=folder,
        models=models,
        shared=SHARED,
        tests=(ROOT / DEVELOPMENT, LOCKED),
        said=SAID,
        generated=generated,
        say=say,
    )


@app.command()
def train(
    folder: Folder = FOLDER,
    steps: int = PlannerRecipe().steps,
    seed: int = 0,
    device: str = "cpu",
    workers: Annotated[int, typer.Option(help="Processes of one thread each.")] = 2,
    generated: int = 300,
    half: Annotated[bool, typer.Option(help="bfloat16, where the processor has it.")] = False,
    rate: Annotated[float, typer.Option(help="Learning rate.")] = PlannerRecipe().learning_rate,
    decay: Annotated[
        int, typer.Option(help="Last steps, in which it falls to zero.")
    ] = PlannerRecipe().decay,
    packs: Annotated[int, typer.Option(help="Packs per step.")] = PlannerRecipe().packs,
    start: Annotated[
        str, typer.Option(help="GGUF below models/ to begin with; '' for new weights.")
    ] = START,
) -> None:
    """Train, or go on training from the last checkpoint.

    Until the rate falls nothing depends on --steps: begin with more steps than there is time for,
    stop, and end with --steps and --decay as far as the run has come.
    """
    recipe = PlannerRecipe(
        seed=seed,
        steps=steps,
        half=half,
        learning_rate=rate,
        decay=decay,
        packs=packs,
        start=start,
    )
    train_in_processes(sources(folder, generated), recipe, device=device, workers=workers)


@app.command()
def export(
    path: Path, folder: Folder = FOLDER, dtype: str = "Q8_0", average: Average = False
) -> None:
    """Write the last checkpoint as GGUF, mixed with its start, and the words file beside it."""
    export_gguf(folder, path, dtype, models=ROOT / "models", average=average)
    for kept in folder.glob(f"{Path(WORDS).stem}.*"):
        write_atomic(path.with_name(kept.name), kept.read_bytes())
    say(f"{path}  {path.stat().st_size / 1e6:.1f} MB")


@app.command()
def evaluate(
    folder: Folder = FOLDER,
    packs: int = 100,
    seed: int = 1,
    disjoint: Disjoint = False,
    average: Average = False,
    alfred: Annotated[
        Path | None, typer.Option(help="Demonstrations whose goal sentences to read instead.")
    ] = None,
    planner: Annotated[str, typer.Option(help="With --alfred: a model or GGUF.")] = "karma-nano",
    mapped: Annotated[
        bool, typer.Option(help="With --alfred: the room's long-term memory is in the prompt.")
    ] = False,
    wrong: Annotated[int, typer.Option(help="With --alfred: show so many misread ones.")] = 0,
) -> None:
    """Print held-out figures of the last checkpoint by kind of request, teacher-forced.

    With --alfred: the share of human goal sentences whose five facts a GGUF's program has right,
    read alone, or with --mapped by an agent that knows the room from an earlier exploration; of
    all of them, and (to go by) of those that do not stand word for word in the training split.
    """
    if alfred is not None:
        _evaluate_alfred(alfred, planner, wrong, sources(folder), mapped=mapped)
        return
    recipe = replace(read_json(folder / "recipe.json", PlannerRecipe), seed=seed)
    book = disjoint_book() if disjoint else our_book().part(held_out=True)
    hints = sources(folder).data(recipe).hints
    drawn = held_out_packs(recipe, book, packs, hints)
    examples = [example for pack in drawn for example in pack]
    weights = load_weights(folder, recipe, average=average)
    for kind, count, share in exact_by_kind(folder, weights, examples):
        say(f"{kind:12} {count:4}  exact {share:.3f}")


def _evaluate_alfred(path: Path, planner: str, wrong: int, read: Sources, *, mapped: bool) -> None:
    file = resolve_planner(planner)
    model = registry.load("language_models", "llama")(
        file.path, options=LlamaOptions(threads=1), name=file.name
    )
    plans = read.known_plans() if mapped else None
    training = read_sentences(read.demonstrations)
    sentences = list(read_sentences(path))
    found = list(read_goals(model, sentences, training, plans, hints_for(planner)))
    if left_out := len(sentences) - len(found):
        say(f"{left_out} of {len(sentences)} left out, as nothing is known of their rooms")
    for one in [one for one in found if not one.right][:wrong]:
        say(f"{one.sentence.text!r}\n  is   {one.sentence.facts}\n  read {one.found}")
    for line in tell(found):
        say(line)


@app.command()
def hold_out() -> None:
    """Choose the lexemes that are held out, by rule, and write them down.

    Weights that were trained before must be trained again then: they may know some of them.
    """
    chosen = choose(every_word(), our_book(), trained_on_before(sources(FOLDER)))
    write_held_out(HELD_OUT, chosen)
    for name, texts in candidates(every_word(), our_book()).items():
        say(f"{name:10} {len(getattr(chosen, name)):4} of {len(texts):4} held out")


@app.command()
def tasks(
    folder: Annotated[Path, typer.Argument(help="Takes tasks.jsonl and scenes/.")],
    each: Annotated[int, typer.Option(help="Tasks per kind.")] = 300,
    seed: int = 0,
    homes: Annotated[int, typer.Option(help="Rooms, half of them kitchens.")] = 24,
    disjoint: Disjoint = False,
    dumps: Annotated[
        bool, typer.Option(help="In AI2-THOR's floor plans that have a layout, not in homes.")
    ] = False,
    unknown: Annotated[
        bool, typer.Option(help="In those floor plans that no training sees, not in homes.")
    ] = False,
    unfiltered: Annotated[
        bool, typer.Option(help="Also what the expert does not do; the tasks are not run.")
    ] = False,
    pairs: Annotated[bool, typer.Option(help="Ask for two of a kind, too.")] = False,
    lexemes: Annotated[
        bool, typer.Option(help="Call things, states and deeds by words that training has not.")
    ] = False,
    several: Annotated[
        bool, typer.Option(help="First ask for two or three things in one sentence.")
    ] = False,
) -> None:
    """Draw tasks of rooms and phrasings that training never sees, each done once by the expert.

    With --dumps most rooms are known to training; with --unfiltered the expert is not asked.
    """
    book = our_book().with_unseen_words() if lexemes else our_book().part(held_out=True)
    if disjoint:
        book = disjoint_book()
    plans = _floor_plans(unknown=unknown) if dumps or unknown else None
    scenes = plans or list(fresh_rooms(homes, seed))
    drawn = draw_tasks(
        folder,
        book,
        scenes=scenes,
        each=each,
        seed=seed,
        filtered=not unfiltered,
        kinds={SEVERAL: 1.0} if several else WITH_PAIRS if pairs else KINDS,
        unseen=lexemes,
    )
    say(f"{drawn.tasks} tasks in {drawn.rooms} rooms, of {drawn.tried} drawn: {folder}/tasks.jsonl")
    for reason, count in drawn.left_out.items():
        say(f"  {count} left out: {reason}")
    for count, number in sorted(drawn.lexemes.items()) if lexemes else ():
        say(f"  {number} with {count} held-out lexemes")


def _floor_plans(*, unknown: bool) -> list[Scene]:
    """Return the rooms of the dumps of which it is known where one can stand.

    Args:
        unknown: those that no training sees, in place of all.
    """
    dumps, layouts = sources(FOLDER).floor_plans
    known = read_layouts(layouts)
    found = [scene for scene in import_dump(dumps, layouts=layouts) if scene.name in known]
    return [scene for scene in found if is_authors_plan(scene.name)] if unknown else found


if __name__ == "__main__":
    go_offline()
    app()
