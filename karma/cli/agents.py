"""`karma run` and `karma eval`: an agent at work, and experiments."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from karma.cli.benchmarks import do_benchmark, refuse_options
from karma.cli.model_options import model_options
from karma.cli.shared import ACTING, Json, clear_errors, console
from karma.errors import KarmaError
from karma.files import to_json, write_atomic

if TYPE_CHECKING:
    from rich.progress import Progress

    from karma.bench.presets import Preset
    from karma.bench.run import Run
    from karma.infer.hosted.cassette import Cassette
    from karma.infer.hosted.session import Hosted
    from karma.methods.karma import KarmaEpisode

CassetteFolder = Annotated[
    Path | None, typer.Option("--cassette", help="Folder that hosted models are recorded in.")
]
CassetteMode = Annotated[
    str, typer.Option(help='"record", "replay" (asks nobody) or "off"; default: replay a cassette.')
]
States = Annotated[
    Path | None, typer.Option(help="Folder to keep what a local planner computed of rooms.")
]
BaseUrl = Annotated[str, typer.Option(help="Of hosted models, e.g. http://127.0.0.1:8000/v1.")]


DONE, UNFINISHED, REFUSED = 0, 2, 3  # exit codes of `karma run`; 1 is an error


def add_to(app: typer.Typer) -> None:
    """Add the commands to the top level."""
    app.command("run", rich_help_panel=ACTING)(run_command)
    app.command("eval", rich_help_panel=ACTING)(eval_command)


@clear_errors
@model_options
def run_command(
    instruction: Annotated[str, typer.Argument(help="What to do, in plain words.")],
    scene: Annotated[str, typer.Option(help="A scene's name or file.")] = "kitchen_1",
    planner: Annotated[str, typer.Option(help="Name in the manifest, or a GGUF.")] = "karma-nano",
    profile: Annotated[str, typer.Option(help='"compact" or "full".')] = "",
    chat: Annotated[bool, typer.Option(help="Use the GGUF's chat template.")] = False,
    long_term: Annotated[bool, typer.Option(help="With long-term memory.")] = True,
    short_term: Annotated[bool, typer.Option(help="With short-term memory.")] = True,
    policy: Annotated[str, typer.Option(help='e.g. "fifo-merge[10]".')] = "wtinylfu-karma[9,1]",
    preset: Annotated[str, typer.Option(help='"paper": recall, K and query as in the paper.')] = "",
    recall: Annotated[str, typer.Option(help='"stateful" unless told otherwise.')] = "",
    recall_k: Annotated[
        int | None, typer.Option("--k", help="Units in the prompt; 3, or all with --profile full.")
    ] = None,
    vision: Annotated[
        str, typer.Option(help='"nano-vlm", "transformers:NAME" or "llama:NAME" read pictures.')
    ] = "metadata",
    perception: Annotated[
        str, typer.Option(help='"pictures": sees by boxes, depth and the vision model alone.')
    ] = "metadata",
    detector: Annotated[
        str, typer.Option(help='"grounded-sam:BOXES+MASKS" in place of given boxes.')
    ] = "",
    maps: Annotated[Path, typer.Option(help="Folder of long-term memories.")] = Path("runs/maps"),
    base_url: BaseUrl = "",
    model: Annotated[str, typer.Option(help="A hosted planner's, with --planner openai.")] = "",
    api: Annotated[str, typer.Option(help='"chat" or "completions" of it.')] = "chat",
    dialect: Annotated[str, typer.Option(help='Of its server, e.g. "vllm".')] = "auto",
    thinking: Annotated[str, typer.Option(help='"off" or "on", for thinking models.')] = "off",
    constrained: Annotated[
        bool, typer.Option(help="Hold answers to programs; a server must prove that it does.")
    ] = True,
    refusing: Annotated[
        bool | None,
        typer.Option(
            "--refusing/--no-refusing",
            help="Whether requests may be refused; by default if the planner has learnt to.",
        ),
    ] = None,
    max_tokens: Annotated[int, typer.Option(min=1, help="Of an answer.")] = 512,
    cassette: CassetteFolder = None,
    cassette_mode: CassetteMode = "",
    states: States = None,
    seed: Annotated[int, typer.Option(help="Of the planner's sampling.")] = 0,
    json: Json = None,
    *,
    computed: Mapping[str, Any],
) -> None:
    """Carry out an instruction in a room, while you watch; of several requests one by one.

    Exit code 0: all was done; 2: something was not; 3: the rest was, and something was refused.
    """
    from karma.bench.experiment import Models, load_resources
    from karma.bench.workers import world_maker
    from karma.cli import show
    from karma.contracts import SceneRef
    from karma.infer.hosted.session import Session
    from karma.infer.llama.room_states import StateOptions
    from karma.methods.karma import KarmaMethod

    clauses = _clauses(instruction)
    hosted = _hosted(planner, base_url, model, api=api, dialect=dialect)
    with console.status("loading models ..."):
        session = Session(_cassette(cassette, cassette_mode))
        session.cassette.begin("run")
        chosen = _preset(preset)
        resources = load_resources(
            Models(
                planner=planner,
                profile=profile,
                chat=chat,
                recall=recall or chosen.recall,
                recall_text=chosen.recall_text,
                vision=vision,
                detector=detector,
                constrained=constrained,
                refusing=refusing,
                max_tokens=max_tokens,
                hosted=hosted,
            ).computed_by({"thinking": thinking, **computed}),
            maps=maps,
            seed=seed,
            learn=True,
            session=session,
            states=StateOptions(folder=states),
        )
        session.ledger.take()  # what loading asked, such as the canary, is no part of the bill
        options = {
            "long_term": long_term,
            "short_term": short_term,
            "policy": policy,
            "perception": perception,
            "boxes": "detector" if detector else "given",
            **chosen.options,
            **({} if recall_k is None else {"recall_k": recall_k, "whole_memory": False}),
        }
        method = KarmaMethod.build(resources, options)
        world = world_maker("embedded", [options])()
        world.reset(scene)
    with console.status(escape(f"getting to know {scene} ...")):
        episode = method.begin(world, SceneRef.of(scene), seed=seed, folder=maps.parent)
    if episode.graph is not None:
        areas = episode.graph.areas()
        console.print(
            f"long-term memory: {len(areas)} areas, {len(episode.graph.objects())} objects"
        )
    lines = []
    codes = set()
    for number, text in enumerate(clauses, start=1):
        line, code = _watched(episode, number, text, instruction)
        codes.add(code)
        lines.append(line)
    console.print(show.memory_table(episode.short_term.units(), "short-term memory now"))
    spent = session.ledger.take()
    if spent:
        console.print(escape(show.spent_text(spent)), soft_wrap=True)
    if json is not None:
        figures = {"finished": codes == {DONE}, "hosted": spent, "instructions": lines}
        write_atomic(json, to_json(figures, indent=2))
    if codes != {DONE}:
        raise typer.Exit(UNFINISHED if UNFINISHED in codes else REFUSED)


def _watched(
    episode: "KarmaEpisode", number: int, text: str, whole: str
) -> tuple[dict[str, Any], int]:
    """Carry out one instruction in view; return what is kept of it, and the exit code for it."""
    from rich.live import Live

    from karma.agent.refused_requests import sentence
    from karma.bench.records import Answer, Call
    from karma.cli import show
    from karma.contracts import Outcome, Plan, SubTask

    view = show.InstructionView(number, text)
    answers: list[Answer] = []
    calls: list[Call] = []
    finished = True
    with Live(view, console=console, refresh_per_second=12) as live:
        for moment in episode.do(SubTask(instruction=text, whole=whole)):
            view.add(moment)
            live.update(view)
            if isinstance(moment, Plan):
                answers.append(Answer.of(moment))
            elif isinstance(moment, Outcome):
                finished = moment.finished
            else:
                calls.append(Call.of(moment))
    if not console.is_terminal:
        console.print()
    refused = answers[-1].refused if answers else None
    kept = {"instruction": text, "answers": answers, "calls": calls}
    if refused is not None:
        return {**kept, "refused": sentence(refused)}, REFUSED
    return kept, DONE if finished else UNFINISHED


def _preset(name: str) -> "Preset":
    from karma.bench.presets import preset

    try:
        return preset(name)
    except ValueError as error:
        raise KarmaError(str(error)) from error


def _clauses(instruction: str) -> list[str]:
    """Return the sub-tasks of an instruction; one without words is refused."""
    from karma.tasks.sentences import split_instruction

    if not instruction.strip():
        raise KarmaError('what to do?\n  To fix: karma run "wash the tomato"')
    return list(split_instruction(instruction))


@clear_errors
@model_options
def eval_command(
    file: Annotated[Path, typer.Argument(help="An experiment, e.g. eval/demo.toml.")],
    out: Annotated[Path | None, typer.Option(help="Run folder; default runs/NAME.")] = None,
    fresh: Annotated[bool, typer.Option(help="Start over instead of going on.")] = False,
    tasks: Annotated[bool, typer.Option(help="Also print a line per task.")] = False,
    workers: Annotated[
        int, typer.Option(min=0, help="Processes to use; 0: as many as cores and memory allow.")
    ] = 0,
    ray: Annotated[
        str, typer.Option(help="Address of a Ray cluster, HOST:PORT, to do the episodes on.")
    ] = "",
    steps: Annotated[
        bool | None, typer.Option("--steps/--no-steps", help="Keep a step log per episode.")
    ] = None,
    states: States = None,
    half_width: Annotated[
        float | None,
        typer.Option(help="Add seeds until success rates are as sure as that, e.g. 0.05."),
    ] = None,
    max_seeds: Annotated[
        int | None, typer.Option(min=1, help="With a half-width: seeds at most; default 20.")
    ] = None,
    cassette: CassetteFolder = None,
    cassette_mode: CassetteMode = "",
    base_url: BaseUrl = "",
    json: Json = None,
    *,
    computed: Mapping[str, Any],
) -> None:
    """Do an experiment: every row on every task. Stopped or killed, the same command goes on."""
    from karma.bench.figures import figures, plain
    from karma.bench.precision import reached
    from karma.bench.records import spent_by
    from karma.bench.run import Run
    from karma.benchmarks.run import is_benchmark
    from karma.cli import show
    from karma.lab.figure import is_figure

    folder = out or Path("runs") / file.stem
    seeded = half_width is not None or max_seeds is not None
    if is_benchmark(file):
        refuse_options(file, ray=ray, steps=steps, states=states, half_width=seeded)
        tape = _cassette(cassette, cassette_mode)
        opened = {"fresh": fresh, "cassette": tape, "base_url": base_url, "computed": computed}
        do_benchmark(file, folder, workers=workers, json=json, opened=opened)
        return
    if is_figure(file):
        refuse_options(file, half_width=seeded)
        _do_figure(file, folder, fresh)
        return
    with console.status(escape(f"reading {file} ...")):
        run = Run(
            file,
            folder,
            fresh=fresh,
            cassette=_cassette(cassette, cassette_mode),
            base_url=base_url,
            computed=computed,
            steps=steps,
            states=states,
            half_width=half_width,
            max_seeds=max_seeds,
        )
    try:
        _do_episodes(run, workers, ray)
    except KeyboardInterrupt:
        console.print(f"stopped after {_kept(run)}")
        raise typer.Exit(130) from None
    except KarmaError as error:
        if not run.records:
            raise
        raise KarmaError(f"{error}\n  Kept: {_kept(run)}") from error
    if tasks or run.experiment.authors:
        console.print(show.task_table(run.records))
    lines = figures(run.records, run.timings)
    console.print(show.summary_table(lines, run.experiment.name))
    if run.precision is not None:
        console.print(show.precision_table(reached(run.records, run.precision), run.precision))
    spent = [one for record in run.records for one in spent_by(record, run.timings[record.key])]
    if spent:
        console.print(escape(show.spent_text(spent)), soft_wrap=True)
    console.print(escape(f"records: {run.records_path}"))
    if json is not None:
        write_atomic(json, to_json(plain(lines), indent=2))


def _kept(run: "Run") -> str:
    """Return how far a run is that has ended early, and how it goes on."""
    from karma.bench.records import read_records

    done = len(read_records(run.records_path))
    return f"{done} of {run.total} episodes; the same command (without --fresh) goes on"


def _do_episodes(run: "Run", workers: int, ray: str) -> None:
    """Do what is left of a run, with a line that says how far it is."""
    if run.left and not workers and not ray:
        suggested = run.suggest()
        workers = suggested.number
        console.print(escape(f"workers: {workers} ({suggested.reason})"), soft_wrap=True)
    elif run.left and ray:
        many = workers or "as many workers as it has room for"
        console.print(escape(f"on the Ray cluster at {ray}: {many}"), soft_wrap=True)
    with _bar() as bar:
        line = bar.add_task("episodes", total=run.total, completed=len(run.records))
        for record in run.episodes(workers, ray=ray):
            mark = "[green]✓[/]" if record.success else "[red]✗[/]"
            text = f"{mark} {escape(record.task)} · {escape(record.row)}"
            bar.update(line, advance=1, total=run.total, description=text)
        bar.update(line, description="episodes")


def _do_figure(file: Path, folder: Path, fresh: bool) -> None:
    """Run an experiment that replays traces instead of doing episodes."""
    from rich.markdown import Markdown

    from karma.lab.figure import run_figure

    with _bar() as bar:
        line = bar.add_task("policies", total=None)
        for step in run_figure(file, folder, fresh=fresh):
            text = escape(step.doing)
            bar.update(line, total=step.total, completed=step.done, description=text)
    claims = folder / "claims.md"
    if claims.exists():
        console.print(Markdown(claims.read_text(encoding="utf-8")))
    console.print(escape(f"results: {folder / 'results.json'}"))


def _bar() -> "Progress":
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
    )

    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=console,
    )


def _hosted(planner: str, base_url: str, model: str, **settings: str) -> "Hosted":
    """Return where the planner is, if it is a hosted one."""
    from karma.bench.experiment import OPENAI
    from karma.infer.hosted.session import Hosted

    if planner != OPENAI and not (base_url or model):
        return Hosted()
    if planner != OPENAI or not (base_url and model):
        raise KarmaError(f"--planner {OPENAI}, --base-url and --model go together")
    return Hosted.of_planner(base_url, model, **settings)


def _cassette(folder: Path | None, mode: str) -> "Cassette":
    """Return the cassette that a command asks for; a folder alone is replayed."""
    from karma.infer.hosted.cassette import MODES, Cassette

    wanted = mode or ("replay" if folder is not None else "off")
    for known in MODES:
        if known == wanted:
            return Cassette(folder, known)
    raise KarmaError(f"no cassette mode {mode!r}; there are {', '.join(MODES)}")
