"""Sentences of README.md and docs/results.md whose figures committed records hold.

Each is the text as it stands on the page, with `{}` for each figure, and what the records say. Rows
of tables are made from the records by `row`.
"""

import re
from collections.abc import Callable, Iterator, Sequence

from support.documents import text_of
from support.figure_claims_lived import lived_table
from support.figures import (
    RESULTS,
    Claim,
    Figure,
    asked,
    bare,
    cell,
    column_of,
    counted,
    in_json,
    in_table,
    row,
    span,
    with_interval,
)

RECALL = "eval/results/recall.txt"
KINDS = ("simple", "composite", "complex")
TABLE1, TABLE2, AUTHORS = (
    f"eval/results/paper/{n}/table.md" for n in ("table1", "table2", "table1_authors")
)


def kinds(table: str, of: str, metric: str, wanted: Sequence[str] = KINDS) -> list[Figure]:
    return [in_table(table, of, kind, metric) for kind in wanted]


def published(table: str, of: str, metric: str) -> list[Figure]:
    return [in_table(table, of, kind, metric, ".3f", "published") for kind in KINDS]


def margin(path: str, name: str, against: str = "memory off") -> list[Figure]:
    """Return a margin of composite and complex tasks; against "" is any."""
    rows = [(name.format(kind), against) for kind in KINDS[1:]]
    return [cell(path, "the paper's margins", tuple(filter(None, one)), "ours") for one in rows]


def saved(path: str, column: str, of: str = "KARMA") -> list[Figure]:
    return [cell(path, f": {kind} tasks", (of,), column) for kind in KINDS[1:]]


# ----------------------------------------------------------------- README.md


def front_page() -> Iterator[Claim]:
    def demo(name: str) -> list[Figure]:
        means = [
            in_json("demo", name, "explorations", ".1f"),
            in_json("demo", name, "actions", ".0f"),
        ]
        return [counted("demo", name), asked("demo", name), *means]

    on, off = demo("KARMA"), demo("without memory")
    yield (
        "KARMA {} of {} tasks, {} places searched, {} steps; without memory {} of {}, {}, {}.",
        [*on, *off],
    )
    yield "five days | {} / {} / {} | Memory off: {} / {} / {}.", [
        *kinds("table1", "KARMA", "success"), *kinds("table1", "memory off", "success"),
    ]  # fmt: skip
    yield "The best baseline of each kind: {} / {} / {},", [best_baseline(kind) for kind in KINDS]
    yield (
        "On the authors' 25 tasks: {} / {} / {}, memory off {} / {} / {}.",
        [
            *kinds("table1_authors", "KARMA", "success"),
            *kinds("table1_authors", "memory off", "success"),
        ],
    )
    yield "(RE), composite / complex | {} / {} | The paper: {} / {}.", [
        *kinds("table1", "KARMA", "re", KINDS[1:]), *published("table1", "KARMA", "re")[1:],
    ]  # fmt: skip
    yield "Actions saved (RT): {} / {}", kinds("table1", "KARMA", "rt", KINDS[1:])
    yield "wall-clock time saved (shared machine): {} / {}.", saved(TABLE1, "RT (clock)")


def read(name: str, line: str) -> list[Figure]:
    """Return share and number of ALFRED's goal sentences in a line of what `evaluate` printed."""
    found = re.search(
        rf"^{line} +(\d+)  exact ([\d.]+)", text_of(RESULTS / f"{name}.txt"), re.MULTILINE
    )
    assert found, (name, line)
    return [Figure(text=found[n], record=f"{name}.txt") for n in (2, 1)]


def best_baseline(kind: str) -> Figure:
    names = ("HELPER", "HELPER (furniture in the prompt)", "CAPEAM-style")
    rows = (*names, "LoTa-Bench (modified)", "LoTa-Bench (scored)")
    return max((in_table("table1", r, kind, "success") for r in rows), key=lambda f: float(f.text))


# ----------------------------------------------------------------- results.md, paper's tables


def papers_tables() -> Iterator[Claim]:
    baselines = ("HELPER", "CAPEAM-style", "LoTa-Bench (modified)", "LoTa-Bench (scored)")
    for name in ("KARMA", *baselines, "memory off", "expert"):
        cells = [kinds("table1_authors", name, metric) for metric in ("success", "re", "rt")]
        yield row(name, *cells)
    without = [f"KARMA (w/o {which} term memory)" for which in ("short", "long")]
    furnished = "HELPER (furniture in the prompt)"
    for name in ("KARMA", *without, "HELPER", furnished, *baselines[1:], "memory off", "expert"):
        table = "table2" if name in without else "table1"
        metrics = ("success", "re", "rt")
        pairs = [(kinds(table, name, m), published(table, name, m)) for m in metrics]
        yield row(name, *(part for pair in pairs for part in pair))
    yield from clocks_and_tours()
    yield from margins()


def clocks_and_tours() -> Iterator[Claim]:
    tour = [
        in_table("table1", "KARMA", "all", f"tour_{what}", ".0f") for what in ("places", "actions")
    ]
    yield "walks to {} lookouts on average over the 48 tasks, with {} actions", tour
    (first, second), (third, fourth) = saved(TABLE1, "RT (clock)"), saved(TABLE2, "RT (clock)")
    yield "the runs of table 1; 2 | {}; {} | {}; {} |", [first, third, second, fourth]


def margins() -> Iterator[Claim]:
    best = "SR of KARMA, {} tasks, times that of the best baseline"
    off = "SR of KARMA, {} tasks, times that without memory"
    yield (
        "KARMA solves {} times as many composite tasks as the best baseline and {} times as many"
        " complex ones, and {} and {} times as many as memory off",
        margin(AUTHORS, best, "") + margin(AUTHORS, off),
    )
    refused = in_table("table1_authors", "KARMA", "all", "refused", ".2f")
    share = Figure(text=str(round(100 * float(refused.text))), record=refused.record)
    yield "Refused requests are among the failures ({} of 100 sub-tasks)", [share]
    to_do = [
        in_table("table1_authors", name, "all", "success_to_do") for name in ("KARMA", "memory off")
    ]
    yield "KARMA solves {} of the episodes, memory off {}, the expert all", to_do
    yield "| success, times the best baseline's | {} | {} |", margin(TABLE1, best, "")
    yield "| success, times memory off's | {} | {} |", margin(TABLE1, off)
    for short, spent in (("RE", "RE"), ("RT", "RT, actions")):
        figures = margin(TABLE1, short + " of KARMA, {} tasks")
        yield f"| {spent} | {{}} | {{}} |", figures
        related = margin(TABLE1, short + " related of KARMA, {} tasks")
        yield f"| {short} of sub-tasks that come back to a thing | {{}} | {{}} |", related
    toured = saved(TABLE1, "RE with tour")
    yield "spread over all that was asked in the room | {} | {} |", toured
    scored = in_table("table1", "LoTa-Bench (scored)", "composite", "success")
    memory_off = in_table("table1", "memory off", "composite", "success")
    yield "LoTa-Bench (scored) solves {}, memory off {}.", [scored, memory_off]
    causes = [
        cell(TABLE1, "the first failed sub-task", ("KARMA", "all"), column)
        for column in ("failed", "planner", "refused", "recall", "world")
    ]
    yield (
        "Of KARMA's {} failed episodes {} are the planner's, {} are requests that it refused"
        " though they could be done, {} recall's, {} the world's.",
        causes,
    )


# ----------------------------------------------------------------- docs/results.md, the agent


def agent() -> Iterator[Claim]:
    full, without = "KARMA", "KARMA (w/o short term memory)"
    less = (without, "KARMA (w/o long term memory)", "without memory", "expert")
    vague = [counted("alfred_l", name, kind="complex") for name in (full, without, less[2])]
    yield "complex {} of 18 → {} of 18, without any memory {}, on the development set", vague
    yield (
        "(all {}: {}, without short-term memory {}, without long-term memory {}, without any {},"
        " expert {})",
        [asked("alfred_l", full), *(counted("alfred_l", name) for name in (full, *less))],
    )

    def by_kind(name: str, of: str) -> list[Figure]:
        return [in_json(name, of, "success", kind=kind) for kind in KINDS]

    cosine = "alfred_l_cosine"
    yield (
        "{}/{}/{} on our 48 tasks; ours {}/{}/{}; with all ten units in the prompt {}/{}/{};",
        [
            *by_kind(cosine, "KARMA, K = 3"),
            *by_kind("alfred_l", full),
            *by_kind(cosine, "KARMA, K = 10 (all)"),
        ],
    )
    of, to_do = "alfred_l_authors", "success_to_do"
    rows = (full, "without memory", "expert")
    yield (
        "{} of {} solved, without memory {}, expert {}; of those with something to do {}, {} and {}"
        " of {}",
        [
            counted(of, full), asked(of, full), *(counted(of, name) for name in rows[1:]),
            *(counted(of, name, to_do) for name in rows), asked(of, full, to_do),
        ],
    )  # fmt: skip
    yield from goal_sentences()
    yield from household_tasks()
    policies = ("fifo", "lru", "wtinylfu-karma [1,9]", "wtinylfu-karma [9,1]", "wtinylfu-caffeine")
    done = [
        in_table("alfworld_r", name, "all", "subtasks_done")
        for name in (*policies, "memory off", "oracle")
    ]
    ends = [
        span([in_table("alfworld_r", name, "all", m) for name in policies]) for m in ("hits", "re")
    ]
    yield (
        "{} to {} of sub-tasks done (memory off {}, expert {}),"
        " hits {} to {}, RE {} to {}, whatever the policy",
        [*span(done[:-2]), *done[-2:], *ends[0], *ends[1]],
    )
    yield from recalled()
    yield from seen()


def goal_sentences() -> Iterator[Claim]:
    for name, behind, known_behind in (
        ("alfred_goals", "; **", "that stand word for word in the training split,"),
        ("alfred_goals_mapped", "; looked at", "that do;"),
    ):
        new, whole, known = (
            read(name, line)
            for line in ("not in the training split", "all", "in the training split too")
        )
        yield f"**{{}} of {{}}**{behind}", new
        yield f"{{}} of {{}} with the {{}} {known_behind}", [*whole, known[1]]


def household_tasks() -> Iterator[Claim]:
    of = "eb_alfred_agents"
    rest = [counted(of, name) for name in ("memory off", "does nothing", "expert")]
    yield "KARMA {} of {}, {} (two of a kind", [
        counted(of, "KARMA"), asked(of, "KARMA"), with_interval(of, "KARMA")
    ]  # fmt: skip
    new = "not in training"
    yield (
        "sentences that are not in the training data {} of {};"
        " memory off {}, does nothing {}, expert {};",
        [counted(of, "KARMA", kind=new), asked(of, "KARMA", kind=new), *rest],
    )


LISTS = (
    "base",
    "common_sense",
    "complex_instruction",
    "visual_appearance",
    "spatial",
    "long_horizon",
)


def benchmarks_page() -> Iterator[Claim]:
    of = "eb_alfred_agents"
    rows = [
        row(
            shown,
            [with_interval(of, name)],
            *([in_json(of, name, "success", kind=kind)] for kind in kinds),
        )
        for kinds in [(*LISTS, "in training", "not in training")]
        for shown, name in (("KARMA, nano planner", "KARMA"), ("memory off", "memory off"))
    ]
    below = "not (139) |\n" + "|---" * 10 + "|"
    yield below + rows[0][0] + rows[1][0].lstrip("\n"), [*rows[0][1], *rows[1][1]]


def card() -> Iterator[Claim]:
    of = "eb_alfred_agents"
    yield "eval/eb_alfred_agents.toml` | {} |", [with_interval(of, "KARMA")]
    listed = [in_json(of, "KARMA", "success", kind=kind) for kind in LISTS[1:3]]
    yield "common sense, complex, of 25 each | the same | {}, {} |", listed
    yield "the same with memory off, mean | the same | {} |", [with_interval(of, "memory off")]
    share, count = read("alfred_goals", "not in the training split")
    yield "not word for word in training, of {} |", [count]
    yield "valid_seen.jsonl.gz` | {} |", [share]
    share, count = read("alfred_goals_mapped", "not in the training split")
    yield "the same with the map, of {} | with `--mapped` | {} |", [count, share]


def recalled() -> Iterator[Claim]:
    def steps(heading: str, column: str, marks: str = "lived") -> list[Figure]:
        rows = [(units, when, marks) for units in ("10", "40") for when in ("before", "after")]
        return [bare(cell(RECALL, heading, one, column)) for one in rows]

    own, theirs = "ours", "alfred-l"
    yield (
        "composite {} → {}, {} → {}; complex {} → {}, {} → {};"
        " vague {} → {}, {} → {}: none as aimed",
        [f for column in ("composite", "complex", "vague") for f in steps(own, column)],
    )
    yield "name their thing got worse, {} → {}, {} → {}.", steps(theirs, "complex exact")


def seen() -> Iterator[Claim]:
    nano, blind, told = "given boxes, nano VLM", "given boxes, blind", "given boxes, true states"
    of = ("KARMA", "KARMA (true states)", "KARMA (no states)")
    yield "skills by metadata: {}, {} and {} of {}", [
        *(counted("alfred_l_vlm", name) for name in of), asked("alfred_l_vlm", of[0])
    ]  # fmt: skip
    yield "| metadata: true states, places and boxes | {} |", [counted("looking", "metadata")]
    for shown, name in ((told, told), (f"**{nano}**", nano), (f"{blind}: no states", blind)):
        yield (
            f"| {shown} | {{}} | {{}} |",
            [counted("looking", name), with_interval("looking", name)],
        )
    control = [counted("looking_control", name) for name in (blind, nano, "metadata")]
    yield "the blind row does {} of {}, the nano {}, metadata {}:", [
        control[0], asked("looking_control", blind), *control[1:]
    ]  # fmt: skip


# ----------------------------------------------------------------- docs/results.md, memory policies


def policies() -> Iterator[Claim]:
    def holds(name: str) -> list[Figure]:
        found = re.search(r"Holds in (\d+) of (\d+) cases", text_of(RESULTS / f"paper/{name}.md"))
        assert found, name
        return [Figure(text=text, record=f"paper/{name}.md") for text in found.groups()]

    def ratios(name: str) -> list[Figure]:
        cells = column_of(f"eval/results/paper/{name}.md", "25 units hits", "ratio").values()
        return span([Figure(text=text, record=f"paper/{name}.md") for text in cells])

    yield "| in {} of {} readings and workloads |", holds("fig4")
    yield "| {} at most; 4.6 in {} of {} |", [ratios("fig5")[1], *holds("fig5")]
    ends = [Figure(text=f"{float(f.text):.1f}", record=f.record) for f in ratios("fig6")]
    yield "| {} to {} by workload and reading; 3.9 in {} of {} |", [*ends, *holds("fig6")]
    yield "| r > 0.8 in {} of {};", holds("fig7")


SAID: dict[str, tuple[Callable[[], Iterator[Claim]], ...]] = {
    "README.md": (front_page,),
    "docs/results.md": (papers_tables, agent, policies, lived_table),
    "docs/plugins/alfred.md": (benchmarks_page,),
    "models/cards/karma-nano.md": (card,),
}
