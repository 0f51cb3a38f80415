"""`karma home`: list, begin, show and forget homes."""

from typing import Annotated

import typer

from karma.cli.shared import option, tell
from karma.journal.formats import plural
from karma.plugins.homes.home import HOMES, forget_home, home_folder, homes, new_home, opened
from karma.plugins.rules.talk.remembering import age
from karma.world.sim import EmbeddedWorld

Name = Annotated[str, typer.Argument(help="A home's name or folder.")]


def home_list() -> None:
    """List the homes that are kept here."""
    for name in [one.name for one in homes()] or [f"no home in {HOMES}; karma chat makes one"]:
        tell(name)


def home_new(
    name: Name,
    scene: str = option("", "A room's name, or a scene's file."),
    people: int = option(0, "Who live there while the agent is away."),
) -> None:
    """Begin a home, which nobody has been in yet."""
    home = new_home(home_folder(name), scene, EmbeddedWorld(), people=people)
    tell(f"{home.folder}: {home.scene}; karma chat --home {name}")


def home_show(name: Name) -> None:
    """Say what was done in a home, the last ten requests."""
    home = opened(name)
    people = f", {home.card.people} people" if home.card.people else ""
    tell(f"{home.folder}: {home.scene}{people}, {plural(len(home.past), 'request')}")
    for one in home.past[-10:]:
        tell(f"  {age(home.clock_s - one.at_s)}: {one.said} ({one.status})")


def home_forget(name: Name) -> None:
    """Remove a home and all that was remembered there."""
    forget_home(home_folder(name))
    tell(f"forgotten: {home_folder(name)}")
