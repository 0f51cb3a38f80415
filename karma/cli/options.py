"""Commands as dataclasses: a field is an option, with its default and its help."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import partial, update_wrapper
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import typer

from karma.errors import KarmaError

if TYPE_CHECKING:
    from karma.infer.hosted.cassette import Cassette
    from karma.infer.hosted.endpoint import Hosted


class Command(Protocol):
    """A dataclass of what was typed."""

    def do(self) -> None:
        """Carry the command out."""


def option(usual: Any, text: str, *names: str, panel: str | None = None, **how: Any) -> Any:
    """Return the default of a field that is an option.

    Args:
        usual: its default; ... where it must be given.
        text: its help.
        names: in place of the field's own.
        panel: of the help; the first one unless told otherwise.
        how: more of `typer.Option`.
    """
    return typer.Option(usual, *names, help=text, rich_help_panel=panel, **how)


def as_function(kind: type[Command]) -> Callable[..., None]:
    """Return a command as Typer takes it: a function with the parameters of the dataclass."""

    def typed(**given: Any) -> None:
        kind(**given).do()

    return update_wrapper(typed, kind, assigned=("__doc__",), updated=())


_computed = partial(option, None, panel="How models are computed")


@dataclass(frozen=True, kw_only=True)
class Computed:
    """How models are computed: keys of [models] in an experiment; None where nothing is said."""

    gpu_layers: str | None = _computed(
        'On a GPU: "auto", all that fit, or a number; 0: on the CPU.'
    )
    n_ctx: int | None = _computed("Context of a GGUF in tokens, at most; else as its prompts need.")
    flash_attention: str | None = _computed('"on", "off" or "auto": on a GPU.')
    kv: str | None = _computed('Kept keys and values: "f16", "f32" or "q8_0".')
    threads: int | None = _computed("Of a GGUF on the CPU; results do not depend on it.")
    device: str | None = _computed('Of torch models: "auto", "cpu", "cuda", "cuda:1", "mps".')
    dtype: str | None = _computed('Of torch models: "auto", "float32", "bfloat16", "float16".')

    @property
    def computed(self) -> dict[str, Any]:
        """The keys of [models] that were given."""
        said = {one.name: getattr(self, one.name) for one in fields(Computed)}
        layers = self.gpu_layers
        if layers is not None and layers.lstrip("-").isdecimal():
            said["gpu_layers"] = int(layers)
        return {name: value for name, value in said.items() if value is not None}


@dataclass(frozen=True, kw_only=True)
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
        from karma.infer.hosted.endpoint import Hosted

        if planner != OPENAI and not (self.base_url or model):
            return Hosted()
        if planner != OPENAI or not (self.base_url and model):
            raise KarmaError(f"--planner {OPENAI}, --base-url and --model go together")
        return Hosted.of_planner(self.base_url, model, **settings)
