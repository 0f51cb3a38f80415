"""Sample training examples and task files; measure a planner on ALFRED's goal sentences.

    python scripts/planner_data.py examples      # then `karma models tune` with what it wrote
    python scripts/planner_data.py trajectories  # of tool mode, likewise
    python scripts/planner_data.py evaluate ../shared/data/alfred/valid_seen.jsonl.gz
    python scripts/planner_data.py tasks runs/drawn --seed 1

`karma.plugins.training.sources` lists the inputs and what training excludes.
"""

import gzip
import multiprocessing
import os
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Annotated

import typer
from measuring import ROOT
from rich.progress import track

from karma import registry
from karma.agent.planning.program import parse_program
from karma.agent.planning.prompt import compact
from karma.errors import ProgramError
from karma.files import to_json, write_atomic
from karma.goals.files import load_said
from karma.journal.formats import figure_text
from karma.loading.models import default_recall
from karma.loading.planner_files import reader_for
from karma.models.llama.opening import LlamaOptions
from karma.models.manifest import resolve_planner
from karma.offline.guard import go_offline
from karma.plugins.alfred.sentences import plain
from karma.plugins.thor_tools.importing.dump import read_layouts
from karma.plugins.thor_tools.importing.scenes import import_dump
from karma.plugins.training.drawing.memories import is_authors_plan
from karma.plugins.training.drawing.phrases import disjoint_book, our_book
from karma.plugins.training.goal_sentences import GoalFacts, facts_of, read_sentences
from karma.plugins.training.packs import Data, PlannerRecipe, draw_pack
from karma.plugins.training.samples import TrainingExample, draw_alfred
from karma.plugins.training.sources import DEVELOPMENT, Sources, held_out_packs
from karma.plugins.training.task_files import draw_tasks, fresh_rooms
from karma.plugins.training.trajectories import ToolMaterial, draw_chats
from karma.seeds import stream
from karma.types.planning import PlanRequest
from karma.world.core.scene import Scene

SHARED = Path(os.environ.get("KARMA_SHARED", ROOT.parent / "shared"))
LOCKED = ROOT / "eval" / "locked" / "tasks.jsonl"
REQUESTS = ROOT / "eval" / "requests"
SETS = ("refuse", "do", "several", "asked_open", "asked_locked")
SAID = tuple(REQUESTS / f"{name}.jsonl" for name in SETS)
FOLDER, TOOLS = ROOT / "runs" / "planner", ROOT / "runs" / "tools"
CHATS = 100  # conversations of a part
ROOMS, TOOL_ROOMS = 90, 1_000_000  # generated rooms of tool mode, and their seed
AT_ONCE = 500  # packs that a worker draws at a time
WATCHED = 200  # packs, and sentences of ALFRED's, to watch
Folder = Annotated[Path, typer.Option(help="Rooms, words and examples.")]

app = typer.Typer(add_completion=False, no_args_is_help=True)
say = print


def sources(folder: Path) -> Sources:
    """Return the inputs of training."""
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
    """Sample training examples (examples.jsonl.gz) for `karma models tune`.

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


@app.command()
def trajectories(
    folder: Annotated[Path, typer.Option(help="Takes chats.jsonl.gz and its parts.")] = TOOLS,
    conversations: Annotated[int, typer.Option(help="Of some two chats.")] = 20_000,
    seed: int = 41,
    workers: int = 2,
) -> None:
    """Sample chats of tool mode (chats.jsonl.gz) for `karma models tune`; resumes.

    watched.jsonl.gz beside it has sentence forms that training has not, and sentences of ALFRED's
    training trials that are kept out.
    """
    (folder / "parts").mkdir(parents=True, exist_ok=True)
    places = [(folder, seed, first) for first in range(-CHATS, conversations, CHATS)]
    with multiprocessing.get_context("fork").Pool(workers) as pool:
        for _ in track(pool.imap_unordered(_draw_part, places), "drawing", total=len(places)):
            pass
    held, *parts = (_part(folder, seed, first) for _, _, first in places)
    write_atomic(folder / "watched.jsonl.gz", held.read_bytes())
    whole = b"".join(part.read_bytes() for part in parts)  # members of a gzip file
    write_atomic(folder / "chats.jsonl.gz", whole)
    count = gzip.decompress(whole).count(b"\n")
    say(f"{count} chats: {folder}/chats.jsonl.gz")


def _part(folder: Path, seed: int, first: int) -> Path:
    return folder / "parts" / f"{seed}-{first}.jsonl.gz"


def _draw_part(place: tuple[Path, int, int]) -> None:
    """Write the chats of some conversations, those of held-out phrases for a negative number."""
    folder, seed, first = place
    path = _part(folder, seed, first)
    if path.exists():
        return
    material = _chat_material(first < 0)
    with tempfile.TemporaryDirectory() as rooms:
        lines = [
            to_json(chat)
            for number in range(first, first + CHATS)
            for chat in draw_chats(material, Path(rooms), seed, str(number))
        ]
    write_atomic(path, gzip.compress(b"".join(lines), 4))


@cache
def _chat_material(held_out: bool) -> ToolMaterial:
    read, embedder = sources(FOLDER), registry.load("embedders", "minilm")()
    dumps, layouts = read.floor_plans
    plans = import_dump(dumps, layouts=layouts) if dumps.exists() else ()
    data = Data(
        rooms=(), book=our_book().part(held_out=held_out), unseen=read.unseen(),
        alfred=read.sentences(held_out=held_out),
        written=() if held_out else load_said(REQUESTS / "written.jsonl"),
    )  # fmt: skip
    return ToolMaterial(
        data=data,
        scenes=[
            *(scene for scene in plans if not is_authors_plan(scene.name)),
            *fresh_rooms(ROOMS, TOOL_ROOMS),
        ],
        recall=registry.load("recalls", default_recall())(embedder, text="sentence"),
    )


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
    texts = (example.stable, example.changing, example.program)
    roles = zip(("system", "user", "assistant"), texts, strict=True)
    messages = [{"role": role, "content": text} for role, text in roles]
    return to_json({"kind": example.kind, "messages": messages})


def _write(path: Path, lines: Iterable[bytes]) -> None:
    with gzip.open(path, "wb", compresslevel=4) as file:
        for line in lines:
            file.write(line)


@app.command()
def evaluate(
    alfred: Annotated[Path, typer.Argument(help="Demonstrations whose goal sentences to read.")],
    planner: Annotated[str, typer.Option(help="A model or GGUF.")] = "karma-mini",
    mapped: Annotated[bool, typer.Option(help="With the room's long-term memory.")] = False,
    folder: Folder = FOLDER,
) -> None:
    """Print the share of human goal sentences whose five facts a GGUF's program has right.

    Sentences that stand word for word in the training split are counted apart; the figure to go by
    is that of the others. With --mapped, sentences of rooms without a dump are left out.
    """
    read = sources(folder)
    file = resolve_planner(planner)
    model = registry.load("language_models", "llama")(
        file.path, options=LlamaOptions(threads=1), name=file.name
    )
    reader = reader_for(planner)
    trained = {plain(sentence.text) for sentence in read_sentences(read.demonstrations)}
    plans = read.known_plans() if mapped else {}
    outcomes: dict[bool, list[bool]] = {True: [], False: []}
    for sentence in track(read_sentences(alfred), "reading"):
        if mapped and sentence.floor_plan not in plans:
            continue
        areas = plans[sentence.floor_plan].areas if mapped else ()
        told = reader.hints(sentence.text) if reader is not None else ()
        prompt = compact(PlanRequest(instruction=sentence.text, areas=areas, hints=told)).prompt
        answer = model.complete(prompt, spec=None, max_tokens=256, temperature=0.0, seed=0)
        is_right = _facts_in(answer.text) == sentence.facts
        outcomes[plain(sentence.text) in trained].append(is_right)
    for name, is_trained in (("in the training split", True), ("not in it", False)):
        right, count = sum(outcomes[is_trained]), len(outcomes[is_trained])
        say(f"{name:22} {right} of {count} right, {figure_text(right / max(count, 1), 3)}")


def _facts_in(text: str) -> GoalFacts | None:
    """Return the facts of a program, or None if it does not parse."""
    try:
        return facts_of(parse_program(text))
    except ProgramError:
        return None


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
    lexemes: Annotated[bool, typer.Option(help="In words that training has not.")] = False,
) -> None:
    """Draw tasks of rooms and phrasings that training never sees, each done once by the expert.

    With --dumps most rooms are known to training; with --unfiltered the expert is not asked.
    """
    book = our_book().with_unseen_words() if lexemes else our_book().part(held_out=True)
    if disjoint:
        book = disjoint_book()
    plans = _floor_plans(unknown=unknown) if dumps or unknown else None
    drawn = draw_tasks(
        folder, book, scenes=plans or list(fresh_rooms(homes, seed)), each=each, seed=seed,
        filtered=not unfiltered, unseen=lexemes,
    )  # fmt: skip
    say(f"{drawn.tasks} tasks in {drawn.rooms} rooms, of {drawn.tried} drawn: {folder}/tasks.jsonl")
    for reason, count in drawn.left_out.items():
        say(f"  {count} left out: {reason}")
    for count, number in sorted(drawn.lexemes.items()) if lexemes else ():
        say(f"  {number} with {count} held-out lexemes")


def _floor_plans(*, unknown: bool) -> list[Scene]:
    """Return the rooms of the dumps whose reachable positions are known."""
    dumps, layouts = sources(FOLDER).floor_plans
    known = read_layouts(layouts)
    found = [scene for scene in import_dump(dumps, layouts=layouts) if scene.name in known]
    return [scene for scene in found if is_authors_plan(scene.name)] if unknown else found


if __name__ == "__main__":
    go_offline()
    app()
