"""`karma home`: the homes that are kept, and what was done in each."""

from typing import Annotated

import typer

from karma.cli.shared import tell

Name = Annotated[str, typer.Argument(help="A home's name or folder.")]


def home_list() -> None:
    """List the homes that are kept here."""
    from karma.talk.home import HOMES, homes

    for folder in homes():
        tell(folder.name)
    if not homes():
        tell(f"no home in {HOMES}; karma chat makes one")


def home_new(
    name: Name,
    scene: Annotated[str, typer.Option(help="A room's name, or a scene's file.")] = "",
    people: Annotated[int, typer.Option(help="Who live there while the agent is away.")] = 0,
) -> None:
    """Begin a home, which nobody has been in yet."""
    from karma.talk.home import home_folder, new_home
    from karma.talk.people import check_people
    from karma.world.sim import EmbeddedWorld

    check_people(people)
    home = new_home(home_folder(name), scene, EmbeddedWorld(), people=people)
    tell(f"{home.folder}: {home.scene}; karma chat --home {name}")


def home_show(name: Name) -> None:
    """Say what was done in a home, the last ten requests."""
    from karma.talk.home import opened
    from karma.talk.questions import age

    home = opened(name)
    people = f", {home.card.people} people" if home.card.people else ""
    tell(f"{home.folder}: {home.scene}{people}, {len(home.past)} requests")
    for one in home.past[-10:]:
        tell(f"  {age(home.clock_s - one.at_s)}: {one.said} ({one.status})")


def home_forget(name: Name) -> None:
    """Remove a home and all that was remembered there."""
    from karma.talk.home import forget_home, home_folder

    forget_home(home_folder(name))
    tell(f"forgotten: {home_folder(name)}")
