"""Commands of the plug-in `homes`."""

from karma.cli.commands import ACTING, CommandSpec

_MODULE = "karma.plugins.homes.home_commands"
COMMANDS = (
    CommandSpec("home", "Homes that last between sessions.", panel=ACTING),
    CommandSpec("home list", "List the homes that are kept here.", f"{_MODULE}:home_list"),
    CommandSpec("home new", "Begin a home.", f"{_MODULE}:home_new"),
    CommandSpec("home show", "Show the last ten requests.", f"{_MODULE}:home_show"),
    CommandSpec("home forget", "Remove a home and its memory.", f"{_MODULE}:home_forget"),
)
