"""Sentences of docs/results.md on homes where people live, and what their records hold."""

import re
from collections.abc import Iterator, Sequence

from support.figures import Claim, Figure, bare, cell, column_of, row, span

LIVED = "eval/results/lived/{}.md".format
RIGHT, MINUS, STALE = "rightly, by kind", "Ours minus the row", "Stale beliefs"
GRAPH = "temporal graph (Zep-style)"


def right(of: str, column: str, record: str = "table", setting: str | None = None) -> Figure:
    return bare(cell(LIVED(record), RIGHT, (of, setting) if setting else (of,), column))


def stale(of: str, column: str, record: str = "table", setting: str = "usual") -> Figure:
    return cell(LIVED(record), STALE, (of, setting), column)


COLUMNS = ("event", "time", "count", "several", "changed", "all")
LIVED_ROWS = {
    "ours, never looks before it answers": "ours, never looks first",
    "ours, ten units and no log": "ours, ten units",
    GRAPH: GRAPH,
    "MemGPT-style": "MemGPT-style",
    "mem0-style": "mem0-style",
    "append-only RAG": "append-only RAG",
    "ReMEmbR-style": "ReMEmbR-style",
    "KARMA, W-TinyLFU, open loop": "KARMA, W-TinyLFU, open loop",
    "control: last seen": "last seen",
    "control: last seen, always looks": "last seen, always looks",
    "control: no memory": "no memory",
    "expert": "expert",
}


def lived_table() -> Iterator[Claim]:
    whole = cell(LIVED("table"), RIGHT, ("ours",), "all")
    yield row("ours", *([right("ours", column)] for column in COLUMNS[:-1]), [whole])
    for shown, name in LIVED_ROWS.items():
        yield row(shown, *([right(name, column)] for column in COLUMNS))
    karma = ("KARMA, W-TinyLFU", "KARMA, FIFO")
    pairs = [[right(name, column) for name in karma] for column in COLUMNS]
    yield row("KARMA, W-TinyLFU / FIFO", *pairs)
    yield from lived_differences()
    yield from stale_actions()
    yield from lived_rest()


def lived_differences() -> Iterator[Claim]:

    def minus(of: str, column: str) -> Figure:
        return cell(LIVED("table"), MINUS, (of,), column)

    yield (
        "changed {}, several {}, event {}, all surely",
        [minus(GRAPH, column) for column in ("changed", "several", "event")],
    )
    looks = [minus(of, "changed") for of in ("ours, never looks first", "last seen, always looks")]
    yield (
        "looking before it answers gives ours {}. Beside the control that always looks it is {};",
        looks,
    )
    less = minus(GRAPH, "count")
    flipped = [f"{-float(n):.2f}" for n in re.findall(r"[-+][\d.]+", less.text)]
    below = Figure(text=f"{flipped[0]} [{flipped[2]}, {flipped[1]}]", record=less.record)
    counts = [right(of, "count") for of in ("ours", GRAPH, "last seen")]
    yield "below on counts**, by {} ({} beside {} and {})", [below, *counts]


def stale_actions() -> Iterator[Claim]:
    of = ("ours", "append-only RAG", GRAPH, "last seen")
    yield (
        "{} % of all actions for requests (aimed at 5 %),"
        " append-only {} %, the graph {} %, last seen {} %.",
        [stale(name, "stale actions") for name in of],
    )
    settings = [
        (record, setting)
        for record in ("table", "disturbance", "objects", "words")
        for setting in dict.fromkeys(key[1] for key in column_of(LIVED(record), STALE, "setting"))
    ]

    def share(name: str, at: tuple[str, str]) -> float:
        return float(stale(name, "stale actions", *at).text.split()[0])

    above = [at for at in settings if share("ours", at) > min(share(name, at) for name in of[1:])]
    counts = [Figure(text=str(len(some)), record="lived/table.md") for some in (above, settings)]
    yield "In {} of the {} settings of this table and of the curves", counts
    at = ("disturbance", "30 %")
    yield (
        "at 30 % moved {} %, last seen {} %.",
        [stale(n, "stale actions", *at) for n in (of[0], of[3])],
    )
    names = ("ours", "KARMA, FIFO", "KARMA, W-TinyLFU, open loop", "ReMEmbR-style")
    yield (
        "{} % of ours are in vain, of the other designs' {} % (KARMA, FIFO)"
        " to {} % (KARMA, open loop), ReMEmbR-style {} %.",
        [stale(name, "stale looks") for name in names],
    )
    loops = [stale(f"KARMA, W-TinyLFU{loop}", "stale looks") for loop in ("", ", open loop")]
    yield "memory sends them on {} % and {} % are in vain", loops


def lived_rest() -> Iterator[Claim]:
    open_loop = [right(f"KARMA, W-TinyLFU{loop}", "all") for loop in ("", ", open loop")]
    yield "the closed loop serves {} and the open one {};", open_loop
    briers = {
        key: text for key, text in column_of(LIVED("table"), STALE, "Brier").items() if "*" in text
    }
    sure = span(
        [Figure(text=text.rstrip("*"), record="lived/table.md") for text in briers.values()]
    )
    ends = [Figure(text=f"{float(f.text):.2f}", record=f.record) for f in sure]
    yield "still there\" {}, of the designs that take all for sure {} to {} (last seen {}).", [
        stale("ours", "Brier"), *ends, stale("last seen", "Brier")
    ]  # fmt: skip
    where = "Where the thing is"
    ten = ("ours, ten units",)
    yield (
        "Ten units knew {} of the things asked for, KARMA's {};",
        [cell(LIVED("table"), where, of, "knew") for of in (ten, ("KARMA, W-TinyLFU",))],
    )
    yield "could have known {}, as many", [cell(LIVED("table"), where, ten, "at best")]
    kib = [stale(name, "KiB") for name in ("ours, ten units", "KARMA, W-TinyLFU")]
    yield "learnt rates beside them: {} KiB, KARMA {}.", kib
    moved = stale("ours", "moved")
    percent = Figure(text=str(round(100 * float(moved.text))), record=moved.record)
    yield "a week each, {} % of the things moved a day", [percent]
    served = [
        cell(LIVED("table"), RIGHT, (of,), "all")
        for of in ("KARMA, W-TinyLFU", "no memory", "ours")
    ]
    still = cell(LIVED("disturbance"), RIGHT, ("KARMA, W-TinyLFU", "0 %"), "all")
    yield (
        "With {} % of the things moved a day its ten units serve {} of the requests,"
        " a robot without a memory {}, a memory that stays true {}.",
        [percent, *served],
    )
    yield "the ten units serve {}.", [still]
    yield from curves()


def curves() -> Iterator[Claim]:
    def over(record: str, of: str, column: str = "all", heading: str = RIGHT) -> list[Figure]:
        cells = column_of(LIVED(record), heading, column)
        return span(
            [
                Figure(text=t, record=f"lived/{record}.md")
                for key, t in cells.items()
                if key[0] == of
            ]
        )

    def changed(record: str, setting: str, names: Sequence[str]) -> list[Figure]:
        return [
            right("ours", "changed", record, setting),
            span([right(n, "changed", record, setting) for n in names])[1],
        ]

    others = ("append-only RAG", GRAPH, "KARMA, W-TinyLFU", "last seen")

    def spent(record: str) -> list[Figure]:
        return over(record, "ours", "stale actions", STALE)

    def down(record: str, of: str) -> list[Figure]:
        return over(record, of)[::-1]

    def served(record: str, setting: str) -> list[Figure]:
        best = [*down(record, "ours"), *down(record, GRAPH)]
        return [*best, *changed(record, setting, others), *spent(record)]

    at = [stale(name, "stale actions", "disturbance", "30 %") for name in ("ours", "last seen")]
    yield (
        "| {} to {} | graph {} to {} | {}, {} at 50 % | {} to {} %; at 30 % {}, last seen {} |",
        [*served("disturbance", "50 %"), *at],
    )
    yield (
        "| {} to {} | graph {} to {} | {}, {} at 160 | {} to {} % |",
        served("objects", "160 things"),
    )
    own, karma = "ours, ten units", ("KARMA, W-TinyLFU", "KARMA, FIFO", "KARMA, LRU")
    rest = [figure for of in ("MemGPT-style", *karma) for figure in over("units", of, "changed")]
    yield (
        "in place of the log {} to {} | KARMA {} to {}; FIFO, LRU and W-TinyLFU alike;"
        " MemGPT-style {} to {} | {} to {}, {} | {} to {} % with the log |",
        [
            *over("units", own), *over("units", karma[0]), *down("units", "MemGPT-style"),
            *over("units", own, "changed"), span(rest)[1], *spent("units"),
        ],
    )  # fmt: skip
    names = ("known names", "held-out names")
    yield (
        "| {}/{} | graph {}/{} | {}, {} held out | {}/{} % |",
        [
            *(right(of, "all", "words", name) for of in ("ours", GRAPH) for name in names),
            *changed("words", names[1], others),
            *(stale("ours", "stale actions", "words", name) for name in names),
        ],
    )
    yield "With held-out names the expert falls to {}:", [right("expert", "all", "words", names[1])]
    still = [right(of, "all", "disturbance", "0 %") for of in ("ours", GRAPH)]
    yield "ours gains nothing ({}, the graph {}).", still
