"""`karma run` and `karma chat`: an agent carries out what a person types."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from rich.markup import escape

from karma import registry
from karma.cli.conversation import CODES, converse, figures_of, say, show_folder, tell_stopped
from karma.cli.progress import AnswerView
from karma.cli.shared import (
    STOPPED,
    Computed,
    Json,
    Kept,
    argument,
    console,
    option,
    readable,
    tell,
    write_json,
)
from karma.errors import KarmaError

if TYPE_CHECKING:
    from karma.assistant.agent import Agent


_UNITS_S = {"m": 60.0, "h": 3600.0, "d": 86_400.0}


@dataclass(frozen=True, kw_only=True)
class RequestOptions:
    """The scene, the home, the planner and the agent's settings."""

    scene: str = option("", "A scene's name or file; default the home's, else kitchen_1.")
    home: str = option("", "A name or folder: the same home tomorrow. In chat the scene's own.")
    later: str = option("", 'Time that has passed there, "8h", "2d".')
    people: int | None = option(
        None, "Residents of a --home, who move objects meanwhile.", min=0, max=4
    )
    fresh: bool = option(False, "In chat: no home, nothing lasts.", "--fresh")
    planner: str = option(
        "", "Name in the manifest, or a GGUF; default karma-mini, else karma-nano."
    )
    assistant: str = option("", '"rules" or "direct"; default as the planner wants.')
    profile: str = option(
        "",
        '"tools", "goals", or "full" and "compact" for programs; default as suits the planner.',
        "--mode",
        "--profile",
    )
    preset: str = option("", '"paper": recall, K and query as in the paper.')
    perception: str = option(
        "metadata", '"pictures": sees by boxes, depth and the vision model alone.'
    )
    sets: list[str] | None = option(
        None,
        'A key of [models] or of the agent\'s options, "models.constraint=free", '
        '"options.recall_k=5".',
        "--set",
        metavar="KEY=VALUE",
    )
    maps: Path = option(Path("runs/maps"), "Folder of long-term memories.")
    model: str = option("", "A hosted planner's, with --planner openai.")
    answer_seconds: float | None = option(
        None, "Wall-clock limit of an answer; default 120; 0: none.", min=0
    )
    out: Path | None = option(None, "Run folder; default the next in runs/talks.")


@dataclass(frozen=True, kw_only=True)
class ChatCommand(Computed, Kept, RequestOptions):
    """Talk with an agent in a room: it remembers what was said and done before.

    Exit code of piped requests: the first that occurs of 130, 1, 4, 5, 3, else 0.
    """

    def do(self) -> None:
        """Converse in a home that lasts, unless it is to be fresh, or no plug-in keeps homes."""
        from karma.assistant.session_log import DEFAULT_SCENE
        from karma.types.space import SceneRef

        view, home = AnswerView(), self.home
        if not self.fresh and not home and "kept" in registry.names("homes"):
            home = SceneRef.of(self.scene or DEFAULT_SCENE).name
        raise typer.Exit(converse(self.agent(view, home), view))

    def agent(self, view: AnswerView, home: str) -> "Agent":
        """Return the agent of these options; `view` hears its answers."""
        from karma.assistant.agent import ANSWER_SECONDS, Agent
        from karma.assistant.session_log import DEFAULT_SCENE
        from karma.loading.models import Models
        from karma.models.manifest import default_planner
        from karma.models.session import Session

        if self.fresh and self.home:
            raise typer.BadParameter("--fresh keeps nothing, --home keeps a home: one of them")
        planner = self.planner or default_planner()
        settings = self._settings()
        session = Session(self.tape)
        session.cassette.begin("run")
        models = Models().computed_by(
            {
                "planner": planner,
                "profile": self.profile,
                "hosted": self.hosted(planner, self.model),
                **self.computed,
                **settings["models"],
            }
        )
        seconds, place = self.answer_seconds, home or self.scene or DEFAULT_SCENE
        with console.status(escape(f"loading models, getting to know {place} ...")):
            return Agent(
                self.scene,
                models=models,
                options={"perception": self.perception, **settings["options"]},
                preset=self.preset,
                folder=self.out,
                maps=self.maps,
                session=session,
                listen=view.hear,
                answer_seconds=ANSWER_SECONDS if seconds is None else seconds or None,
                home=home or None,
                later_s=_later_s(self.later, home, self.people),
                people=self.people,
                assistant=self.assistant,
            )

    def _settings(self) -> dict[str, dict[str, Any]]:
        """Return what --set says of the models and of the agent's options."""
        settings: dict[str, dict[str, Any]] = {"models": {}, "options": {}}
        for text in self.sets or ():
            from karma.bench.engine.experiment_file import setting_of

            setting = setting_of(text)
            table, _, key = setting.key.partition(".")
            if table not in settings or not key:
                raise KarmaError(
                    f"--set {text}: there are models.KEY and options.KEY\n"
                    "  To fix: --set options.recall_k=5"
                )
            settings[table][key] = setting.value
        return settings


@dataclass(frozen=True, kw_only=True)
class RunCommand(ChatCommand):
    """Carry out an instruction in a room, while you watch; of several requests one by one.

    It says what it understood before it acts, and afterwards what is so by its own eyes.

    Exit code 0: all was done or answered; 1: an error; 2: misuse; 3: the rest was done, and
    something refused; 4: something was not done, or in part; 130: stopped.
    """

    instruction: str = argument(..., "What to do, in plain words.")
    more: list[str] | None = argument(
        None, "None: a request stands in quotes.", hidden=True, metavar=""
    )
    json: Json = None

    def do(self) -> None:
        """Carry out the instruction."""
        if self.more:
            whole = " ".join((self.instruction, *self.more))
            raise typer.BadParameter(f'one request stands in quotes: karma run "{whole}"')
        if not self.instruction.strip():
            raise KarmaError('what to do?\n  To fix: karma run "wash the tomato"')
        view = AnswerView()
        agent = self.agent(view, self.home)
        try:
            reply = say(agent, readable(self.instruction), view)
        except KeyboardInterrupt:
            tell_stopped(agent, 0)
            if agent.replies:
                _close(agent)
            raise typer.Exit(STOPPED) from None
        _close(agent)
        write_json(self.json, figures_of(agent, reply))
        raise typer.Exit(CODES[reply.status])


def _later_s(later: str, home: str, people: int | None) -> float:
    """Return how much time has passed in a home: as said, else by the clock at a terminal."""
    if people is not None and not home:
        raise typer.BadParameter("--people live in a home that lasts: --home NAME")
    if not later:
        return registry.load("homes", "seconds-away")(home) if home and sys.stdin.isatty() else 0.0
    number, unit = later[:-1], later[-1:]
    if not home or unit not in _UNITS_S or not number.replace(".", "", 1).isdecimal():
        raise typer.BadParameter('--later takes "30m", "8h" or "2d", of a --home')
    return float(number) * _UNITS_S[unit]


def _close(agent: "Agent") -> None:
    """Say what is remembered, what it cost, and where the run is."""
    from karma.journal.formats import spent_text

    kinds = ", ".join(dict.fromkeys(unit.object_type for unit in agent.memory)) or "nothing"
    tell(f"remembers now: {kinds}", style="dim")
    if agent.spent:
        tell(spent_text(agent.spent))
    show_folder(agent)
