"""Record what hosted models were asked and answered as JSON lines, and replay it offline.

A cassette is one file, `exchanges.jsonl`, in a folder. Each exchange is found by the SHA-256 of
its request and by its place: the n-th time that this was asked in this episode. So a request that
is repeated on purpose (sampling) gets its own answers back in order, and a recording that was
killed goes on with the next episode. A line is on the disk before its answer is used.

Several processes may record at once, each an episode of its own: one claims the folder, the others
join it by its `Tape`. Every line says its episode, so neither the order of episodes in the file nor
the number of processes makes a difference to a replay.

The cassette also keeps the times of a recorded run, local models' too, and replays them as they
were measured. Keys never get here: `karma.plugins.hosted.connection` takes them out first.
"""

import hashlib
import json
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from difflib import SequenceMatcher, unified_diff
from pathlib import Path
from typing import Any, Self

import msgspec

from karma.errors import FileError
from karma.files import LARGEST_LOG, append_line, decode_json, read_bytes, to_json
from karma.models.session import CassetteError, Mode, Tape
from karma.plugins.hosted.recording import Recording

FILE = "exchanges.jsonl"
VOLATILE = frozenset({
    "metadata", "prompt_cache_key", "safety_identifier", "service_tier", "store", "user",
})  # fields of a request that change nothing in its answer  # fmt: skip
_AGAIN = "replay what was recorded, or record again with --cassette-mode record"
MAX_LINES = 40
MAX_WIDTH = 160
_COMPARED = 50  # candidates that are compared letter by letter
_LONGEST = 2000  # letters of each that are compared
_SHARED = b'"shared":true'


class Reply(msgspec.Struct, frozen=True, kw_only=True):
    """What came back: an answer, or why there is none."""

    answer: dict[str, Any] | None = None
    failure: str = ""


class _Line(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag=True):
    scope: str  # the episode that it belongs to
    line_key: str = ""  # SHA-256 of all the rest; "" in older recordings


class Exchange(_Line, frozen=True, kw_only=True, tag=True):
    """One question and what came back."""

    count: int  # how often the same was asked in its episode before
    key: str  # SHA-256 of the canonical request
    request: dict[str, Any]  # canonical
    url: str  # where it was sent
    reply: Reply
    reply_key: str  # SHA-256 of the reply
    seconds: float  # as measured, retries included
    shared: bool = False  # the answer holds in every episode


class Begin(_Line, frozen=True, kw_only=True, tag=True):
    """An episode begins; what an earlier attempt at it left no longer counts."""


class Tick(_Line, frozen=True, kw_only=True, tag=True):
    """One time that was measured."""

    count: int
    seconds: float


Entry = Exchange | Begin | Tick


class _Recorded:
    """What a recording holds of one episode."""

    def __init__(self) -> None:
        self.exchanges: dict[tuple[str, int], Exchange] = {}  # by key and count
        self.seconds: dict[int, float] = {}  # by count


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


def line_key_of(line: Entry) -> str:
    """Return the SHA-256 of a line's own fields; request and reply count by their hashes."""
    fields = {name: getattr(line, name) for name in line.__struct_fields__}
    for name in ("request", "reply", "line_key"):
        fields.pop(name, None)
    return key_of({**fields, "type": type(line).__name__})


class Cassette:
    """One recording: "record" asks and keeps, "replay" answers from the file only, "off" asks.

    Raises:
        CassetteError: nothing to replay, a line is damaged, (replay only) the last is torn, or
            another process records here and no token of it is given.
    """

    def __init__(
        self, folder: str | Path | None = None, mode: Mode = "off", *, token: str = ""
    ) -> None:
        if mode != "off" and folder is None:
            raise CassetteError(FILE, "no folder is given", fix="add --cassette DIR")
        self.mode = mode
        self.path = Path(folder or ".") / FILE
        self._episodes: defaultdict[str, _Recorded] = defaultdict(_Recorded)
        self._shared: dict[str, Exchange] = {}
        self._lines = 0  # read so far
        self._keyed = False  # a line with its hash was read: those behind it have theirs, too
        self._asked: Counter[str] = Counter()
        self.scope = ""  # the episode that is going on; "" before the first
        self._measured, self._start = 0, time.perf_counter()
        self._recording: Recording | None = None
        if mode == "record":
            with self._errors_of_the_file():
                self._recording = Recording(self.path, token)
                with self._recording.turn():
                    self._take_all(self._recording.news())
        elif mode == "replay":
            self._take_all(self._whole_lines())

    @classmethod
    def of(cls, tape: Tape) -> Self:
        """Join a cassette; errors as those of the class."""
        return cls(tape.folder, tape.mode, token=tape.token)

    @property
    def tape(self) -> Tape:
        """What another process needs to join it."""
        token = self._recording.token if self._recording else ""
        return Tape(folder=self.path.parent, mode=self.mode, token=token)

    def begin(self, scope: str) -> None:
        """Start an episode; recording, what an earlier attempt at it left is forgotten.

        CassetteError where the file cannot be written.
        """
        self.scope, self._measured, self._start = scope, 0, time.perf_counter()
        self._asked.clear()
        if self.mode == "record":
            self._write(Begin(scope=scope))

    def clock(self) -> float:
        """Return the seconds since the episode began; errors as in `measured`."""
        return self.measured(time.perf_counter() - self._start)

    def measured(self, seconds: float) -> float:
        """Return a time that was measured, or in a replay what was measured in its place then.

        CassetteError where a replay measures more often than the recording did.
        """
        if self.mode == "off":
            return seconds
        count, self._measured = self._measured, self._measured + 1
        if self.mode == "record":
            self._write(Tick(scope=self.scope, count=count, seconds=seconds))
            return seconds
        found = self._episodes[self.scope].seconds.get(count)
        if found is None:
            reason = f"episode {self.scope!r} went another way than its recording: there is"
            raise CassetteError(self.path, f"{reason} no time {count + 1}", fix=_AGAIN)
        return found

    def exchange(
        self,
        request: Mapping[str, Any],
        send: Callable[[], Reply],
        *,
        url: str = "",
        shared: bool = False,
    ) -> Exchange:
        """Ask by `send`, or look up what was answered; `url` is kept beside the request.

        `shared`: equal requests have equal answers (embeddings), so one is enough: the first in
        the file. Two processes may still ask at once; then the second answer holds for its own
        place only.

        Raises:
            CassetteError: a replay asks for what was not recorded, or the file cannot be written.
        """
        wanted = canonical(request)
        key = key_of(wanted)
        count = self._asked[key]
        self._asked[key] += 1
        if self.mode == "replay":
            mine = self._episodes[self.scope].exchanges
            found = mine.get((key, count)) or self._shared.get(key)
            if found is None:
                raise CassetteError(self.path, self._miss(key, count, wanted), fix=_AGAIN)
            return found
        if shared and (known := self._known(key)):
            return known
        begun = time.perf_counter()
        reply = send()
        made = Exchange(
            scope=self.scope, count=count, key=key, request=wanted, url=url, reply=reply,
            reply_key=key_of(reply), seconds=time.perf_counter() - begun,
            shared=shared and not reply.failure,
        )  # fmt: skip
        self._write(made)
        return made

    # ------------------------------------------------------------- the file

    def _write(self, line: Entry) -> None:
        """Add a line to the recording, if there is one."""
        if self._recording is None:
            self._take(line)
            return
        with self._errors_of_the_file():
            with self._recording.turn():
                if isinstance(line, Exchange) and line.shared:
                    self._look_up()
                    line = msgspec.structs.replace(line, shared=line.key not in self._shared)
                line = msgspec.structs.replace(line, line_key=line_key_of(line))
                append_line(self.path, to_json(line), sync=False)
            append_line(self.path, b"")  # to the disk; by now nobody waits for their turn
        self._take(line)

    def _known(self, key: str) -> Exchange | None:
        """Return the answer that holds in every episode, whoever has asked for it."""
        if key not in self._shared and self._recording is not None:
            with self._errors_of_the_file(), self._recording.turn():
                self._look_up()
        return self._shared.get(key)

    def _look_up(self) -> None:
        """Take in what other processes have added that holds in every episode."""
        if self._recording is not None:
            self._take_all(self._recording.news(), only=_SHARED)

    @contextmanager
    def _errors_of_the_file(self) -> Iterator[None]:
        """Raise errors of the file as the cassette's."""
        try:
            yield
        except CassetteError:
            raise
        except FileError as error:
            raise CassetteError(self.path, error.reason, fix=error.fix) from error

    def _take_all(self, lines: Sequence[bytes], *, only: bytes = b"") -> None:
        for line in lines:
            self._lines += 1
            if only in line:
                self._take(self._decoded(line, self._lines))

    def _take(self, line: Entry) -> None:
        if isinstance(line, Exchange) and line.shared:
            self._shared.setdefault(line.key, line)
        elif self.mode == "replay":  # nobody else looks them up
            match line:
                case Exchange():
                    self._episodes[line.scope].exchanges[line.key, line.count] = line
                case Tick():
                    self._episodes[line.scope].seconds[line.count] = line.seconds
                case Begin():
                    self._episodes.pop(line.scope, None)

    def _whole_lines(self) -> list[bytes]:
        """Return the lines of a recording that is to be replayed."""
        if not self.path.exists():
            fix = "record one first: --cassette-mode record"
            raise CassetteError(self.path, "there is no such cassette", fix=fix)
        *lines, torn = read_bytes(self.path, most=LARGEST_LOG).split(b"\n")
        if torn:
            reason = f"line {len(lines) + 1} is torn: the end is missing"
            raise CassetteError(self.path, reason, fix=f"{_AGAIN}; what is whole is kept")
        return lines

    def _decoded(self, line: bytes, number: int) -> Entry:
        fix = "take it from a copy, or record into another folder"
        try:
            found: Entry = decode_json(line, Entry, path=self.path)  # type: ignore[arg-type]
        except FileError as error:
            reason = f"line {number}: {error.reason}"
            raise CassetteError(self.path, reason, fix=fix) from error
        self._keyed = self._keyed or bool(found.line_key)
        wrong = ""
        if isinstance(found, Exchange) and key_of(found.request) != found.key:
            wrong = "the request is not what its SHA-256 says"
        elif isinstance(found, Exchange) and key_of(found.reply) != found.reply_key:
            wrong = "the reply is not what its SHA-256 says"
        elif self._keyed and found.line_key != line_key_of(found):
            wrong = "episode, time or place is not what the line's SHA-256 says"
        if wrong:
            raise CassetteError(self.path, f"line {number}: {wrong}", fix=fix)
        return found

    # ------------------------------------------------------------- a miss

    def _miss(self, key: str, count: int, wanted: Mapping[str, Any]) -> str:
        scope = self.scope
        mine = self._episodes[scope].exchanges
        if times := sum(1 for found, _ in mine if found == key):
            return (
                f"request {key[:12]} was recorded {times} times in episode {scope!r}"
                f" and is asked once more (time {count + 1})"
            )
        recorded = [line for one in self._episodes.values() for line in one.exchanges.values()]
        among = list(mine.values()) or [*recorded, *self._shared.values()]
        return describe_miss(
            wanted, [(line.scope, line.request) for line in among], scope=scope, key=key
        )


def describe_miss(
    wanted: Mapping[str, Any],
    recorded: Sequence[tuple[str, Mapping[str, Any]]],
    *,
    scope: str,
    key: str,
) -> str:
    """Return a message with the nearest of (episode, request), and how it differs."""
    asked = f"request {key[:12]} of episode {scope!r} was not recorded"
    if not recorded:
        return f"{asked}: the cassette holds no exchange"
    lines = readable(wanted)
    where, nearest = _nearest(lines, recorded)
    found = readable(nearest)
    if found == lines:
        return f"{asked}: the same was asked in episode {where!r} only"
    names = (f"recorded in {where!r}", "asked now")
    diff = [
        line if len(line) <= MAX_WIDTH else f"{line[: MAX_WIDTH - 3]}..."
        for line in unified_diff(found, lines, *names, lineterm="", n=1)
    ]
    if len(diff) > MAX_LINES:
        diff = [*diff[:MAX_LINES], f"... and {len(diff) - MAX_LINES} lines more"]
    return "\n    ".join([f"{asked}; the nearest differs:", *diff])


def readable(request: Mapping[str, Any]) -> list[str]:
    """Return a request as lines: JSON, but a text of several lines is a line each.

    >>> readable({"model": "m", "prompt": "a" + chr(10) + "b"})
    ['model: "m"', 'prompt: |a', 'prompt: |b']
    """
    return list(_lines("", request))


def _lines(path: str, value: Any) -> list[str]:
    if isinstance(value, Mapping):
        return [ln for k in sorted(value) for ln in _lines(f"{path}.{k}" if path else k, value[k])]
    if isinstance(value, list | tuple) and any(isinstance(v, Mapping) for v in value):
        return [line for n, item in enumerate(value) for line in _lines(f"{path}[{n}]", item)]
    if isinstance(value, str) and "\n" in value:
        return [f"{path}: |{part}" for part in value.removesuffix("\n").split("\n")]
    return [f"{path}: {json.dumps(value, ensure_ascii=False)}"]


def _nearest(
    lines: Sequence[str], recorded: Sequence[tuple[str, Mapping[str, Any]]]
) -> tuple[str, Mapping[str, Any]]:
    """Return the one with most lines in common, then the likest other lines, then the first."""
    mine = set(lines)
    others = [readable(request) for _, request in recorded]
    common = [len(mine & set(other)) for other in others]
    most = max(common)
    alike = [number for number, shared in enumerate(common) if shared == most][:_COMPARED]

    def unlikeness(number: int) -> float:
        theirs = set(others[number])
        left = "\n".join(line for line in lines if line not in theirs)
        right = "\n".join(line for line in others[number] if line not in mine)
        return -SequenceMatcher(None, left[:_LONGEST], right[:_LONGEST], autojunk=False).ratio()

    return recorded[min(alike, key=lambda number: (unlikeness(number), number))]
