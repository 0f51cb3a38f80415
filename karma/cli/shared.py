"""What all commands share: the console, options, and how errors are shown.

A command with many options is a dataclass: a field is an option, with its default and its help.
"""

import sys
import traceback
import unicodedata
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, fields
from functools import partial, update_wrapper, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Protocol

import typer
from rich.console import Console, ConsoleOptions, RenderableType
from rich.markup import escape
from rich.segment import Segment
from rich.table import Table

from karma import registry
from karma.cli.parameters import argument as argument
from karma.cli.parameters import option as option
from karma.errors import KarmaError
from karma.files import to_json, write_atomic
from karma.offline.guard import settle

if TYPE_CHECKING:
    from karma.bench.figures.tables import Sheet
    from karma.models.endpoint import Hosted
    from karma.models.session import Cassette

_HARMLESS = frozenset("\n\t\u200d")  # the last joins the parts of one sign
_LONGEST = 2000  # characters of a line of an error: a quoted goal or name may have millions


def visible(text: str) -> str:
    r"""Return a text as a terminal may have it: what would steer it is shown, not done.

    Control characters, and those that turn the direction of writing, stand as their numbers.
    Names in markup are for `rich.markup.escape`.

    >>> visible("\x1b[2Jgone")
    '\\x1b[2Jgone'
    """
    if text.isascii() and text.isprintable():
        return text
    return "".join(
        ascii(sign)[1:-1]
        if unicodedata.category(sign) in ("Cc", "Cf", "Cs") and sign not in _HARMLESS
        else sign
        for sign in text
    )


class SafeConsole(Console):
    """A console that shows control characters in any text instead of obeying them."""

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """Render as any console does, then make the texts harmless; its own codes stay."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(visible(segment.text), segment.style)


console = SafeConsole()

DONE, FAILED, MISUSE, REFUSED, UNFINISHED, ASKED, STOPPED = 0, 1, 2, 3, 4, 5, 130  # exit codes


def _json_place(place: Path | None) -> Path | None:
    """Leave standard output to the figures where they go there."""
    console.stderr = place == Path("-")
    return place


Json = Annotated[
    Path | None,
    typer.Option(
        "--json", help='Also write the figures here; "-": alone on standard output.',
        callback=_json_place, allow_dash=True,
    ),
]  # fmt: skip


def tell(text: str, *, style: str = "") -> None:
    """Print a text as it is, however long its lines."""
    console.print(text, style=style, markup=False, highlight=False, soft_wrap=True)


def write_json(place: Path | None, figures: object) -> None:
    """Write figures where `Json` says, if it says anything; FileError where that cannot be."""
    if place is None:
        return
    data = to_json(figures, indent=2)
    if place == Path("-"):
        sys.stdout.write(data.decode())
    else:
        write_atomic(place, data)


def refuse_options(context: typer.Context, what: str, known: Collection[str]) -> None:
    """Raise KarmaError where a command was given an option that is not `known` to be of use.

    `what` it is about is such as "eval/demo.toml: such an experiment".
    """
    for one in context.command.params:
        source = context.get_parameter_source(one.name or "")
        given = source is not None and source.name == "COMMANDLINE" and one.opts[0].startswith("-")
        if given and one.name not in known:
            option = one.opts[0]
            raise KarmaError(f"{what} has no {option}\n  To fix: leave out {option}")


def readable(typed: str) -> str:
    """Return what was typed, of a terminal whose locale has ASCII only too: it sends UTF-8."""
    return typed.encode("utf-8", "surrogateescape").decode("utf-8", "replace")


def clear_errors(command: Callable[..., None]) -> Callable[..., None]:
    """Turn the package's errors into a message and exit code 1, Ctrl-C and its like into 130.

    Anything else is a bug: of a plug-in, which is named, or of ours. A refused attempt to reach the
    network is such an error also where a library has swallowed it.
    """

    @wraps(command)
    def wrapped(*args: Any, **kwargs: Any) -> None:
        try:
            try:
                command(*args, **kwargs)
            finally:
                settle()
        except KeyboardInterrupt as error:
            console.print("stopped", style="yellow")
            raise typer.Exit(STOPPED) from error
        except BrokenPipeError:  # Typer ends the command when nobody reads on
            raise
        except Exception as error:
            if (reason := _reason(error)) is None:
                raise
            _show(reason)
            raise typer.Exit(FAILED) from error

    return wrapped


def _reason(error: Exception) -> str | None:
    """Return what is said of an error; None of a bug of ours."""
    if isinstance(error, KarmaError):
        return str(error)
    if isinstance(error, MemoryError):
        return "there is not enough memory\n  To fix: take smaller models, or raise ulimit -v"
    if isinstance(error, OSError):  # of the machine: a full disk, no descriptors left
        return f"{error.filename}: " * bool(error.filename) + (error.strerror or str(error))
    if missing := registry.missing_package(error):
        return missing
    if not (named := registry.plug_in_of(error)):
        return None
    frames = traceback.extract_tb(error.__traceback__)[-4:]  # the innermost last
    places = "\n".join(f"  {one.filename}:{one.lineno} in {one.name}" for one in frames)
    said = f"{named} raised {type(error).__name__}: {error}"
    return f"{said}\n{places}\n  To fix: mend or uninstall that package"


def sheet_table(sheet: "Sheet") -> Table:
    """Return a sheet for the terminal; no figure is cut."""
    table = Table(title=escape(sheet.title), title_justify="left", caption=escape(sheet.caption))
    for number, name in enumerate(sheet.head):
        table.add_column(escape(name), justify="right" if number else "left", overflow="fold")
    for cells in sheet.lines:
        table.add_row(*map(escape, cells))
    return table


def _show(reason: str) -> None:
    lines = (one if len(one) < _LONGEST else f"{one[:_LONGEST]} ..." for one in reason.split("\n"))
    text = "[red]error:[/] " + escape("\n".join(lines))
    SafeConsole(stderr=True).print(text, highlight=False, soft_wrap=True)


# ----------------------------------------------------------------- commands that are dataclasses


class Command(Protocol):
    """A dataclass of what was typed."""

    def do(self) -> None:
        """Carry the command out."""


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
        'On a GPU: "auto", all that fit, or a number; 0: all models on the CPU.'
    )
    n_ctx: int | None = _computed("Context of a GGUF in tokens; else as its prompts need.")
    threads: int | None = _computed("Of a GGUF on the CPU; results do not depend on it.")

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
    """Where the exchanges with hosted models are kept."""

    cassette: Path | None = option(None, "Folder that hosted models are recorded in.")
    cassette_mode: str = option(
        "", '"record", "replay" (asks nobody) or "off"; default: replay a cassette.'
    )
    base_url: str = option("", "Of hosted models, e.g. http://127.0.0.1:8000/v1.")

    @property
    def tape(self) -> "Cassette":
        """The cassette that is asked for; a folder alone is replayed."""
        from karma.models.session import cassette_of

        return cassette_of(self.cassette, self.cassette_mode)

    def hosted(self, planner: str, model: str) -> "Hosted":
        """Return where the planner is, if it is a hosted one."""
        from karma.loading.models import OPENAI
        from karma.models.endpoint import Hosted

        if planner != OPENAI and not (self.base_url or model):
            return Hosted()
        if planner != OPENAI or not (self.base_url and model):
            raise KarmaError(f"--planner {OPENAI}, --base-url and --model go together")
        return Hosted.of_planner(self.base_url, model)
