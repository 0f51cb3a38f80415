"""`karma doctor`: what a backend needs, what is missing, and the command that mends it."""

import time
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from karma.cli.shared import Json, clear_errors, console
from karma.errors import KarmaError
from karma.files import to_json, write_atomic

app = typer.Typer()

MARKS = {"ok": "[green]ok[/]", "note": "[yellow]note[/]", "problem": "[red]problem[/]"}


@app.callback(invoke_without_command=True)
@clear_errors
def doctor(
    context: typer.Context,
    offline: Annotated[
        bool, typer.Option("--offline", help="That is what is looked at anyway.")
    ] = False,
    json: Json = None,
) -> None:
    """See what a run needs on this machine, what is missing, and what mends it."""
    if context.invoked_subcommand is not None:
        return
    _offline(json)
    if not offline:
        console.print("for the real AI2-THOR: karma doctor thor")


@app.command("offline")
@clear_errors
def offline_command(json: Json = None) -> None:
    """List every condition of a run without a network; exit code 1 if one does not hold."""
    _offline(json)


def _offline(json: Path | None) -> None:
    from karma.bundle import conditions
    from karma.offline import DEFAULTS, SWITCHES

    with console.status("looking; models are hashed ..."):
        findings = conditions.examine()
    good = conditions.holds(findings)
    table = Table("", "what", "found", title="a run without a network", title_justify="left")
    switches = [one for one in findings if one.name in {**SWITCHES, **DEFAULTS}]
    right = [one for one in switches if one.status == "ok"]
    for one in findings:
        if one not in right:
            table.add_row(MARKS[one.status], escape(one.name), escape(one.found))
    table.add_row(MARKS["ok"], "switches of libraries", f"{len(right)} of {len(switches)} are set")
    console.print(table)
    for one in findings:
        if one.fix and one.status != "ok":
            console.print(f"{MARKS[one.status]} {escape(f'{one.name}: {one.fix}')}", soft_wrap=True)
    console.print("[green]ready to run offline[/]" if good else "[red]something is missing[/]")
    if json is not None:
        write_atomic(json, to_json({"ok": good, "findings": findings}, indent=2))
    if not good:
        raise typer.Exit(1)


@app.command("thor")
@clear_errors
def thor(
    executable: Annotated[
        str | None, typer.Option(help="File, folder or command; default $KARMA_THOR_BUILD.")
    ] = None,
    platform: Annotated[
        str | None, typer.Option(help="Linux64 or CloudRendering; default by the name.")
    ] = None,
    display: Annotated[str | None, typer.Option(help="X display; default $DISPLAY.")] = None,
    start: Annotated[
        bool, typer.Option("--start", help="Also start it, load a scene, do a step.")
    ] = False,
    scene: Annotated[str, typer.Option(help="The scene for --start.")] = "FloorPlan1",
    json: Json = None,
) -> None:
    """Look for what the real AI2-THOR needs; exit code 1 if something is missing.

    Looks at this machine only: no network, and nothing is started without --start.
    """
    from karma.world.thor import checks
    from karma.world.thor.builds import PLATFORMS

    if platform is not None and platform not in PLATFORMS:
        raise KarmaError(f"no platform {platform!r}; there are {', '.join(PLATFORMS)}")
    findings = checks.examine(executable, platform, display)
    good = checks.works(findings)
    table = Table("", "what", "found", title="AI2-THOR on this machine", title_justify="left")
    for one in findings:
        table.add_row(MARKS[one.status], one.name, escape(one.found))
    console.print(table)
    for one in findings:
        if one.fix:
            console.print(f"{MARKS[one.status]} {one.name}: {escape(one.fix)}", soft_wrap=True)
    tried: dict[str, Any] | None = None
    if start:
        tried = _try(executable, platform, display, scene)
        good = good and not tried.get("error")
    console.print("[green]all is there[/]" if good else "[red]something is missing[/]")
    if json is not None:
        write_atomic(json, to_json({"ok": good, "findings": findings, "start": tried}, indent=2))
    if not good:
        raise typer.Exit(1)


def _try(executable: str | None, platform: Any, display: str | None, scene: str) -> dict[str, Any]:
    """Start the player, load one scene, do one step; return what came of it, seconds each."""
    from karma.agent.perceive import object_count
    from karma.world.thor.backend import ThorWorld

    result: dict[str, Any] = {"scene": scene}
    world = None
    try:
        world = ThorWorld(executable, platform=platform, display=display)
        with console.status("starting the player ..."):
            result["start_s"] = _timed(lambda: world.reset(scene))
            result["reset_s"] = _timed(lambda: world.reset(scene))
            result["step_s"] = _timed(lambda: world.step("RotateRight"))
        event = world.last_event
        result["objects"] = object_count(event)
        result["picture"] = None if event.frame is None else list(event.frame.shape)
        console.print(
            f"{MARKS['ok']} started in {result['start_s']:.2f} s, {escape(scene)} again in "
            f"{result['reset_s']:.2f} s, a step in {result['step_s'] * 1000:.1f} ms; "
            f"{result['objects']} objects, picture {result['picture']}"
        )
    except (KarmaError, ValueError, RuntimeError) as error:
        result["error"] = str(error)
        console.print(f"{MARKS['problem']} start: {escape(str(error))}", soft_wrap=True)
    finally:
        if world is not None:
            world.stop()
    return result


def _timed(call: Any) -> float:
    begin = time.perf_counter()
    call()
    return time.perf_counter() - begin
