"""`karma vlm eval`: any vision model held against the world's truth."""

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from karma.agent.journal.formats import figure_text
from karma.cli.progress import bar
from karma.cli.shared import Json, console, write_json
from karma.files import write_atomic


def vlm_eval(
    model: Annotated[
        str, typer.Option(help='Name in the manifest, or a folder; "llama:..." for two .gguf.')
    ] = "karma-nano-vlm",
    frames: Annotated[int, typer.Option(min=1, help="Frames to ask about.")] = 320,
    rooms: Annotated[
        list[str] | None,
        typer.Option(help='Scenes or scene files, or "fresh"; all that ship and fresh ones.'),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of what is drawn.")] = 0,
    json: Json = None,
    html: Annotated[Path | None, typer.Option(help="Also write a page with the failures.")] = None,
) -> None:
    """Score a vision model on frames of rooms that its training never saw."""
    from karma.infer.llama.vision import LlamaVision
    from karma.infer.vision.transformers import TransformersVision
    from karma.train.vision.score import Clock, examine, held_out_rooms, page, score

    with console.status(escape(f"loading {model} ...")):
        pair = model.removeprefix("llama:")
        vision = TransformersVision(model) if pair == model else LlamaVision(pair)
        places = held_out_rooms(rooms or (), seed)
    clock = Clock()
    asked = []
    answers = examine(vision, places, frames=frames, seed=seed, clock=clock)
    with bar(passing=True) as progress:
        shown = progress.add_task("asking ...", total=frames)
        for one in answers:
            asked.append(one)
            progress.update(shown, completed=clock.frames)
    found = score(asked, model=vision.name, seed=seed, clock=clock)
    _show(found)
    write_json(json, found)
    if html is not None:
        write_atomic(html, page(found, asked).encode())
        console.print(escape(f"page: {html}"))


def _show(found: Any) -> None:
    table = Table(title=escape(f"{found.model}: {found.frames} frames, {found.objects} questions"))
    table.add_column("state")
    for name in ("true of", "precision", "recall", "F1"):
        table.add_column(name, justify="right")
    for word, line in found.words.items():
        figures = (figure_text(value, 3) for value in (line.precision, line.recall, line.f1))
        table.add_row(word, str(line.support), *figures)
    console.print(table)
    console.print(
        f"macro-F1 {figure_text(found.macro_f1, 3)} · accuracy {figure_text(found.accuracy, 3)} · "
        f"of objects filling 2 % of the frame {figure_text(found.large.value, 3)} "
        f"({found.large.of}) · "
        f"no usable answer {found.unanswered}"
    )
    frame, thing = (figure_text(ms, 0) for ms in (found.ms_per_frame, found.ms_per_object))
    console.print(f"ms per frame {frame}, per object {thing}")
