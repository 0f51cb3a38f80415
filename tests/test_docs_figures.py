"""Every number of README.md and docs/results.md is a record's, or listed as one of no record."""

import re
import tomllib
from dataclasses import dataclass
from functools import cache

import pytest
from support.documents import text_of
from support.figure_claims import SAID
from support.figures import (
    NUMBER,
    RESULTS,
    Block,
    Figure,
    blanked,
    blocks_of,
    digest,
    line_at,
    pattern_of,
    same,
)
from support.paths import GOLDEN, ROOT

from karma.models.manifest import PLANNERS

EARLIER = "earlier planner"  # what stands beside a figure of weights that do not ship any more
WHOLE = ("README.md", "docs/results.md")  # pages on which every number is held
FROM_HEADER = "(12 digits of models.planner in the header.json of its run)"
LISTED = GOLDEN / "figures_without_record.toml"


@dataclass(frozen=True, slots=True, kw_only=True)
class Said:
    """A figure on a page: what stands there and where, and what the record says."""

    text: str
    start: int
    end: int
    held: Figure


@cache
def said_on(page: str) -> tuple[tuple[Said, ...], tuple[str, ...]]:
    """Return the figures of a page's sentences, and the sentences that are not on it."""
    text, found, missing = text_of(ROOT / page), [], []
    for sentences in SAID[page]:
        for sentence, figures in sentences():
            matches = list(pattern_of(sentence).finditer(text))
            if len(matches) != 1:
                held = [figure.text for figure in figures]
                missing.append(f"{page} has {len(matches)} times, not once: {sentence}\n    {held}")
                continue
            match = matches[0]
            found += [
                Said(text=match[n], start=match.start(n), end=match.end(n), held=figure)
                for n, figure in enumerate(figures, 1)
            ]
    return tuple(found), tuple(missing)


@cache
def records() -> dict[str, dict[str, str]]:
    return tomllib.loads(text_of(RESULTS / "records.toml"))["records"]


@cache
def shipped() -> frozenset[str]:
    """Return the first digits of the SHA-256 of the planners that ship."""
    models = tomllib.loads(text_of(ROOT / "models/manifest.toml"))["models"]
    ours = [model for model in models if model["name"] in PLANNERS]
    return frozenset(
        next(file["sha256"] for file in model["files"] if file["path"].endswith(".gguf"))[:12]
        for model in ours
    )


@pytest.mark.parametrize("page", SAID)
def test_every_figure_that_a_record_holds_is_the_records(page):
    found, missing = said_on(page)
    text = text_of(ROOT / page)
    wrong = [
        f"{page}:{line_at(text, one.start)} says {one.text}, {one.held.record} has {one.held.text}"
        for one in found
        if not same(one.text, one.held.text)
    ]
    assert not wrong + list(missing), "\n".join(["", *wrong, *missing])


@pytest.mark.parametrize("page", WHOLE)
def test_every_other_number_is_listed_as_one_that_no_record_holds(page):
    listed = {
        start: (kind, numbers)
        for kind, blocks in tomllib.loads(text_of(LISTED))[page].items()
        for start, numbers in blocks.items()
    }
    wrong, used = [], set()
    for line, block, start, numbers in unrecorded(page):
        kind, allowed = listed.get(start, ("", ""))
        used.add(start)
        if numbers != allowed:
            wrong.append(
                f"{page}:{line} is listed with {allowed or 'nothing'}, but says\n"
                f'"{start}" = "{numbers}"'
            )
        elif kind == "not kept" and not told_to_be_made_again(block):
            wrong.append(f'{page}:{line} does not say "not kept" beside a command: {start}')
    wrong += [f"{page} has no more: {start}" for start in listed.keys() - used]
    assert not wrong, "\n".join([f"{LISTED.name}:", *wrong])


def unrecorded(page):
    """Yield line, block, its beginning and its numbers where a block has some of no record."""
    text = text_of(ROOT / page)
    plain, open_text = blanked(text), text
    for one in said_on(page)[0]:
        gap = "#" * (one.end - one.start)
        plain = plain[: one.start] + gap + plain[one.end :]
        open_text = open_text[: one.start] + gap + open_text[one.end :]
    for block in blocks_of(text):
        end = block.start + len(block.text)
        free = list(NUMBER.finditer(plain, block.start, end))
        if free and not block.text.startswith("#"):
            start = beginning(open_text[block.start : end])
            numbers = " ".join(match[0] for match in free)
            yield line_at(text, free[0].start()), block, start, numbers


def beginning(text: str) -> str:
    """Return the first words of a block, by which it is listed; figures of records are `#`."""
    words = re.sub("#+", "#", " ".join(text.split())).replace("\\", "")
    return words[:60].rstrip().replace('"', "'")


def told_to_be_made_again(block: Block) -> bool:
    around = block.context + block.text
    return "not kept" in around.lower() and re.search(r"`[^`]+ [^`]+`", around) is not None


@pytest.mark.parametrize("page", WHOLE)
def test_figures_of_earlier_weights_say_so_and_no_others(page):
    text, (found, _) = text_of(ROOT / page), said_on(page)
    wrong = []
    for block in blocks_of(text):
        end = block.start + len(block.text)
        own = {one.held.record for one in found if block.start <= one.start < end}
        earlier = sorted(own & weights_before())
        if own and bool(earlier) != marked(block, own):
            which = (
                f"is of earlier weights: {earlier}" if earlier else f"is of today's: {sorted(own)}"
            )
            wrong.append(f"{page}:{line_at(text, block.start)} {which}: {beginning(block.text)}")
    assert not wrong, "\n".join(
        [f'"{EARLIER}" stands beside figures of weights that do not ship:', *wrong]
    )


def weights_before() -> set[str]:
    """Return the records of planners that do not ship any more."""
    now = {*shipped(), "none"}
    return {record for record, made in records().items() if made["planner"] not in now}


def marked(block: Block, own: set[str]) -> bool:
    """Return whether a block says that its figures are of earlier weights.

    One that tells them only besides, as what is not kept, does not.
    """
    text, around = (" ".join(part.split()) for part in (block.text, block.context))
    besides = "not kept" in text and not own & weights_before()
    return EARLIER in around or (EARLIER in text and not besides)


def test_rows_of_recall_are_the_records():
    pages = (ROOT / "docs/recall.md", RESULTS / "recall.txt")
    told, held = (re.findall(r"^\| \d+ \| [a-z].*$", text_of(page), re.MULTILINE) for page in pages)
    assert told
    assert not set(told) - set(held)


def test_every_record_is_listed_with_its_hash_and_the_planner_that_made_it():
    there = {
        str((path.parent if path.parent.parent.name == "paper" else path).relative_to(RESULTS))
        for path in RESULTS.rglob("*")
        if path.suffix in (".json", ".md", ".csv", ".txt") and path.name != "README.md"
    }
    wrong = [
        f'"{record}" = {{ sha256 = "{digest(record)}", planner = "{FROM_HEADER}" }}'
        for record in sorted(there)
        if records().get(record, {}).get("sha256") != digest(record)
    ]
    assert not wrong, "\n".join(["eval/results/records.toml has not, or of another file:", *wrong])
    assert records().keys() == there
