"""Record what hosted models were asked and answered as JSON lines, and replay it offline.

A cassette is one file, `exchanges.jsonl`, in a folder. Each exchange is found by the SHA-256 of
its request and by its place: the n-th time that this was asked in this episode. So a request that
is repeated on purpose (sampling) gets its own answers back in order, and a recording that was
killed goes on with the next episode. A line is on the disk before its answer is used.

The cassette also keeps the times of a recorded run, local models' too, and replays them as they
were measured. Keys never get here: `karma.infer.hosted.session` takes them out first.
"""

import fcntl
import hashlib
import time
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO, Any, Literal

import msgspec

from karma.errors import FileError
from karma.files import append_line, decode_json, read_bytes, to_json, write_atomic
from karma.infer.hosted.nearest_request import describe_miss

Mode = Literal["record", "replay", "off"]
MODES: tuple[Mode, ...] = ("record", "replay", "off")
FILE = "exchanges.jsonl"
LOCK = "recording.lock"  # held by the process that records
VOLATILE = frozenset({
    "metadata", "prompt_cache_key", "safety_identifier", "service_tier", "store", "user",
})  # fields of a request that change nothing in its answer  # fmt: skip


class CassetteError(FileError):
    """A cassette is missing, damaged, cannot be written, or does not hold what is asked for.

    Unlike a model's failure it is no fact about an episode: it ends the run.
    """


class Reply(msgspec.Struct, frozen=True, kw_only=True):
    """What came back: an answer, or why there is none."""

    answer: dict[str, Any] | None = None
    failure: str = ""


class Exchange(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag=True):
    """One question and what came back."""

    scope: str  # the episode it was asked in
    count: int  # how often the same was asked in it before
    key: str  # SHA-256 of the canonical request
    request: dict[str, Any]  # canonical
    url: str  # where it was sent
    reply: Reply
    reply_key: str  # SHA-256 of the reply
    seconds: float  # as measured, retries included
    shared: bool = False  # the answer holds in every episode


class Begin(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag=True):
    """An episode begins; what an earlier attempt at it left no longer counts."""

    scope: str


class Tick(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag=True):
    """One time that was measured."""

    scope: str
    count: int
    seconds: float


def canonical(request: Mapping[str, Any]) -> dict[str, Any]:
    """Return the request without what changes nothing in its answer.

    >>> canonical({"model": "m", "user": "me", "seed": None})
    {'model': 'm'}
    """
    return {
        name: value for name, value in request.items() if value is not None and name not in VOLATILE
    }


def key_of(value: Any) -> str:
    """Return the SHA-256 of a value's JSON with sorted keys."""
    return hashlib.sha256(to_json(value)).hexdigest()


class Cassette:
    """One recording.

    Args:
        folder: holds the file; not needed when `mode` is "off".
        mode: "record" asks and keeps, "replay" answers from the file only, "off" asks.

    Raises:
        CassetteError: nothing to replay, a line is damaged, (replay only) the last is torn, or
            another process records here.
    """

    def __init__(self, folder: str | Path | None = None, mode: Mode = "off") -> None:
        if mode != "off" and folder is None:
            raise CassetteError(FILE, "no folder is given", fix="add --cassette DIR")
        self.mode = mode
        self.path = Path(folder or ".") / FILE
        self._scoped: dict[tuple[str, str, int], Exchange] = {}
        self._shared: dict[str, Exchange] = {}
        self._ticks: dict[tuple[str, int], float] = {}
        self._asked: Counter[str] = Counter()
        self._scope, self._measured, self._start = "", 0, time.perf_counter()
        self._lock = self._locked() if mode == "record" else None
        if mode != "off":
            self._read()

    @property
    def scope(self) -> str:
        """The episode that is going on; "" before the first."""
        return self._scope

    def begin(self, scope: str) -> None:
        """Start an episode; recording, what an earlier attempt at it left is forgotten.

        Raises:
            CassetteError: the file cannot be written.
        """
        self._scope, self._measured, self._start = scope, 0, time.perf_counter()
        self._asked.clear()
        if self.mode == "record":
            self._write(Begin(scope=scope))

    def clock(self) -> float:
        """Return the seconds since the episode began; errors as in `measured`."""
        return self.measured(time.perf_counter() - self._start)

    def measured(self, seconds: float) -> float:
        """Return a time that was measured, or in a replay what was measured in its place then.

        Raises:
            CassetteError: a replay measures more often than the recording did.
        """
        if self.mode == "off":
            return seconds
        place = (self._scope, self._measured)
        self._measured += 1
        if self.mode == "record":
            self._write(Tick(scope=place[0], count=place[1], seconds=seconds))
        elif place not in self._ticks:
            reason = f"episode {self._scope!r} went another way than its recording: there is"
            raise CassetteError(self.path, f"{reason} no time {place[1] + 1}", fix=self._again())
        return self._ticks[place]

    def exchange(
        self,
        request: Mapping[str, Any],
        send: Callable[[], Reply],
        *,
        url: str = "",
        shared: bool = False,
    ) -> Exchange:
        """Ask, or look up what was answered.

        Args:
            request: what is asked; its key is that of its canonical form.
            send: asks; called in modes "record" and "off" only.
            url: where `send` goes; kept beside the request, no part of its key.
            shared: equal requests have equal answers (embeddings), so one is enough.

        Raises:
            CassetteError: a replay asks for what was not recorded, or the file cannot be written.
        """
        wanted = canonical(request)
        key = key_of(wanted)
        place = (self._scope, key, self._asked[key])
        self._asked[key] += 1
        if self.mode == "replay":
            found = self._scoped.get(place) or self._shared.get(key)
            if found is None:
                raise CassetteError(self.path, self._miss(place, wanted), fix=self._again())
            return found
        if shared and key in self._shared:
            return self._shared[key]
        begun = time.perf_counter()
        reply = send()
        made = Exchange(
            scope=place[0], count=place[2], key=key, request=wanted, url=url, reply=reply,
            reply_key=key_of(reply), seconds=time.perf_counter() - begun,
            shared=shared and not reply.failure,
        )  # fmt: skip
        if self.mode == "record":
            self._write(made)
        return made

    # ------------------------------------------------------------- the file

    def _locked(self) -> IO[bytes]:
        """Return the lock file, held until it is closed or the process ends."""
        path = self.path.with_name(LOCK)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            file = path.open("ab")
        except OSError as error:
            raise CassetteError(self.path, f"cannot write: {error.strerror}") from error
        try:
            fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            file.close()
            reason = "another process records here"
            raise CassetteError(self.path, reason, fix="give --cassette another DIR") from error
        return file

    def _write(self, line: Exchange | Begin | Tick) -> None:
        try:
            append_line(self.path, to_json(line))
        except FileError as error:
            raise CassetteError(self.path, error.reason, fix=error.fix) from error
        self._take(line)

    def _take(self, line: Exchange | Begin | Tick) -> None:
        match line:
            case Exchange(shared=True):
                self._shared.setdefault(line.key, line)
            case Exchange():
                self._scoped[line.scope, line.key, line.count] = line
            case Tick():
                self._ticks[line.scope, line.count] = line.seconds
            case Begin():
                scope = line.scope
                self._scoped = {k: v for k, v in self._scoped.items() if k[0] != scope}
                self._ticks = {k: v for k, v in self._ticks.items() if k[0] != scope}

    def _read(self) -> None:
        if not self.path.exists():
            if self.mode == "replay":
                fix = "record one first: --cassette-mode record"
                raise CassetteError(self.path, "there is no such cassette", fix=fix)
            return
        lines = read_bytes(self.path).split(b"\n")
        for number, line in enumerate(lines[:-1], start=1):
            self._take(self._decoded(line, number))
        if not lines[-1]:
            return
        if self.mode == "replay":
            fix = f"{self._again()}; what is whole is kept"
            raise CassetteError(
                self.path, f"line {len(lines)} is torn: the end is missing", fix=fix
            )
        write_atomic(self.path, b"\n".join([*lines[:-1], b""]))

    def _decoded(self, line: bytes, number: int) -> Exchange | Begin | Tick:
        fix = "take it from a copy, or record into another folder"
        try:
            found = decode_json(line, Exchange | Begin | Tick, path=self.path)  # type: ignore[arg-type]
        except FileError as error:
            reason = f"line {number}: {error.reason}"
            raise CassetteError(self.path, reason, fix=fix) from error
        if isinstance(found, Exchange):
            for what, value, key in (
                ("request", found.request, found.key),
                ("reply", found.reply, found.reply_key),
            ):
                if key_of(value) != key:
                    reason = f"line {number}: the {what} is not what its SHA-256 says"
                    raise CassetteError(self.path, reason, fix=fix)
        return found  # type: ignore[no-any-return]

    # ------------------------------------------------------------- a miss

    def _again(self) -> str:
        return "replay what was recorded, or record again with --cassette-mode record"

    def _miss(self, place: tuple[str, str, int], wanted: Mapping[str, Any]) -> str:
        scope, key, count = place
        times = sum(1 for found in self._scoped if found[:2] == (scope, key))
        if times:
            return (
                f"request {key[:12]} was recorded {times} times in episode {scope!r}"
                f" and is asked once more (time {count + 1})"
            )
        mine = [line for line in self._scoped.values() if line.scope == scope]
        recorded = [*self._scoped.values(), *self._shared.values()]
        return describe_miss(
            wanted, [(line.scope, line.request) for line in mine or recorded], scope=scope, key=key
        )
