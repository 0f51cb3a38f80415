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

from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

from karma import registry
from karma.agent.goals.goals import GoalTracker, WatchedWorld
from karma.agent.journal.records import SubTaskRecord
from karma.agent.journal.steps import StepLog
from karma.agent.journal.writer import EpisodeWriter, TimeLog
from karma.agent.loading.models import Models, Row, load_resources, world_maker
from karma.agent.loading.models import preset as preset_of
from karma.agent.loading.names import check_options
from karma.agent.memory import Snapshot
from karma.agent.planning.prompt import GOALS
from karma.assistant.session_log import SessionLog
from karma.contracts import (
    Known,
    Listener,
    Outcome,
    Plan,
    Resources,
    SceneRef,
    SkillResult,
    SubTask,
    Tour,
)
from karma.errors import KarmaError
from karma.files import read_bytes
from karma.models.llama.model import LlamaModel
from karma.models.llama.room_states import StateOptions
from karma.models.manifest import default_planner, resolve_planner
from karma.models.session import Session, Spent
from karma.plugins.rules.language.clauses import clauses_of, context_left_out
from karma.plugins.rules.language.lexicon import Lexicon
from karma.plugins.rules.language.request import RequestReader, asked_last, check_length
from karma.plugins.rules.method import RulesMethod
from karma.plugins.rules.talk import history
from karma.plugins.rules.talk.keeping import Keeper, TalkFolder
from karma.plugins.rules.talk.offers import corrected, with_offer
from karma.plugins.rules.talk.questions import answered, of_another
from karma.plugins.rules.talk.remembering import MemoryAnswer, Remembering
from karma.plugins.rules.talk.replies import AgentReply, RequestReply, as_it_ends, turns_of
from karma.plugins.rules.talk.telling import told_of
from karma.plugins.rules.talk.views import Memory, RoomMap
from karma.plugins.rules.types import Mention, Request, SaidDeed
from karma.plugins.rules.understanding import Understanding, misspelt, understood

if TYPE_CHECKING:
    from karma.world.event import WorldEvent
    from karma.world.sim import EmbeddedWorld

MAPS = Path("runs/maps")
ANSWER_SECONDS = 120.0  # that an answer may take unless told otherwise
_SPOKEN_OF = 4  # things named before the last that "both" may stand for
_EARLIER = 3  # requests of earlier sessions, of which "it" may be the last thing
Moment = Understanding | Plan | SkillResult | RequestReply  # what happens while an agent acts


class _Clause(NamedTuple):
    """One errand or question of what is said."""

    text: str
    asked: Request | None = None  # where it is read
    means: Mapping[str, str] = MappingProxyType({})  # type -> id, by what it says of the log


@dataclass(frozen=True, slots=True)
class _Before:
    """All that an instruction may change, as it was before it."""

    event: "WorldEvent"
    remembered: Snapshot
    steps: StepLog
    times: TimeLog
    tours: dict[str, Tour]
    done: int
    kept: int  # errands of the home


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
        states: where a local planner keeps what it computed of rooms.
        resources: models that are loaded already, in place of all by name.
        answer_seconds: an answer of the planner takes at most; one that is cut is asked for again,
            never carried out. None: no bound.
        listen: hears the planner's answers as they come.
        home: a name or folder: it is the same home tomorrow. None: nothing lasts.
        later_s: so much time has passed there since it was left.
        people: who live there meanwhile, and move things; None: as many as always, at first nobody.

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
        states: StateOptions | None = None,
        resources: Resources | None = None,
        answer_seconds: float | None = ANSWER_SECONDS,
        listen: Listener | None = None,
        home: str | Path | None = None,
        later_s: float = 0.0,
        people: int | None = None,
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
            named = None if resources else asking(models or _models(planner, preset))
            row = _row(preset, dict(options or {}), answer_seconds)
            self._world: EmbeddedWorld = world_maker("embedded", [row.all_options])()  # type: ignore[assignment]
            self._world.reset(self.scene.source)  # wrong names are told before models are loaded
            check_options(row.method, row.all_options)
            place = TalkFolder(None if folder is None else Path(folder), self.scene.name)
            loaded = resources or load_resources(
                named or Models(), maps=maps, seed=seed, learn=True, session=self.session,
                states=states,
            )  # fmt: skip
            self.session.ledger.take()  # what loading asked, as the canary, is no part of the bill
            decoding = replace(loaded.decoding, answer_seconds=answer_seconds)
            loaded = replace(loaded, decoding=decoding, listen=listen)
            self._method = RulesMethod.build(loaded, row.all_options)
            self._lexicon = Lexicon(loaded.embedder)
            self._keeper = Keeper(place, self.scene, row, named, loaded)
            self._maps = maps
            self._begin(seed)
            failed.pop_all()

    def _begin(self, seed: int) -> None:
        """Get to know the room, and be at its start."""
        steps = StepLog()
        world = WatchedWorld(self._world, steps)
        world.reset(self.scene.source)
        self._episode = self._method.begin(world, self.scene, seed=seed, folder=self.folder)
        self._memory = self._episode.agent.memory
        self._part = EpisodeWriter(
            method=self._method.name,
            world=world,
            tracker=GoalTracker(),  # nothing that is said has goals
            ledger=self.session.ledger,
            cassette=self.session.cassette,
            steps=steps,
            times=TimeLog(),
            tours={},
        )
        steps.start(self.scene.name, seed)
        self.home.restore(world, self._world)
        for errand in self.home.past:
            for change in errand.changes:
                self._memory.learn(change)
        self._earlier = tuple(one.said for one in self.home.past[-_EARLIER:])
        self._done: list[SubTaskRecord] = []
        self._before: list[_Before] = []
        self._question = ""  # what was asked last; "" after anything else
        self._asked = ""  # the request that was made last
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
        check_length(instruction)
        before = self._now()
        self._episode.begin_text()
        parts: list[RequestReply] = []
        number, clause = 0, _Clause("")
        for number, clause in enumerate(self._in_turn(instruction)):
            now = self._now()
            try:
                for moment in self._carry_out_or_answer(clause, instruction):
                    if isinstance(moment, RequestReply):
                        parts.append(moment)
                    yield moment
            except BaseException:
                if len(parts) == number:
                    self._return(now)
                if parts:
                    stopped = clause.text if len(parts) == number else ""
                    self._reply(before, instruction, parts, stopped=stopped)
                raise
        self._reply(before, instruction, parts)

    def _reply(
        self, before: _Before, said: str, parts: Sequence[RequestReply], *, stopped: str = ""
    ) -> None:
        self._before.append(before)
        self.replies.append(AgentReply(said=said, parts=as_it_ends(parts), stopped=stopped))
        if self._done:
            self.save()

    def clauses(self, instruction: str) -> list[str]:
        """Return what is said, errand by errand, as it will be carried out."""
        return [clause.text for clause in self._in_turn(instruction)]

    def is_errand(self, text: str) -> bool:
        """Return whether a text asks for something by itself."""
        return any(one.form == "errand" for one in self._method.reader.read(text))

    def _in_turn(self, instruction: str) -> Iterator[_Clause]:
        """Yield what is said errand by errand, what speaks of the log when that holds the rest."""
        reader = self._method.reader
        *first, last = history.in_turn(instruction)
        for number, piece in enumerate(first):
            if not history.only_needs(piece, reader):  # "I still need it, put it back"
                yield from self._clauses(piece, reader, first[:number])
        yield from self._clauses(last, reader, first)

    def _clauses(
        self, instruction: str, reader: RequestReader, ahead: Sequence[str]
    ) -> list[_Clause]:
        """Return what is said errand by errand, each with what it asks."""
        instruction = of_another(instruction, self._question, reader)
        instruction = corrected(instruction, self._asked, reader)
        seen = {name: sight for name, (sight, _) in self._memory.last_seen().items()}
        plain = history.in_plain_words(instruction, self.home.past, reader, seen)
        read = reader.read(plain.text, *self._spoken_of(reader, ahead))
        requests = context_left_out(read)
        usual = history.habits(self.home.past, reader)
        unread = [
            replace(one, unread=(*one.unread, *(w for w in plain.unknown if w in one.text)))
            for one in requests
        ]
        found: list[_Clause] = []
        for text, asked in (clause for one in unread for clause in clauses_of(one)):
            put = history.with_habits(asked, usual)
            found.append(_Clause(text if put is asked else put.errand, put, plain.means))
        return found or [_Clause(plain.text)]

    def _spoken_of(
        self, reader: RequestReader, ahead: Sequence[str]
    ) -> tuple[tuple[Mention, ...], tuple[SaidDeed, ...], tuple[Mention, ...]]:
        """Return what was spoken of last, what was asked for last, what was spoken of before."""
        last: tuple[Mention, ...] = ()
        older: tuple[Mention, ...] = ()
        deeds: tuple[SaidDeed, ...] = ()
        for text in (*self._earlier, *(reply.said for reply in self.replies), *ahead):
            said = reader.read(text, last, deeds, older)
            named = (one for request in said for one in (*request.alone, *request.mentions))
            known = tuple(one for one in named if one.types)
            older = (*older, *last)[-_SPOKEN_OF:] if known else older
            last = known or last
            for one in said:
                deeds = asked_last(one, deeds)
        return last, deeds, older

    def _carry_out_or_answer(self, said: _Clause, whole: str) -> Iterator[Moment]:
        """Carry out one request, or answer it."""
        clause, asked, reader = said.text, said.asked, self._method.reader
        if asked and reader and (answer := self._answer(clause, asked, reader)) is not None:
            yield RequestReply(instruction=clause, answer=answer)
            return
        self._asked = clause if asked is not None and asked.form == "errand" else ""
        subtask = SubTask(instruction=clause, whole=clause if asked else whole)
        if asked is None:
            events = self._episode.do(subtask)
        else:
            events = self._episode.do_clause(
                subtask,
                asked,
                owned=said.means,
                reported=self._remembering().told(),
                clock_s=self.home.clock_s,
            )
        taken: list[Understanding] = []
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
                    taken.append(self._understood(clause, moment, said.asked))
                    yield taken[-1]
            yield moment
        self._done.append(record)
        reply = RequestReply(
            instruction=clause,
            understood=tuple(taken),
            plans=tuple(plans),
            results=tuple(results),
            checks=outcome.checks if outcome else (),
            finished=record.finished,
            record=record,
            asked=asked,
        )
        changes = [outcome.change] if outcome and outcome.change else []
        if self._part.steps.actions:
            self.home.add(
                clause,
                reply.status,
                self._part.steps.actions,
                changes,
                self._world.last_event,
                plain=history.in_plain(asked),
                deeds=tuple(history.deeds_of(asked, results, done=reply.status == "done")),
            )
            reply = replace(reply, elsewhere=history.found_elsewhere(self.home.past))
        yield reply

    def _answer(self, clause: str, asked: Request, reader: RequestReader) -> MemoryAnswer | None:
        """Answer a question, or learn what is told; None where it is neither."""
        self._question = clause if asked.form == "question" else ""
        if asked.form == "question":
            return answered(asked, self._remembering(), reader)
        if asked.form not in ("statement", "teaching") and not history.is_taught(clause):
            return None
        told = told_of(asked, self._remembering(), self.scene.name, reader)
        if told is None:
            return None
        if told.change is not None:
            self._memory.learn(told.change)
            self.home.add(clause, told.about, (), [told.change], self._world.last_event)
        return told.answer

    def _remembering(self) -> Remembering:
        """Return what questions are answered from."""
        return Remembering(
            sights=self._memory.last_seen(),
            units={unit.object_id: unit for unit in self.memory},
            furniture=self.map.types(),
            past=self.home.past,
            now_s=self.home.clock_s,
            chance_in_place=self.home.chance_in_place,
        )

    def _where(self, name: str) -> Known | None:
        """Return where the agent believes an object to be, by its type or id."""
        return self._memory.beliefs(self._part.world).where(name)

    def _understood(self, clause: str, plan: Plan, asked: Request | None) -> Understanding:
        here = {*self.map.types(), *(unit.object_type for unit in self.memory)}
        taken = understood(clause, plan, self._where, self._lexicon, sorted(here))
        if asked is None:
            return taken
        if plan.refused is not None:
            slip = misspelt(plan.refused, self._lexicon, sorted(here))
            return with_offer(taken, clause, plan.refused, asked, slip)
        verbs = [deed.verb for deed in asked.forbidden]
        return replace(
            taken, forbidden=(*verbs, *(f"use the {one.text}" for one in asked.exclusions))
        )

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
            self._memory.snapshot(),
            *deepcopy((self._part.steps, self._part.times, self._part.tours)),
            len(self._done),
            len(self.home.past),
        )

    def _return(self, before: _Before) -> None:
        self._world.back_to(before.event)
        self._memory.go_back(before.remembered)
        self._part.steps.go_back(before.steps)
        self._part = replace(self._part, times=before.times, tours=before.tours)
        del self._done[before.done :]
        self.home.go_back(before.kept)

    # ------------------------------------------------------------- what it knows

    @property
    def memory(self) -> Memory:
        """Short-term memory: what was handled or seen last, and its states."""
        short = self._memory.short_term
        return Memory(short.units(), short.capacity)

    @property
    def map(self) -> RoomMap:
        """Long-term memory of the room: places to stand, and the furniture near them."""
        return RoomMap.of(self.scene.name, self._memory.graph)

    @property
    def manner(self) -> str:
        """How prompts go into the planner's GGUF where it has a chat template; else ""."""
        model = self._method.karma.planner.model
        return model.manner if isinstance(model, LlamaModel) else ""

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
        return f"Agent({self.scene.source!r}): {self._method.name}, {remembered}"


def _row(preset: str, options: dict[str, Any], answer_seconds: float | None) -> Row:
    try:
        return Row(
            name="KARMA",
            method="rules",
            preset=preset,
            options=options,
            answer_seconds=answer_seconds,
        )
    except ValueError as error:
        raise KarmaError(str(error)) from error


def _models(planner: str, preset: str) -> Models:
    chosen = preset_of(preset)
    planner = planner or default_planner()
    return Models(planner=planner, recall=chosen.recall, recall_text=chosen.recall_text)


def asking(models: Models) -> Models:
    """Return models of which a big planner is told how to refuse; others do if they learnt to."""
    if models.refusing is not None:
        return models
    hosted = models.hosted.planner is not None
    profile = models.profile or (
        "full" if hosted else resolve_planner(models.planner).prompt_profile
    )
    return models.computed_by({"refusing": True}) if profile in ("full", GOALS) else models
