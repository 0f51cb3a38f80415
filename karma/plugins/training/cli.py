"""`karma models tune` and `karma vlm eval`."""

from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Table

from karma.cli.parameters import argument, option
from karma.cli.progress import bar
from karma.cli.shared import Json, console, tell, write_json
from karma.journal.formats import figure_text


def models_tune(
    examples: Path = argument(..., 'JSONL, a line {"messages": [...]}.'),
    out: Path = argument(..., "Folder for adapter, checkpoints and tuned.gguf."),
    base: str = option("smollm2-135m", "A GGUF, or its name; llama or qwen2."),
    watch: Path | None = option(None, "Examples to score at the end, not trained on."),
    rank: int = option(24, "Of the change of each matrix.", min=1),
    rate: float = option(2e-3, "Learning rate at its highest."),
    steps: int = option(0, "0: once over the examples.", min=0),
    tokens: int = option(32_768, "Tokens a step.", min=64),
    plain: bool = option(False, "Without the GGUF's chat template."),
    minutes: float = option(0.0, "Stop at a checkpoint after these; 0: no bound.", min=0),
    seed: int = option(0, "Of order and adapter.", min=0),
) -> None:
    """Tune a GGUF on examples of your own; called again, it resumes from its last checkpoint.

    On processors some 42 tokens a second and core; a GPU is used where torch finds one.
    """
    from karma.models.llama.gguf_files import merge_adapter
    from karma.models.manifest import find_model, is_gguf_path, verify
    from karma.plugins.training.tuning import ADAPTER, ADAPTER_CONFIG, TuningRecipe, tune_file

    weights = Path(base) if is_gguf_path(base) else verify(find_model(base))[0]
    recipe = TuningRecipe(
        seed=seed, rank=rank, alpha=2 * rank, rate=rate, steps=steps, tokens=tokens, minutes=minutes
    )
    found = tune_file(weights, examples, out, recipe, watched=watch, plain=plain)
    place = out / "tuned.gguf"
    files = (weights, out / ADAPTER, out / ADAPTER_CONFIG)
    merge_adapter(*files, place, name=out.name, keeps_template=not plain)
    if found:
        exact, loss = figure_text(found["exact"], 3), figure_text(found["loss"], 4)
        tell(f"of what is watched {exact} right to the letter, loss {loss}")
    how = "compact --set models.chat=false" if plain else "tools"
    tell(f"tuned: {place}; `karma run --planner {place} --profile {how} REQUEST`")


def vlm_eval(
    model: str = option(
        "karma-nano-vlm", 'Name in the manifest, or a folder; "llama:..." for two .gguf.'
    ),
    frames: int = option(320, "Frames to ask about.", min=1),
    rooms: list[str] | None = option(
        None, 'Scenes or scene files, or "fresh"; all that ship and fresh ones.'
    ),
    seed: int = option(0, "Of the sampled rooms and frames.", min=0),
    json: Json = None,
) -> None:
    """Score a vision model on frames of rooms that its training never saw."""
    from karma.models.llama.vision import LlamaVision
    from karma.plugins.training.vision_score import examine, held_out_rooms, score
    from karma.plugins.vision.vlm import TransformersVision

    with console.status(escape(f"loading {model} ...")):
        pair = model.removeprefix("llama:")
        vision = TransformersVision(model) if pair == model else LlamaVision(pair)
        places = held_out_rooms(rooms or (), seed)
    asked = []
    with bar(passing=True) as progress:
        shown = progress.add_task("asking ...", total=frames)
        for frame in examine(vision, places, frames=frames, seed=seed):
            asked.append(frame)
            progress.update(shown, completed=len(asked))
    found = score(asked, model=vision.name, seed=seed)
    _show_score(found)
    write_json(json, found)


def _show_score(found: Any) -> None:
    table = Table(title=escape(f"{found.model}: {found.frames} frames, {found.objects} objects"))
    table.add_column("state")
    for name in ("true of", "precision", "recall", "F1"):
        table.add_column(name, justify="right")
    for word, line in found.words.items():
        figures = (figure_text(value, 3) for value in (line.precision, line.recall, line.f1))
        table.add_row(word, str(line.support), *figures)
    console.print(table)
    console.print(
        f"macro-F1 {figure_text(found.macro_f1, 3)} · accuracy {figure_text(found.accuracy, 3)} · "
        f"of objects filling 2 % of the frame {figure_text(found.large_accuracy, 3)} · "
        f"no usable answer {found.unanswered} · {figure_text(found.ms_per_object, 0)} ms an object"
    )
