"""The episodic log: what was so and when, in SQLite, with the vectors of its texts in FAISS.

An episode is one thing at one place in one state, from the first to the last sighting of it; an
unchanged sighting extends it, only changes make rows. Rows are written as they come and committed
when an instruction is finished: a killed process loses at most what came after the last commit. A
log that was closed is sealed: its SHA-256 lies beside it until it is opened again. The
index is made from the rows' distinct texts, when a text is first asked for, so it cannot differ
from them.
"""

import json
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import astuple, dataclass, fields
from math import fsum
from pathlib import Path
from typing import Any, Literal

import faiss
import numpy as np

from karma.contracts import Embedder
from karma.errors import FileError
from karma.files import check_sealed_file, read_bytes, sha256_of, write_atomic
from karma.plugins.homes.memory.setting import KnownPlace, sighting_text
from karma.plugins.homes.types import Deed, Sighting

APPLICATION = 0x4B524D41  # "KRMA", in the file's header
VERSION = 2
SEAL = ".sha256"  # what the name of the file beside it ends in; there while the log is closed
MOST_EPISODES = 200_000  # closed ones kept; beyond it the oldest go
SPARE = 0.02  # share of the most that goes at once, so that it is not done for every row
NEAREST = 64  # texts that are looked up at once
FEW = 2_000  # episodes that fit all but the text: so many are ranked one by one
Reason = Literal["", "not there", "seen elsewhere", "otherwise", "carried off"]
_TABLES = """
create table if not exists texts (id integer primary key, text text unique not null);
create table if not exists episodes (
    id integer primary key, object_id text not null, object_type text not null, place_id text,
    room text not null, states text not null, x real not null, y real not null, z real not null,
    since_s real not null, until_s real not null,
    who text not null, action text not null, deed text, is_open integer not null,
    text_id integer not null
);
create index if not exists by_text on episodes (text_id, until_s);
create index if not exists by_type on episodes (object_type, since_s);
create index if not exists by_time on episodes (since_s);
create index if not exists by_end on episodes (is_open, until_s);
create index if not exists by_deed on episodes (who, action, since_s);
create table if not exists kept (
    part text not null, name text not null, value text not null, primary key (part, name)
);
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Belief:
    """The last that is known of one thing: an episode of it, and what is doubted of that."""

    sighting: Sighting  # the last
    since_s: float  # from when on it was seen to be so
    deed: Deed | None = None  # that it began with
    chance: float = 1.0  # that it was still so when it was looked for last
    looked_s: float | None = None  # when that was; None: it was seen since
    ended_s: float | None = None
    reason: Reason = ""  # why it ended, or why the one before it did


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeQuery:
    """What is asked of the log; what is left out is not asked."""

    types: tuple[str, ...] = ()
    text: str = ""  # the nearest texts first; "" the newest first
    after_s: float | None = None
    before_s: float | None = None
    state: str = ""
    who: str = ""
    action: str = ""
    by_deed: bool = False  # those that somebody's deed began


class EpisodeLog:
    """The log of one home.

    Args:
        path: of the file, made if there is none; None: in memory, gone with the process.
        embedder: of texts.
        places: furniture of the home.
        most_episodes: closed ones that are kept.

    Raises:
        FileError: the file is torn, edited since it was closed, in use, or no episodic log.
    """

    def __init__(
        self,
        path: Path | None,
        embedder: Embedder,
        places: Mapping[str, KnownPlace],
        *,
        most_episodes: int = MOST_EPISODES,
    ) -> None:
        self._path, self._embedder, self._places = path, embedder, places
        self._most = most_episodes
        self._base = _opened(path)
        self._texts: dict[str, int] = dict(self._base.execute("select text, id from texts"))
        self._index: Any = None
        self._indexed: set[int] = set()
        self._closed = self._count("is_open = 0")
        rows = self._base.execute(
            "select object_id, id, until_s from episodes where is_open = 1 order by since_s, id"
        )
        self._open = {object_id: (number, until_s) for object_id, number, until_s in rows}

    def __len__(self) -> int:
        return self._count("1")

    def _count(self, which: str) -> int:
        return int(self._base.execute(f"select count(*) from episodes where {which}").fetchone()[0])

    # ------------------------------------------------------------- writing

    def begin(self, belief: Belief) -> None:
        """Write an episode that goes on; each thing has one."""
        seen, deed = belief.sighting, belief.deed
        cursor = self._base.execute(
            "insert into episodes (object_id, object_type, place_id, room, states, x, y, z,"
            " since_s, until_s, who, action, deed, is_open, text_id)"
            " values (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, 1, ?)",
            (
                seen.object_id, seen.object_type, seen.place_id, seen.room,
                f" {' '.join(seen.states)} ", *seen.position_m, belief.since_s, seen.time_s,
                deed.who if deed else "", deed.action if deed else "",
                None if deed is None else json.dumps(astuple(deed)),
                self._text_id(sighting_text(seen, self._places)),
            ),
        )  # fmt: skip
        self._open[seen.object_id] = (int(cursor.lastrowid or 0), seen.time_s)

    def extend(self, belief: Belief) -> None:
        """Note when the thing of an episode that goes on was seen last."""
        seen = belief.sighting
        number, until_s = self._open.get(seen.object_id, (0, seen.time_s))
        if until_s != seen.time_s:
            self._base.execute(
                "update episodes set until_s = ? where id = ?", (seen.time_s, number)
            )
            self._open[seen.object_id] = (number, seen.time_s)

    def end(self, belief: Belief) -> None:
        """End the episode of a belief; the oldest go when there are too many."""
        number, _ = self._open.pop(belief.sighting.object_id, (0, 0.0))
        if number:
            self._base.execute(
                "update episodes set until_s = ?, is_open = 0 where id = ?",
                (belief.sighting.time_s, number),
            )
            self._closed += 1
        if self._closed > self._most:
            self._make_room(self._closed - self._most + int(self._most * SPARE))

    def drop(self, object_id: str) -> None:
        """Forget all episodes of a thing."""
        self._open.pop(object_id, None)
        self._base.execute("delete from episodes where object_id = ?", (object_id,))
        self._closed = self._count("is_open = 0")

    def keep(self, part: str, values: Mapping[str, Any]) -> None:
        """Write small things beside the episodes, as JSON by part and key."""
        rows = [(part, key, json.dumps(value)) for key, value in values.items()]
        self._base.executemany("insert or replace into kept values (?, ?, ?)", rows)

    def kept(self, part: str) -> dict[str, Any]:
        """Return what was kept of a part, by key."""
        rows = self._base.execute(
            "select name, value from kept where part = ? order by name", (part,)
        )
        return {key: json.loads(value) for key, value in rows}

    def commit(self) -> None:
        """Make everything written so far survive the end of the process.

        Raises:
            FileError: the disk is full or the file cannot be written; nothing is half written.
        """
        with _naming(self._path):
            self._base.commit()

    def close(self) -> None:
        """Commit, let go of the file and, where nobody else has it open, seal it."""
        self.commit()
        self._base.close()
        path = self._path
        if path is not None and not path.with_name(f"{path.name}-wal").exists():
            line = f"{sha256_of(path)}  {path.name}\n"  # as `sha256sum -c` reads it
            write_atomic(_seal_of(path), line.encode())

    def _make_room(self, number: int) -> None:
        """Let the oldest closed episodes go, with the texts that no episode has any more."""
        self._base.execute(
            "delete from episodes where id in"
            " (select id from episodes where is_open = 0 order by until_s limit ?)",
            (number,),
        )
        self._base.execute(
            "delete from texts where not exists"
            " (select 1 from episodes where episodes.text_id = texts.id)"
        )
        self._texts = dict(self._base.execute("select text, id from texts"))
        self._index, self._indexed = None, set()
        self._closed = self._count("is_open = 0")

    def _text_id(self, text: str) -> int:
        found = self._texts.get(text)
        if found is None:
            cursor = self._base.execute("insert into texts (text) values (?)", (text,))
            found = self._texts[text] = int(cursor.lastrowid or 0)
        return found

    # ------------------------------------------------------------- reading

    def episodes(self, *, only_open: bool = False) -> Iterator[Belief]:
        """Yield all episodes, or those that go on, by their beginnings."""
        which = "where is_open = 1 " if only_open else ""
        for row in self._base.execute(f"{_SELECT} {which}order by since_s, id"):
            yield _episode(row)

    def recall(self, query: EpisodeQuery, k: int) -> list[Belief]:
        """Return at most k episodes that fit; of a text the nearest first, else the newest."""
        where, values = _conditions(query)
        if not query.text:
            newest = self._base.execute(
                f"{_SELECT} {where} order by since_s desc, id desc limit ?", (*values, k)
            )
            return [_episode(row) for row in newest]
        ranked = self._ranked(query.text)
        few = self._base.execute(
            f"select id, text_id, until_s from episodes {where} limit ?", (*values, FEW + 1)
        ).fetchall()
        if len(few) <= FEW:
            rank = {number: at for at, number in enumerate(ranked)}
            few.sort(key=lambda row: (rank[row[1]], -row[2], -row[0]))
            one = f"{_SELECT} where id = ?"
            return [_episode(self._base.execute(one, row[:1]).fetchone()) for row in few[:k]]
        return self._by_text(where, values, ranked, k)

    def _by_text(
        self, where: str, values: Sequence[Any], ranked: Sequence[int], k: int
    ) -> list[Belief]:
        """Return episodes text by text, the nearest texts first, the newest of each first."""
        found: list[Belief] = []
        glue = "and" if where else "where"
        for first in range(0, len(ranked), NEAREST):
            numbers = ranked[first : first + NEAREST]
            rows = self._base.execute(
                f"{_SELECT} {where} {glue} text_id in ({','.join('?' * len(numbers))})"
                " order by until_s desc, id desc limit ?",
                (*values, *numbers, k * NEAREST),
            ).fetchall()
            rank = {number: at for at, number in enumerate(numbers)}
            rows.sort(key=lambda row: rank[row[_TEXT]])  # stable: the newest of equals first
            found += [_episode(row) for row in rows[: k - len(found)]]
            if len(found) >= k:
                break
        return found

    def _ranked(self, text: str) -> list[int]:
        """Return the numbers of all texts, the nearest first; the earlier of equals first."""
        self._catch_up()
        asked = self._embedder.embed([text])
        (scores,), (numbers,) = self._index.search(asked, len(self._indexed))
        ranked: list[int] = numbers[np.lexsort((numbers, -scores))].tolist()
        return ranked

    def _catch_up(self) -> None:
        """Embed the texts that are not in the index yet."""
        new = {number: text for text, number in self._texts.items() if number not in self._indexed}
        if self._index is None:
            self._index = faiss.IndexIDMap(faiss.IndexFlatIP(self._embedder.dimension))
        if new:
            vectors = np.ascontiguousarray(self._embedder.embed(list(new.values())))
            self._index.add_with_ids(vectors, np.array(list(new), dtype=np.int64))
            self._indexed |= new.keys()

    def size_bytes(self) -> int:
        """Return how large the file is, or would be."""
        pages = self._base.execute("pragma page_count").fetchone()[0]
        return int(pages * self._base.execute("pragma page_size").fetchone()[0])


_SELECT = (
    "select id, object_id, object_type, place_id, room, states, x, y, z, since_s, until_s, deed,"
    " text_id from episodes"
)
_TEXT = 12  # column of text_id
_DEED = tuple(one.name for one in fields(Deed))


class _Base(sqlite3.Connection):
    """A connection whose errors name the file."""

    path: Path | None = None

    def execute(self, *given: Any) -> sqlite3.Cursor:
        """Execute a statement; FileError where the file does not let it."""
        with _naming(self.path):
            return super().execute(*given)


def _opened(path: Path | None) -> _Base:
    """Return the base, with its tables; its pages are looked through unless its seal held."""
    sealed = path is not None and _unsealed(path)
    with _naming(path):
        base = sqlite3.connect(":memory:" if path is None else path, factory=_Base)
        base.path = path
        mark = base.execute("pragma application_id").fetchone()[0]
        empty = base.execute("select count(*) from sqlite_master").fetchone()[0] == 0
        version = base.execute("pragma user_version").fetchone()[0]
        if not empty and (mark != APPLICATION or version != VERSION):
            raise FileError(
                path or "", f"no episodic log of version {VERSION}", fix="name another file"
            )
        base.execute("pragma journal_mode = wal")
        base.execute("pragma synchronous = normal")  # a killed process loses no commit
        base.execute(f"pragma application_id = {APPLICATION}")
        base.execute(f"pragma user_version = {VERSION}")
        base.executescript(_TABLES)
        if path is not None and not sealed:
            _look_through(base)
    return base


def _look_through(base: sqlite3.Connection) -> None:
    """Read all there is, as nothing else tells whether the disk has kept it."""
    if (said := base.execute("pragma integrity_check").fetchone()[0]) != "ok":
        raise sqlite3.DatabaseError(said)
    for row in base.execute(_SELECT):
        _episode(row)
        fsum(row[6:11])  # position and times are numbers
    for (value,) in base.execute("select value from kept"):
        json.loads(value)


def _unsealed(path: Path) -> bool:
    """Take a log's seal away, and return whether there was one; FileError where it is broken."""
    seal = _seal_of(path)
    if not seal.exists():
        return False
    if sound := path.exists():
        sha256 = read_bytes(seal).decode(errors="replace").partition(" ")[0]
        check_sealed_file(path, sha256, fix=_fix(path))
    seal.unlink()
    return sound


def _seal_of(path: Path) -> Path:
    return path.with_name(path.name + SEAL)


def _fix(path: Path | str) -> str:
    return f"bring back a copy, or begin anew: rm {path} {path}{SEAL}"


@contextmanager
def _naming(path: Path | None) -> Iterator[None]:
    """Turn what SQLite and damaged rows raise into a FileError of the file."""
    try:
        yield
    except (sqlite3.Error, ValueError, TypeError) as error:
        name, reason, fix = path or ":memory:", str(error), _fix(path or ":memory:")
        match getattr(error, "sqlite_errorcode", 0) & 0xFF:
            case sqlite3.SQLITE_BUSY | sqlite3.SQLITE_LOCKED:
                fix = "another process is at work in it: end that one, then go on"
            case sqlite3.SQLITE_FULL | sqlite3.SQLITE_IOERR:
                fix = "free space, then go on: what was committed before is kept"
            case sqlite3.SQLITE_READONLY | sqlite3.SQLITE_CANTOPEN:
                fix = "name a file in a folder that may be written"
            case _:
                reason = f"torn, or no episodic log: {reason}"
        raise FileError(name, reason, fix=fix) from error


def _conditions(query: EpisodeQuery) -> tuple[str, tuple[Any, ...]]:
    """Return the where clause of a query and its values."""
    time_s = "since_s" if query.who or query.action else "until_s"
    asked: list[tuple[str, Sequence[Any]]] = [
        (f"object_type in ({','.join('?' * len(query.types))})", query.types),
        ("who = ?", [query.who] if query.who else []),
        ("action = ?", [query.action] if query.action else []),
        ("states like ?", [f"% {query.state} %"] if query.state else []),
        ("since_s <= ?", [] if query.before_s is None else [query.before_s]),
        (f"{time_s} >= ?", [] if query.after_s is None else [query.after_s]),
    ]
    parts = [part for part, values in asked if values] + ["deed is not null"] * query.by_deed
    where = f"where {' and '.join(parts)}" if parts else ""
    return where, tuple(value for _, values in asked for value in values)


def _deed_of(text: str | None) -> Deed | None:
    if text is None:
        return None
    values = dict(zip(_DEED, json.loads(text), strict=True))
    return Deed(**values | {"states": tuple(values["states"])})


def _episode(row: Sequence[Any]) -> Belief:
    _, object_id, kind, place_id, room, states, x, y, z, since_s, until_s, deed, _ = row
    return Belief(
        sighting=Sighting(
            time_s=until_s, object_id=object_id, object_type=kind, place_id=place_id, room=room,
            position_m=(x, y, z), states=_words(states),
        ),
        since_s=since_s,
        deed=_deed_of(deed),
    )  # fmt: skip


def _words(text: str) -> tuple[str, ...]:
    """Return state words as they were: "used up" is one."""
    joined = text.strip().replace("used up", "used_up").split()
    return tuple(word.replace("_", " ") for word in joined)
