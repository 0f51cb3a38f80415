"""Options of commands as fields of dataclasses: each stands once, with its default and its help."""

import inspect
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast, get_type_hints

import typer

from karma.errors import KarmaError

if TYPE_CHECKING:
    from karma.infer.hosted.cassette import Cassette
    from karma.infer.hosted.session import Hosted

COMPUTED = "How models are computed"


def option(usual: Any, text: str, *names: str, panel: str | None = None, **how: Any) -> Any:
    """Return a field that is an option.

    Args:
        usual: its default; ... where it must be given.
        text: its help.
        names: in place of the field's own.
        panel: of the help; the first one unless told otherwise.
        how: more of `typer.Option`.
    """
    made = typer.Option(*names, help=text, rich_help_panel=panel, **how)
    return field(default=usual, metadata={"option": made})


def taking(**groups: type) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command the fields of dataclasses as options; it takes the dataclasses by name."""

    def taken(command: Callable[..., None]) -> Callable[..., None]:
        @wraps(command)
        def wrapped(*args: Any, **kwargs: Any) -> None:
            for name, kind in groups.items():
                own = {one.name: kwargs.pop(one.name) for one in fields(kind)}
                kwargs[name] = kind(**own)
            command(*args, **kwargs)

        whole = inspect.signature(command)
        parts = [
            part
            for one in whole.parameters.values()
            for part in (_parameters(groups[one.name]) if one.name in groups else (one,))
        ]
        wrapped.__signature__ = whole.replace(parameters=parts)  # type: ignore[attr-defined]
        wrapped.__annotations__ = {one.name: one.annotation for one in parts}
        return wrapped

    return taken


def _parameters(kind: type) -> Iterator[inspect.Parameter]:
    types = get_type_hints(kind)
    for one in fields(kind):
        annotation = cast("Any", Annotated)[types[one.name], one.metadata.get("option")]
        usual = inspect.Parameter.empty if one.default is ... else one.default
        yield inspect.Parameter(
            one.name, inspect.Parameter.KEYWORD_ONLY, default=usual, annotation=annotation
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Computed:
    """How models are computed: keys of [models] in an experiment; None where nothing is said."""

    gpu_layers: str | None = option(
        None, 'On a GPU: "auto", all that fit, or a number; 0: on the CPU.', panel=COMPUTED
    )
    n_ctx: int | None = option(
        None, "Context of a GGUF in tokens, at most; else as its prompts need.", panel=COMPUTED
    )
    flash_attention: str | None = option(None, '"on", "off" or "auto": on a GPU.', panel=COMPUTED)
    kv: str | None = option(None, 'Kept keys and values: "f16", "f32" or "q8_0".', panel=COMPUTED)
    threads: int | None = option(
        None, "Of a GGUF on the CPU; results do not depend on it.", panel=COMPUTED
    )
    device: str | None = option(
        None, 'Of torch models: "auto", "cpu", "cuda", "cuda:1", "mps".', panel=COMPUTED
    )
    dtype: str | None = option(
        None, 'Of torch models: "auto", "float32", "bfloat16", "float16".', panel=COMPUTED
    )

    @property
    def keys(self) -> dict[str, Any]:
        """What was said."""
        said = {one.name: getattr(self, one.name) for one in fields(self)}
        layers = self.gpu_layers
        if layers is not None and layers.lstrip("-").isdecimal():
            said["gpu_layers"] = int(layers)
        return {name: value for name, value in said.items() if value is not None}


@dataclass(frozen=True, slots=True, kw_only=True)
class Kept:
    """Where what models said and computed is kept."""

    cassette: Path | None = option(None, "Folder that hosted models are recorded in.")
    cassette_mode: str = option(
        "", '"record", "replay" (asks nobody) or "off"; default: replay a cassette.'
    )
    states: Path | None = option(None, "Folder to keep what a local planner computed of rooms.")
    base_url: str = option("", "Of hosted models, e.g. http://127.0.0.1:8000/v1.")

    @property
    def tape(self) -> "Cassette":
        """The cassette that is asked for; a folder alone is replayed."""
        from karma.infer.hosted.cassette import MODES, Cassette

        wanted = self.cassette_mode or ("replay" if self.cassette is not None else "off")
        for known in MODES:
            if known == wanted:
                return Cassette(self.cassette, known)
        raise KarmaError(f"no cassette mode {self.cassette_mode!r}; there are {', '.join(MODES)}")

    def hosted(self, planner: str, model: str, **settings: str) -> "Hosted":
        """Return where the planner is, if it is a hosted one."""
        from karma.agent.loading.models import OPENAI
        from karma.infer.hosted.session import Hosted

        if planner != OPENAI and not (self.base_url or model):
            return Hosted()
        if planner != OPENAI or not (self.base_url and model):
            raise KarmaError(f"--planner {OPENAI}, --base-url and --model go together")
        return Hosted.of_planner(self.base_url, model, **settings)
