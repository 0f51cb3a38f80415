"""Train the nano planner: tokenizer, weights, GGUF and held-out figures; resumes where it stopped.

    python scripts/train_planner.py train                # some hours on 2 cores, less with --half
    python scripts/train_planner.py export models/nano/planner.gguf
    python scripts/train_planner.py evaluate

Rooms come from the generator (seeds of their own) and, where the reference data lies beside the
project, from AI2-THOR floor plans; phrasing from our phrase book and ALFRED's annotators. The test
tasks' rooms and their (object, receptacle) pairs stay out.
"""

import os
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console

from karma import registry
from karma.agent.program import parse_program
from karma.agent.prompt import Facts, compact
from karma.bench.episode import run_episode
from karma.errors import FileError, ProgramError
from karma.files import read_json, to_json, write_atomic
from karma.infer.manifest.manifest import resolve_planner
from karma.methods.expert import ExpertMethod
from karma.offline import go_offline
from karma.seeds import stream
from karma.tasks.authors import load_authors_tasks
from karma.tasks.drawing import rooms
from karma.tasks.drawing.alfred import Facts as ReadFacts
from karma.tasks.drawing.alfred import Sentence, StepSentence, facts_of, read_sentences, read_steps
from karma.tasks.drawing.phrases import Book, our_book, with_alfred
from karma.tasks.drawing.recollections import Room
from karma.tasks.drawing.stories import Kind, Step, draw_story
from karma.tasks.files import load_tasks
from karma.training.planner.checkpoints import last_step, load_weights
from karma.training.planner.network import first_embeddings
from karma.training.planner.packs import END, PAD, Data, Recipe, make_tokenizer, plain
from karma.training.planner.samples import Example, draw
from karma.training.planner.train import exact_share, train
from karma.world.generation.generate import build_scene
from karma.world.importing.scenes import import_dump

WATCHED = 25  # one of so many of ALFRED's trials is kept out of training, to watch it
ROOT = Path(__file__).parents[1]
SHARED = Path(os.environ.get("KARMA_SHARED", ROOT.parent / "shared"))
KINDS: tuple[Kind, ...] = ("simple", "composite", "complex")
TASKS = (ROOT / "eval" / "alfred_l" / "tasks.jsonl",)
Folder = Annotated[Path, typer.Option(help="Checkpoints, tokenizer and rooms.")]
FOLDER = ROOT / "runs" / "planner"

app = typer.Typer(add_completion=False, no_args_is_help=True)
console = Console()


def gather_rooms(folder: Path, recipe: Recipe, generated: int) -> list[Room]:
    """Return the training rooms, made once and kept in the folder."""
    path = folder / "rooms.json"
    if path.exists():
        return read_json(path, list[Room])
    console.print(f"making {generated} rooms ...")
    found = list(rooms.generated_rooms(generated, recipe.seed + 77))
    dumps = SHARED / "data" / "thor5" / "scenes.jsonl.gz"
    if dumps.exists():
        layouts = SHARED / "data" / "alfred" / "layouts.json.gz"
        found += rooms.imported_rooms(dumps, layouts, recipe.seed)
    else:
        console.print(f"no floor plans at {dumps}: generated rooms only")
    write_atomic(path, to_json(found))
    return found


def gather_book() -> Book:
    """Return our phrases, with ALFRED's where the demonstrations lie beside the project."""
    path = SHARED / "data" / "alfred" / "train.jsonl.gz"
    if path.exists():
        return with_alfred(our_book(), path)
    console.print(f"no demonstrations at {path}: our own phrases only")
    return our_book()


def gather_sentences(*, held_out: bool) -> tuple[Sentence, ...]:
    """Return ALFRED's goal sentences of one side; () where the demonstrations are missing."""
    path = SHARED / "data" / "alfred" / "train.jsonl.gz"
    if not path.exists():
        return ()
    every = read_sentences(path)
    return tuple(s for n, s in enumerate(every) if (n // 3 % WATCHED == 0) == held_out)


def gather_steps() -> tuple[StepSentence, ...]:
    """Return what ALFRED's annotators said of single steps; () where they are missing."""
    path = SHARED / "data" / "alfred" / "train.jsonl.gz"
    return read_steps(path) if path.exists() else ()


def test_sentences() -> frozenset[str]:
    """Return every instruction of the test tasks, of ours and of the authors'."""
    found = [
        sub.instruction for path in TASKS for task in load_tasks(path) for sub in task.subtasks
    ]
    files = [SHARED / "data" / "alfred_l" / f"{kind}_tasks.json" for kind in KINDS]
    tasks = load_authors_tasks([path for path in files if path.exists()])
    found += [sub.instruction for task in tasks for sub in task.subtasks]
    return frozenset(plain(text) for text in found)


def held_out_packs(recipe: Recipe, book: Book, count: int) -> list[list[Example]]:
    """Return packs over rooms and phrasings that training never sees."""
    found = list(rooms.generated_rooms(24, recipe.seed + 78))
    packs = []
    for number in range(count):
        rng = stream(recipe.seed, "planner", "held-out", str(number))
        room = found[int(rng.integers(len(found)))]
        mapped = bool(rng.random() < recipe.mapped)
        packs.append([draw(rng, room, book, mapped=mapped) for _ in range(recipe.examples)])
    return packs


def gather_tokenizer(folder: Path, recipe: Recipe, data: Data) -> Any:
    """Return the tokenizer, trained once and kept in the folder."""
    from tokenizers import Tokenizer

    path = folder / "tokenizer.json"
    if not path.exists():
        console.print("training the tokenizer ...")
        write_atomic(path, make_tokenizer(recipe, data, 1500).to_str().encode())
    return Tokenizer.from_file(str(path))


def gather_embeddings(folder: Path, recipe: Recipe, tokenizer: Any) -> Any:
    """Return the token embeddings to start from, made once and kept in the folder."""
    from safetensors.numpy import load, save

    path = folder / "embeddings.safetensors"
    if not path.exists():
        console.print("embedding the vocabulary ...")
        found = first_embeddings(recipe, tokenizer, registry.load("embedders", "minilm")())
        write_atomic(path, save({"tokens": found}))
    return load(path.read_bytes())["tokens"]


@app.command("train")
def train_command(
    folder: Folder = FOLDER,
    steps: int = Recipe().steps,
    seed: int = 0,
    device: str = "cpu",
    workers: Annotated[int, typer.Option(help="Processes of one thread each.")] = 2,
    generated: int = 300,
    half: Annotated[bool, typer.Option(help="bfloat16, where the processor has it.")] = False,
    rate: Annotated[float, typer.Option(help="Learning rate.")] = Recipe().learning_rate,
    decay: Annotated[
        float, typer.Option(help="Share of the steps in which it falls.")
    ] = Recipe().decay,
    packs: Annotated[int, typer.Option(help="Packs per step.")] = Recipe().packs,
) -> None:
    """Train, or go on training from the last checkpoint."""
    import torch

    folder.mkdir(parents=True, exist_ok=True)
    recipe = Recipe(seed=seed, steps=steps, half=half, learning_rate=rate, decay=decay, packs=packs)
    book = gather_book()
    data = gather_data(folder, recipe, book, generated)
    gather_embeddings(folder, recipe, gather_tokenizer(folder, recipe, data))
    if workers == 1:
        train_share(0, 1, folder, recipe, device, generated)
    else:
        with tempfile.TemporaryDirectory() as meeting:
            arguments = (workers, folder, recipe, device, generated, f"file://{meeting}/point")
            torch.multiprocessing.spawn(train_share, arguments, nprocs=workers)  # type: ignore[attr-defined,no-untyped-call]


def gather_data(folder: Path, recipe: Recipe, book: Book, generated: int) -> Data:
    """Return rooms and phrases of the training side."""
    return Data(
        rooms=gather_rooms(folder, recipe, generated),
        book=book.part(held_out=False),
        excluded=rooms.asked_pairs(TASKS),
        alfred=gather_sentences(held_out=False),
        steps=gather_steps(),
        forbidden=test_sentences(),
    )


def train_share(
    rank: int,
    workers: int,
    folder: Path,
    recipe: Recipe,
    device: str,
    generated: int,
    meeting: str = "",
) -> None:
    """Train as one of several processes; each step's examples are shared out among them."""
    import torch

    torch.set_num_threads(1)
    if workers > 1:
        torch.distributed.init_process_group(
            "gloo", init_method=meeting, rank=rank, world_size=workers
        )
    book = gather_book()
    data = gather_data(folder, recipe, book, generated)
    tokenizer = gather_tokenizer(folder, recipe, data)
    recipe = replace(recipe, vocabulary=tokenizer.get_vocab_size())
    write_atomic(folder / "recipe.json", to_json(recipe, indent=2))
    held_out = held_out_packs(recipe, our_book().part(held_out=True), 48)
    if rank == 0 and (done := last_step(folder)):
        console.print(f"going on from step {done}")
    start = time.monotonic()
    lines = train(
        recipe,
        data,
        held_out,
        tokenizer,
        folder,
        device=device,
        share=(rank, workers),
        embeddings=gather_embeddings(folder, recipe, tokenizer),
    )
    for line in lines:
        seconds = time.monotonic() - start
        console.print(
            f"step {line.step}/{recipe.steps}  loss {line.loss:.4f}  held-out {line.exact:.3f}  "
            f"tokens {line.tokens * workers / 1e6:.1f}M  {seconds / 60:.1f} min"
        )


@app.command()
def export(
    path: Path,
    folder: Folder = FOLDER,
    dtype: str = "F16",
) -> None:
    """Write the last checkpoint as GGUF."""
    from tokenizers import Tokenizer

    from karma.infer.llama.gguf_export import export_llama_gguf

    recipe = read_json(folder / "recipe.json", Recipe)
    export_llama_gguf(
        load_weights(folder, recipe),
        Tokenizer.from_file(str(folder / "tokenizer.json")),
        path,
        name="karma-nano-planner",
        eos_token=END,
        pad_token=PAD,
        dtype=dtype,  # type: ignore[arg-type]
        licence="Apache-2.0",
        description="(memory, instruction) -> program of skill calls; scripts/train_planner.py",
    )
    console.print(f"{path}  {path.stat().st_size / 1e6:.1f} MB")


@app.command()
def evaluate(
    folder: Folder = FOLDER,
    packs: int = 100,
    seed: int = 1,
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
    read alone, or with --mapped by an agent that knows the room from an earlier exploration.
    """
    if alfred is not None:
        _evaluate_alfred(alfred, planner, wrong, _known_plans() if mapped else None)
        return
    from tokenizers import Tokenizer

    recipe = replace(read_json(folder / "recipe.json", Recipe), seed=seed)
    model = load_weights(folder, recipe)
    tokenizer = Tokenizer.from_file(str(folder / "tokenizer.json"))
    examples = [
        example
        for pack in held_out_packs(recipe, our_book().part(held_out=True), packs)
        for example in pack
    ]
    for kind, count in sorted(Counter(example.kind for example in examples).items()):
        singles = [[example] for example in examples if example.kind == kind]
        share = exact_share(model, tokenizer, singles, "cpu")
        console.print(f"{kind:12} {count:4}  exact {share:.3f}")


def _known_plans() -> dict[str, Room]:
    """Return floor plan -> what an agent knows of it that overlooked nothing."""
    dumps = SHARED / "data" / "thor5" / "scenes.jsonl.gz"
    layouts = SHARED / "data" / "alfred" / "layouts.json.gz"
    scenes = import_dump(dumps, layouts=layouts)
    return {scene.name: rooms.room_of(scene, scene.name, keep=1.0) for scene in scenes}


def _evaluate_alfred(path: Path, planner: str, wrong: int, plans: dict[str, Room] | None) -> None:
    """Print how many of the file's goal sentences are read right, without short-term memory.

    With `plans` a sentence is read with the map of its room; those whose room is not among them
    are left out.
    """
    file = resolve_planner(planner)
    model = registry.load("language_models", "llama")(
        file.path, n_ctx=file.context_length or 2048, n_threads=1, name=file.name
    )
    right: Counter[str] = Counter()
    parts: Counter[str] = Counter()
    seconds = []
    sentences = [
        sentence
        for sentence in read_sentences(path)
        if plans is None or sentence.floor_plan in plans
    ]
    for sentence in sentences:
        areas = plans[sentence.floor_plan].areas if plans else ()
        prompt = compact(Facts(instruction=sentence.text, areas=areas)).prompt
        begun = time.perf_counter()
        said = model.complete(prompt, spec=None, max_tokens=256, temperature=0.0, seed=0)
        seconds.append(time.perf_counter() - begun)
        found, truth = _facts_of(said.text), sentence.facts
        right[truth.task] += found == truth
        if found is not None:
            for name in ("task", "thing", "movable", "place", "sliced"):
                parts[name] += getattr(found, name) == getattr(truth, name)
        if found != truth and wrong > 0:
            wrong -= 1
            console.print(f"{sentence.text!r}\n  is   {truth}\n  read {found}", highlight=False)
    of = Counter(sentence.facts.task for sentence in sentences)
    for task, count in sorted(of.items()):
        console.print(f"{task:8} {count:4}  exact {right[task] / count:.3f}")
    for name, count in parts.items():
        console.print(f"{name:8}       right {count / len(sentences):.3f}")
    total = len(sentences)
    console.print(
        f"all      {total:4}  exact {sum(right.values()) / total:.3f}  "
        f"median {np.median(seconds):.3f} s an instruction"
    )


def _facts_of(text: str) -> ReadFacts | None:
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
) -> None:
    """Draw tasks of rooms and phrasings that training never sees, each done once by the expert."""
    book = our_book().part(held_out=True)
    world = registry.load("worlds", "embedded")()
    drawn = list(_draw_homes(folder, seed, homes))
    lines: list[dict[str, Any]] = []
    tried = 0
    for kind in KINDS:
        found = 0
        while found < each:
            rng = stream(seed, "tasks", kind, str(tried))
            path, room = drawn[tried % len(drawn)]
            tried += 1
            steps = draw_story(rng, room, book, kind)
            line = _task_line(f"{kind}-{found + 1:03}", kind, path, steps) if steps else None
            if line is not None and _can_be_done(line, world, folder):
                lines.append(line)
                found += 1
    write_atomic(folder / "tasks.jsonl", b"".join(to_json(line) + b"\n" for line in lines))
    console.print(
        f"{len(lines)} tasks in {len(drawn)} rooms, of {tried} drawn: {folder}/tasks.jsonl"
    )


def _draw_homes(folder: Path, seed: int, homes: int) -> Iterator[tuple[Path, Room]]:
    """Yield rooms of seeds of their own, each written as a scene file."""
    order = ("kitchen", "living", "kitchen", "bedroom", "kitchen", "bathroom")
    for number in range(homes):
        kind = order[number % len(order)]
        scene = build_scene(kind, 5000 + number, seed + 79)
        path = folder / "scenes" / f"{scene.name}.json"
        write_atomic(path, to_json(scene))
        yield path, rooms.room_of(scene, scene.name, keep=1.0)


def _task_line(name: str, kind: str, scene: Path, steps: Sequence[Step]) -> dict[str, Any]:
    subtasks = [
        {
            "instruction": f"{step.text[0].upper()}{step.text[1:]}.",
            "goals": [str(goal).removesuffix(": 1") for goal in step.goals],
        }
        for step in steps
    ]
    return {"id": name, "kind": kind, "scene": str(scene), "subtasks": subtasks}


def _can_be_done(line: dict[str, Any], world: Any, folder: Path) -> bool:
    """Return whether the expert, knowing everything, does it in the world."""
    path = folder / "one.jsonl"
    write_atomic(path, to_json(line))
    try:
        (task,) = load_tasks(path)
    except FileError:
        return False  # the type table lets nothing of the kind in there
    finally:
        path.unlink()
    record = run_episode(ExpertMethod(), world, task, row="expert", seed=0, folder=folder)
    return not record.error and not any(sub.unmet for sub in record.subtasks)


if __name__ == "__main__":
    go_offline()
    app()
