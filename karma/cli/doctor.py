"""`karma doctor` and `karma bundle`: what a machine needs, and how it comes over the air gap."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import typer
from rich.box import HORIZONTALS
from rich.markup import escape
from rich.table import Table

from karma.cli.shared import Computed, Json, argument, console, option, write_json
from karma.errors import KarmaError
from karma.journal.formats import UNKNOWN, figure_text

if TYPE_CHECKING:
    from karma.bench.engine.model_doctor import ModelSeen
    from karma.world.thor.builds import CheckResult

MARKS = {"ok": "[green]ok[/]", "note": "[yellow]note[/]", "problem": "[red]problem[/]"}


def doctor(
    context: typer.Context,
    json: Json = None,
) -> None:
    """Check what a run without a network needs here; exit code 1 if something is missing."""
    if context.invoked_subcommand is not None:
        return
    from karma.cli import conditions
    from karma.offline.guard import DEFAULTS, SWITCHES
    from karma.world.thor.builds import CheckResult

    with console.status("looking; models are hashed ..."):
        findings = conditions.examine()
    switches = [one for one in findings if one.name in {**SWITCHES, **DEFAULTS}]
    right = [one for one in switches if one.status == "ok"]
    summed = CheckResult.of(
        "switches of libraries", True, f"{len(right)} of {len(switches)} are set"
    )
    rest = [one for one in findings if one not in right]
    good = _show("a run without a network", [*rest, summed])
    _end(good, "ready to run offline", {"findings": findings}, json)
    console.print("for the real AI2-THOR: karma doctor thor")


def _show(title: str, findings: "Sequence[CheckResult]") -> bool:
    """Print conditions, and what mends those that do not hold; return whether all do."""
    table = Table("", "what", "found", title=title, title_justify="left")
    for one in findings:
        table.add_row(MARKS[one.status], escape(one.name), escape(one.found))
    console.print(table)
    for one in findings:
        if one.fix:
            _note(one.status, f"{one.name}: {one.fix}")
    return all(one.status != "problem" for one in findings)


def _end(good: bool, words: str, figures: Mapping[str, Any], json: Path | None) -> None:
    """Say whether something is missing; exit code 1 if so."""
    console.print(f"[green]{words}[/]" if good else "[red]something is missing[/]")
    write_json(json, {"ok": good, **figures})
    if not good:
        raise typer.Exit(1)


@dataclass(frozen=True, kw_only=True)
class ModelsCommand(Computed):
    """See what each model runs on here, its memory and speed, and what to change.

    Each is opened as a run does and asked a little. Exit code 1 if one cannot be opened.
    """

    experiment: Path | None = argument(None, "An experiment; else what `karma run` takes.")
    planner: str | None = option(None, "Another name or GGUF.")
    json: Json = None

    def do(self) -> None:
        """Open and ask each model."""
        from karma.bench.engine.experiment_file import read_experiment
        from karma.bench.engine.model_doctor import examine
        from karma.loading.models import Models

        models = Models() if self.experiment is None else read_experiment(self.experiment).models
        chosen = self.computed | ({} if self.planner is None else {"planner": self.planner})
        seen = []
        for name, look in examine(models.computed_by(chosen) if chosen else models):
            with console.status(escape(f"opening and asking {name} ...")):
                if (found := look()) is not None:
                    seen.append(found)
        console.print(_models_table(seen))
        for one in seen:
            for text in one.advice:
                _note("note", f"{one.role}: {text}")
            if one.error:
                _note("problem", f"{one.role}: {one.error}")
        write_json(self.json, seen)
        if any(one.error for one in seen):
            raise typer.Exit(1)


def _models_table(found: Sequence["ModelSeen"]) -> Table:
    table = Table("model", box=HORIZONTALS, title="models on this machine", title_justify="left")
    table.add_column("runs on", min_width=14)
    for name in ("MB", "a second", "context"):
        table.add_column(name, justify="right", no_wrap=True)
    for one in found:
        speeds = [
            f"{figure_text(rate, 0 if rate >= 10 else 1)} {unit.removesuffix('/s')}"
            for unit, rate in (one.speeds or {}).items()
        ]
        grows = one.limit and one.context and one.limit > one.context
        more = f"\nup to {one.limit}" if grows else ""
        table.add_row(
            f"[bold]{escape(one.name)}[/]\n{one.role}",
            "[red]does not open[/]" if one.error else f"[bold]{escape(one.device)}[/]\n{one.how}",
            figure_text(one.memory_mb, 0),
            "\n".join(speeds) or UNKNOWN,
            UNKNOWN if one.context is None else f"{one.context}{more}",
        )
    return table


def doctor_thor(
    executable: str | None = option(None, "File, folder or command; default $KARMA_THOR_BUILD."),
    platform: str | None = option(None, "Linux64 or CloudRendering; default by the name."),
    display: str | None = option(None, "X display; default $DISPLAY."),
    start: bool = option(False, "Also start it, load a scene, do a step.", "--start"),
    scene: str = option("FloorPlan1", "The scene for --start."),
    json: Json = None,
) -> None:
    """Look for what the real AI2-THOR needs; exit code 1 if something is missing.

    Looks at this machine only: no network, and nothing is started without --start.
    """
    from karma.world.thor.builds import PLATFORMS, examine

    if platform is not None and platform not in PLATFORMS:
        raise KarmaError(f"no platform {platform!r}; there are {', '.join(PLATFORMS)}")
    findings = examine(executable, platform, display)
    good = _show("AI2-THOR on this machine", findings)
    tried = _try(executable, platform, display, scene) if start else None
    good = good and not (tried or {}).get("error")
    _end(good, "all is there", {"findings": findings, "start": tried}, json)


def _try(executable: str | None, platform: Any, display: str | None, scene: str) -> dict[str, Any]:
    """Start the player, load one scene, do one step; return what came of it, seconds each."""
    from karma.agent.seeing.perceive import object_count
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
        _note("problem", f"start: {error}")
    finally:
        if world is not None:
            world.stop()
    return result


def _note(status: str, text: str) -> None:
    console.print(f"{MARKS[status]} {escape(text)}", soft_wrap=True)


def _timed(call: Any) -> float:
    begin = perf_counter()
    call()
    return perf_counter() - begin
