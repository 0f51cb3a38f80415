"""The documents of the project: their links, the paths they name, and the commands they show."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

from support.paths import ROOT

PAGES = tuple(
    sorted(
        page
        for pattern in ("*.md", "docs/**/*.md", "eval/**/*.md", "models/**/*.md")
        for page in ROOT.glob(pattern)
    )
)
_FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
_INDENTED = re.compile(r"(?<=\n\n)(?: {4}\S.*\n)+")
_SPAN = re.compile(r"`([^`]+)`")
_HEAD = re.compile(
    r"(?:\w+=\S+ )*(?:\./|\.venv/bin/)?"
    r"((?:karma|karma-player|make|pytest) \S.*|karma-player$|make$|pytest$"
    r"|python -m llama_cpp\S*.*|python scripts/.*|scripts/\w+\.sh.*)"
)


def text_of(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT))


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub makes them."""
    found: dict[str, int] = {}
    names = set()
    for heading in re.findall(r"^#{1,6} (.+)$", _FENCE.sub("", text_of(page)), re.MULTILINE):
        words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)
        slug = re.sub(r"[^\w\- ]", "", words.lower()).replace(" ", "-")
        count = found.get(slug, 0)
        found[slug] = count + 1
        names.add(f"{slug}-{count}" if count else slug)
    return names


def links(page: Path) -> Iterator[str]:
    """Yield the targets of a page's links and pictures, without those in code."""
    plain = _SPAN.sub("", _FENCE.sub("", text_of(page)))
    yield from re.findall(r"\]\(([^)\s]+)\)", plain)


def code(page: Path) -> Iterator[str]:
    """Yield the page's lines of code, and its words in backticks; wrapped lines are joined."""
    text = text_of(page)
    for language, block in _FENCE.findall(text):
        if language not in ("python", "toml", "json"):
            yield from block.replace("\\\n", " ").splitlines()
    text = _FENCE.sub("\n", text)
    for block in _INDENTED.findall(text):
        yield from (line.strip() for line in block.replace("\\\n", " ").splitlines())
    for span in _SPAN.findall(text):
        yield " ".join(span.split())


def commands(page: Path) -> Iterator[list[str]]:
    """Yield the commands of the project that a page shows, as lists of words."""
    for line in code(page):
        match = _HEAD.match(line)
        if match:
            yield shlex.split(match[1].rstrip("&"), comments=True)
