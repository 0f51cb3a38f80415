"""The options by which commands say where models are and how they compute; each stands once."""

import inspect
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from karma.errors import KarmaError

if TYPE_CHECKING:
    from karma.infer.hosted.cassette import Cassette
    from karma.infer.hosted.session import Hosted

CassetteFolder = Annotated[
    Path | None, typer.Option("--cassette", help="Folder that hosted models are recorded in.")
]
CassetteMode = Annotated[
    str, typer.Option(help='"record", "replay" (asks nobody) or "off"; default: replay a cassette.')
]
States = Annotated[
    Path | None, typer.Option(help="Folder to keep what a local planner computed of rooms.")
]
BaseUrl = Annotated[str, typer.Option(help="Of hosted models, e.g. http://127.0.0.1:8000/v1.")]

OPTIONS: tuple[tuple[str, type, str], ...] = (  # keys of [models] in an experiment
    ("gpu_layers", str, 'On a GPU: "auto", all that fit, or a number; 0: on the CPU.'),
    ("n_ctx", int, "Context of a GGUF in tokens, at most; else as its prompts need."),
    ("flash_attention", str, '"on", "off" or "auto": on a GPU.'),
    ("kv", str, 'Kept keys and values: "f16", "f32" or "q8_0".'),
    ("threads", int, "Of a GGUF on the CPU; results do not depend on it."),
    ("device", str, 'Of torch models: "auto", "cpu", "cuda", "cuda:1", "mps".'),
    ("dtype", str, 'Of torch models: "auto", "float32", "bfloat16", "float16".'),
)
PANEL = "How models are computed"


def model_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command all of `OPTIONS`; it takes those that were used as its `computed`."""

    @wraps(command)
    def wrapped(*args: Any, **kwargs: Any) -> None:
        given = {name: kwargs.pop(name) for name, _, _ in OPTIONS}
        layers = given["gpu_layers"]
        if layers is not None and layers.lstrip("-").isdecimal():
            given["gpu_layers"] = int(layers)
        used = {name: value for name, value in given.items() if value is not None}
        command(*args, computed=used, **kwargs)

    own = inspect.signature(command)
    parts = [one for one in own.parameters.values() if one.name != "computed"]
    for name, kind, text in OPTIONS:
        option = typer.Option(help=text, rich_help_panel=PANEL)
        annotation = cast("Any", Annotated)[kind | None, option]
        parts.append(
            inspect.Parameter(
                name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation
            )
        )
    wrapped.__signature__ = own.replace(parameters=parts)  # type: ignore[attr-defined]
    wrapped.__annotations__ = {one.name: one.annotation for one in parts}
    return wrapped


def hosted_of(planner: str, base_url: str, model: str, **settings: str) -> "Hosted":
    """Return where the planner is, if it is a hosted one."""
    from karma.infer.hosted.session import Hosted
    from karma.loading.models import OPENAI

    if planner != OPENAI and not (base_url or model):
        return Hosted()
    if planner != OPENAI or not (base_url and model):
        raise KarmaError(f"--planner {OPENAI}, --base-url and --model go together")
    return Hosted.of_planner(base_url, model, **settings)


def cassette_of(folder: Path | None, mode: str) -> "Cassette":
    """Return the cassette that a command asks for; a folder alone is replayed."""
    from karma.infer.hosted.cassette import MODES, Cassette

    wanted = mode or ("replay" if folder is not None else "off")
    for known in MODES:
        if known == wanted:
            return Cassette(folder, known)
    raise KarmaError(f"no cassette mode {mode!r}; there are {', '.join(MODES)}")
