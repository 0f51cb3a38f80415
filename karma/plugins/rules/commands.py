"""Commands of the plug-in `rules`."""

from karma.cli.commands import ACTING, CommandSpec

COMMANDS = (
    CommandSpec("read", "Show how a request is parsed.", "karma.plugins.rules.read_command:read",
                ACTING),
)  # fmt: skip
