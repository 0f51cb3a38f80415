"""The episodic log: what was so and when, in SQLite, with the vectors of its texts in FAISS.

An episode is one thing at one place in one state, from the first to the last sighting of it; an
unchanged sighting extends it, only changes make rows. The index is made from the rows' distinct
texts, when a text is first asked for, so it cannot differ from them. The log is in memory, and gone
with the process.
"""

import json
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, fields
from typing import Any, Literal

import faiss
import numpy as np

from karma.plugins.homes.memory.setting import KnownPlace, sighting_text
from karma.plugins.homes.types import Deed, Sighting
from karma.types.roles import Embedder

MOST_EPISODES = 200_000  # closed ones kept; beyond it the oldest go
SPARE = 0.02  # share of the most that goes at once, so that it is not done for every row
NEAREST = 64  # texts that are looked up at once
FEW = 2_000  # episodes that fit all but the text: so many are ranked one by one
Reason = Literal["", "not there", "seen elsewhere", "otherwise", "carried off"]
_TABLES = """
create table texts (id integer primary key, text text unique not null);
create table episodes (
    id integer primary key, object_id text not null, object_type text not null, place_id text,
    room text not null, states text not null, x real not null, y real not null, z real not null,
    since_s real not null, until_s real not null,
    who text not null, action text not null, deed text, is_open integer not null,
    text_id integer not null
);
create index by_text on episodes (text_id, until_s);
create index by_type on episodes (object_type, since_s);
create index by_time on episodes (since_s);
create index by_end on episodes (is_open, until_s);
create index by_deed on episodes (who, action, since_s);
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
    """The log of one home, of which at most `most_episodes` closed ones are kept."""

    def __init__(
        self,
        embedder: Embedder,
        places: Mapping[str, KnownPlace],
        *,
        most_episodes: int = MOST_EPISODES,
    ) -> None:
        self._embedder, self._places = embedder, places
        self._most = most_episodes
        self._base = sqlite3.connect(":memory:")
        self._base.executescript(_TABLES)
        self._texts: dict[str, int] = {}
        self._index: Any = None
        self._indexed: set[int] = set()
        self._closed = 0
        self._open: dict[str, tuple[int, float]] = {}

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

    def close(self) -> None:
        """Let go of what is kept."""
        self._base.close()

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

    def episodes(self) -> Iterator[Belief]:
        """Yield all episodes by their beginnings."""
        for row in self._base.execute(f"{_SELECT} order by since_s, id"):
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
        """Return how large the log is."""
        pages = self._base.execute("pragma page_count").fetchone()[0]
        return int(pages * self._base.execute("pragma page_size").fetchone()[0])


_SELECT = (
    "select id, object_id, object_type, place_id, room, states, x, y, z, since_s, until_s, deed,"
    " text_id from episodes"
)
_TEXT = 12  # column of text_id
_DEED = tuple(one.name for one in fields(Deed))


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
