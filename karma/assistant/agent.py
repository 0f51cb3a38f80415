"""`from karma import Agent`: an agent in a room, in five lines of Python.

    from karma import Agent
    agent = Agent("kitchen_1")
    agent.do("wash the mug")
    agent.memory
    agent.map

It is the agent of the tables and of `karma run`: the same method, models, world and records. What
it learns of a room lasts in `maps`; what it has handled is remembered as long as the agent lives,
and in a `home` for good.
"""

from collections.abc import Callable, Collection, Generator, Mapping, Sequence
from contextlib import ExitStack, closing
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any
from weakref import proxy

from karma import registry
from karma.agent.karma import KarmaMethod
from karma.agent.memory import AgentMemory, Snapshot
from karma.agent.planning.prompt import TOOLS
from karma.agent.session import Executor
from karma.assistant.protocol import Assistant, Moment, wanted_assistant
from karma.assistant.replies import AgentReply, RequestReply, Understanding, turns_of
from karma.assistant.session_log import PastAction, SessionLog
from karma.assistant.talk_folder import Keeper, TalkFolder
from karma.assistant.views import Memory, RoomMap
from karma.errors import KarmaError
from karma.files import read_bytes
from karma.goals.goals import GoalTracker, WatchedWorld
from karma.journal.records import SubTaskRecord
from karma.journal.steps import StepLog
from karma.journal.writer import EpisodeWriter, TimeLog
from karma.loading.models import Models, Row, load_resources, world_maker
from karma.loading.models import preset as preset_of
from karma.loading.names import check_options
from karma.models.manifest import default_planner, resolve_planner
from karma.models.session import Session, Spent
from karma.types.completion import Listener
from karma.types.events import Outcome, Plan, SkillResult
from karma.types.memory import Known, MemoryChange, Tour
from karma.types.roles import Resources
from karma.types.space import SceneRef
from karma.types.tasks import SubTask

if TYPE_CHECKING:
    from karma.world.event import WorldEvent
    from karma.world.sim import EmbeddedWorld

MAPS = Path("runs/maps")
ANSWER_SECONDS = 120.0  # limit of an answer unless the caller sets another


@dataclass(frozen=True, slots=True)
class _Before:
    """All that an instruction may change, as it was before it."""

    event: "WorldEvent"
    remembered: Snapshot
    steps: StepLog
    times: TimeLog
    tours: dict[str, Tour]
    done: int
    logged: int  # requests


class Agent:
    """An agent in a room.

    Args:
        scene: a scene's name or file; "": the home's, or kitchen_1.
        planner: a name of the manifest or a GGUF's path; "": karma-mini where set-up could make it,
            else karma-nano. For more, `models`.
        models: which models fill the roles, in place of `planner`.
        options: of the agent, as in a row of an experiment, e.g. `{"policy": "fifo-merge[10]"}`.
        preset: "paper": recall, K and query as in the paper.
        folder: takes the run: records, step log, pictures; a new or empty one, which nobody else
            has as long as the agent lives. None: the next in `runs/talks`.
        maps: folder of long-term memories.
        seed: of the planner's sampling.
        session: of hosted models.
        resources: models that are loaded already, in place of all by name.
        answer_seconds: an answer of the planner takes at most; one that is cut is asked for again,
            never carried out. None: no bound.
        listen: hears the planner's answers as they come.
        home: a name or folder: it is the same home tomorrow. None: nothing lasts.
        later_s: so much time has passed there since it was left.
        people: who live there meanwhile, and move things; None: as many as always, at first nobody.
        assistant: a name of `karma.assistants`; "": the one that the planner wants.

    Raises:
        KarmaError: a model, scene or option is not there or not as it should be; or the folder
            holds something.
    """

    def __init__(
        self,
        scene: str = "",
        *,
        planner: str = "",
        models: Models | None = None,
        options: Mapping[str, Any] | None = None,
        preset: str = "",
        folder: str | Path | None = None,
        maps: str | Path = MAPS,
        seed: int = 0,
        session: Session | None = None,
        resources: Resources | None = None,
        answer_seconds: float | None = ANSWER_SECONDS,
        listen: Listener | None = None,
        home: str | Path | None = None,
        later_s: float = 0.0,
        people: int | None = None,
        assistant: str = "",
    ) -> None:
        if home is not None:
            kept = registry.load("homes", "kept")
            self.home: SessionLog = kept(home, scene, people=people, seed=seed, later_s=later_s)
        elif people or later_s:
            raise KarmaError("people and later_s need a home that lasts\n  To fix: name a home")
        else:
            self.home = SessionLog(scene)
        with ExitStack() as failed:
            failed.callback(self.home.leave)  # who could not begin is in nobody's way
            self.scene = SceneRef.of(self.home.scene)
            maps = Path(maps) if self.home.folder is None else self.home.folder / "maps"
            self.session = session or Session()
            row = _row(preset, dict(options or {}), answer_seconds)
            named = models or Models(planner=planner or default_planner())
            if preset:
                named = named.computed_by({"recall": preset_of(preset).recall})
            if not resources:
                named = asking(named)
            planner = resources.model.name if resources else named.planner
            kind = registry.load("assistants", assistant or wanted_assistant(planner))
            self._world: EmbeddedWorld = world_maker("embedded", [row.all_options])()  # type: ignore[assignment]
            self._world.reset(self.scene.source)  # wrong names are told before models are loaded
            check_options(row.method, row.all_options)
            place = TalkFolder(None if folder is None else Path(folder), self.scene.name)
            loaded = resources or load_resources(
                named, maps=maps, seed=seed, learn=True, session=self.session
            )
            self.session.ledger.take()  # what loading asked, as the canary, is no part of the bill
            decoding = replace(loaded.decoding, answer_seconds=answer_seconds)
            loaded = replace(loaded, decoding=decoding, listen=listen)
            self.method = KarmaMethod.build(loaded, row.all_options)
            self.embedder = loaded.embedder
            self._keeper = Keeper(place, self.scene, row, None if resources else named, loaded)
            self._maps = maps
            self._begin(seed)
            # without a cycle, so that folders are free as soon as nobody has the agent
            self.assistant: Assistant[Any] = kind(proxy(self))
            failed.pop_all()

    def _begin(self, seed: int) -> None:
        """Get to know the room, and be at its start."""
        steps = StepLog()
        world = WatchedWorld(self._world, steps)
        world.reset(self.scene.source)
        self.episode = self.method.begin(world, self.scene, seed=seed, folder=self.folder)
        self._part = EpisodeWriter(
            method=self.method.name,
            world=world,
            tracker=GoalTracker(),  # nothing that is said has goals
            ledger=self.session.ledger,
            cassette=self.session.cassette,
            steps=steps,
            times=TimeLog(),
            tours={},
        )
        steps.start(self.scene.name)
        self.home.restore(world, self._world)
        for errand in self.home.past:
            for change in errand.changes:
                self.known.learn(change)
        self._done: list[SubTaskRecord] = []
        self._before: list[_Before] = []
        self.replies: list[AgentReply] = []

    # ------------------------------------------------------------- what it does

    def do(self, instruction: str) -> AgentReply:
        """Carry out what is said; of several requests one by one.

        Returns what was understood, done, and seen afterwards; it is true where all was done.

        Raises:
            KarmaError: nothing was said, or a model failed.
        """
        with closing(self.doing(instruction)) as moments:
            for _ in moments:
                pass
        return self.replies[-1]

    def doing(self, instruction: str) -> Generator[Moment]:
        """Do the same, and yield what happens as it happens: of each request its reply last.

        What was understood comes before the first action. When the last is done, the run is
        written to `folder`. Where one is stopped or fails, all is as it was before that one; those
        before it stay, and are written.
        """
        if not instruction.strip():
            raise KarmaError('what to do?\n  To fix: karma run "wash the tomato"')
        before = self._now()
        parts: list[RequestReply] = []
        for number, request in enumerate(self.assistant.requests(instruction)):
            now = self._now()
            try:
                for moment in self.assistant.handle(request, instruction):
                    if isinstance(moment, RequestReply):
                        parts.append(moment)
                    yield moment
            except BaseException:
                if len(parts) == number:
                    self._return(now)
                if parts:
                    stopped = request.text if len(parts) == number else ""
                    self._reply(before, instruction, parts, stopped=stopped)
                raise
        self._reply(before, instruction, parts)

    def _reply(
        self, before: _Before, said: str, parts: Sequence[RequestReply], *, stopped: str = ""
    ) -> None:
        self._before.append(before)
        settled = tuple(self.assistant.settled(parts))
        self.replies.append(AgentReply(said=said, parts=settled, stopped=stopped))
        if self._done:
            self.save()

    def carry_out(
        self,
        subtask: SubTask,
        describe: Callable[[Plan], Understanding],
        executor: Executor | None = None,
        *,
        keep_shut: Collection[str] = (),
    ) -> Generator[Moment, None, RequestReply]:
        """Carry out one request; yields what happens and returns the reply.

        Args:
            subtask: the request.
            describe: puts a plan in words that are shown before it runs.
            executor: carries it out; None: the planner alone.
            keep_shut: types that nothing opens.
        """
        clock_s = self.home.clock_s
        events = self.episode.execute(
            subtask,
            executor or self.episode.executor(subtask),
            keep_shut=keep_shut,
            clock_s=clock_s,
        )
        described: list[Understanding] = []
        plans: list[Plan] = []
        results: list[SkillResult] = []
        outcome = None
        going = self._part.write(len(self._done), subtask, self.scene.name, events)
        while True:
            try:
                moment = next(going)
            except StopIteration as end:
                record: SubTaskRecord = end.value
                break
            if isinstance(moment, Outcome):
                outcome = moment
                continue
            if isinstance(moment, SkillResult):
                results.append(moment)
            else:
                plans.append(moment)
                if moment.refused is not None or (moment.calls and not moment.error):
                    described.append(describe(moment))
                    yield described[-1]
            yield moment
        self._done.append(record)
        return RequestReply(
            instruction=subtask.instruction,
            understood=tuple(described),
            plans=tuple(plans),
            results=tuple(results),
            checks=outcome.checks if outcome else (),
            finished=record.finished,
            record=record,
            change=outcome.change if outcome else None,
            end=outcome.end if outcome else None,
        )

    def log(
        self, reply: RequestReply, *, plain: str = "", deeds: Sequence[PastAction] = ()
    ) -> bool:
        """Log a request that was carried out; return False if it did nothing."""
        changes = [reply.change] if reply.change is not None else []
        actions = self._part.steps.actions
        if actions:
            event = self._world.last_event
            self.home.add(
                reply.instruction, reply.status, actions, changes, event, plain=plain, deeds=deeds
            )
        return bool(actions)

    def learn(self, said: str, status: str, change: MemoryChange) -> None:
        """Put into memory, and log, what a person stated."""
        self.known.learn(change)
        self.home.add(said, status, (), [change], self._world.last_event)

    def undo(self) -> str | None:
        """Go back to before the last thing that was said: room, memory and records.

        A question changes nothing, and is passed over. Returns what was undone, None for nothing.
        """
        deeds = (n for n, reply in enumerate(self.replies) if reply.status != "answered")
        last = max(deeds, default=None)
        if last is None:
            return None
        self._return(self._before[last])
        undone = self.replies[last].said
        del self._before[last], self.replies[last]
        self.save()
        return undone

    def _now(self) -> _Before:
        return _Before(
            self._world.last_event,
            self.known.snapshot(),
            *deepcopy((self._part.steps, self._part.times, self._part.tours)),
            len(self._done),
            len(self.home.past),
        )

    def _return(self, before: _Before) -> None:
        self._world.back_to(before.event)
        self.known.go_back(before.remembered)
        self._part.steps.go_back(before.steps)
        self._part = replace(self._part, times=before.times, tours=before.tours)
        del self._done[before.done :]
        self.home.go_back(before.logged)

    # ------------------------------------------------------------- what it knows

    @property
    def known(self) -> AgentMemory:
        """Both memories, of all rooms."""
        return self.episode.memory

    def where(self, name: str) -> Known | None:
        """Return where the agent believes an object to be, by its type or id."""
        return self.known.knowledge(self._part.world).where(name)

    @property
    def memory(self) -> Memory:
        """Short-term memory: what was handled or seen last, and its states."""
        short = self.known.short_term
        return Memory(short.units(), short.capacity)

    @property
    def map(self) -> RoomMap:
        """Long-term memory of the room: places to stand, and the furniture near them."""
        return RoomMap.of(self.scene.name, self.known.graph)

    @property
    def folder(self) -> Path:
        """Where the run is kept; `karma report FOLDER` makes a page of it."""
        return self._keeper.place.folder

    @property
    def has_run(self) -> bool:
        """Whether anything was done that the folder holds; a question leaves nothing there."""
        return bool(self._done)

    @property
    def spent(self) -> tuple[Spent, ...]:
        """What hosted models have cost, with the seconds they took."""
        spent = (one for record in self._done for one in record.hosted)
        seconds = (s for timing in self._part.times.subtasks for s in timing.hosted_s)
        return tuple(replace(one, seconds=s) for one, s in zip(spent, seconds, strict=True))

    def save(self) -> Path:
        """Write the run as it stands; returns its folder.

        Raises:
            FileError: the folder cannot be written.
        """
        path = self._maps / f"{self.scene.name}.json"
        maps = {f"maps/{path.name}": read_bytes(path)} if path.exists() else {}
        self._keeper.write(self._done, turns_of(self.replies), self._part, maps)
        return self.folder

    def __repr__(self) -> str:
        remembered = f"{len(self.replies)} said, {len(self.memory)} things remembered"
        return f"Agent({self.scene.source!r}): {self.method.name}, {remembered}"


def _row(preset: str, options: dict[str, Any], answer_seconds: float | None) -> Row:
    try:
        return Row(name="KARMA", preset=preset, options=options, answer_seconds=answer_seconds)
    except ValueError as error:
        raise KarmaError(str(error)) from error


def asking(models: Models) -> Models:
    """Return models as a person is served best: a hosted planner calls tools.

    One that writes programs by the full prompt is told how to refuse; others do if they learnt to.
    """
    hosted = models.hosted.planner is not None
    if hosted and not models.profile:
        models = models.computed_by({"profile": TOOLS})
    profile = models.profile or resolve_planner(models.planner).prompt_profile
    if models.refusing is None and profile == "full":
        return models.computed_by({"refusing": True})
    return models
