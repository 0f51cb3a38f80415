"""Write docs/plugins/transcript.md: conversations with `karma chat`.

    python scripts/make_transcript.py [--planner NAME] [--said FILE] [--out FILE]

It runs the command itself, a conversation a room, in an empty folder, and keeps all that it
prints. Equal weights give equal bytes. A line of the list is a request that can be done there
("+") or not ("-"); "@" begins a room, with a home's name and how many people live there. "= 26h"
goes on in the same home so much later, with lines ("?") that ask, tell, or speak of what was.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import typer

ROOT = Path(__file__).parents[1]
HEAD = """# Requests as people say them

What `karma chat` printed, all of it, 80 columns wide, with the planner `{planner}`. Written by
`python scripts/make_transcript.py` from [the list](../../eval/talk/said.txt); nothing is left out
or put right. "Done" and "seen" are the agent's own words, not a judge's.

| the request | number | done, by its own account | not finished, or in part | refused | answered |
|---|---|---|---|---|---|
"""
KINDS = {
    "+": "can be done there", "-": "cannot be done, or should not",
    "?": "in a home of days: asks, tells, or speaks of what was",
}  # fmt: skip


@dataclass
class Talk:
    """A conversation in a room."""

    scene: str
    said: list[tuple[str, str]] = field(default_factory=list)  # kind and words
    home: str = ""  # where it goes on, or will
    people: str = ""  # how many live there
    later: str = ""  # "26h": so much time has passed there

    @property
    def options(self) -> list[str]:
        """Of the command."""
        given = {"--home": self.home, "--scene": self.scene, "--people": self.people,
                 "--later": self.later}  # fmt: skip
        words = [word for name, value in given.items() if value for word in (name, value)]
        return words if self.home else ["--fresh", *words]


def read(path: Path) -> list[Talk]:
    """Return the conversations of a list."""
    talks: list[Talk] = []
    for line in path.read_text(encoding="utf-8").splitlines():
        mark, _, words = line.partition(" ")
        if mark == "@":
            scene, home, people, *_ = [*words.split(), "", ""]
            talks.append(Talk(scene, home=home, people=people))
        elif mark == "=":
            talks.append(replace(talks[-1], said=[], later=words.strip()))
        elif mark in KINDS:
            talks[-1].said.append((mark, words.strip()))
    return talks


def printed(talk: Talk, options: Sequence[str], folder: Path) -> list[str]:
    """Return the command's output in an empty folder or in the home's."""
    done = subprocess.run(
        [str(Path(sys.executable).with_name("karma")), "chat", *talk.options, *options],
        cwd=folder,
        env={**os.environ, "COLUMNS": "80", "PYTHONHASHSEED": "0"},
        input="".join(f"{words}\n" for _, words in talk.said),
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode not in (0, 3, 4, 5):  # what came of the requests
        sys.exit(done.stdout + done.stderr)
    return done.stdout.splitlines()


def answers(lines: Sequence[str]) -> Iterator[str]:
    """Yield the outcome of each request as a word."""
    blocks: list[list[str]] = []
    for line in lines:
        if line.startswith("> "):
            blocks.append([])
        elif blocks:
            blocks[-1].append(line)
    for block in blocks:
        text = "\n".join(block)
        if any(mark in text for mark in ("  not finished:", "error:", "  partly:")):
            yield "not finished"
        elif "  not done:" in text:
            yield "refused"
        else:
            yield "done" if "  done:" in text else "answered"


def page(talks: Sequence[Talk], options: Sequence[str], planner: str) -> str:
    """Return the whole page."""
    outcomes = ("done", "not finished", "refused", "answered")
    counts = {kind: dict.fromkeys(outcomes, 0) for kind in KINDS}
    parts = []
    for talk, lines in all_printed(talks, options):
        for (kind, _), what in zip(talk.said, answers(lines), strict=True):
            counts[kind][what] += 1
        shown = "\n".join(line.rstrip() for line in lines)
        told = f"{talk.scene}, {talk.later} later" if talk.later else talk.scene
        command = " ".join(["karma chat", *talk.options])
        parts.append(f"## {told}\n\n```\n$ {command}\n{shown}\n```\n")
    rows = "".join(
        f"| {KINDS[kind]} | {sum(found.values())} | {' | '.join(map(str, found.values()))} |\n"
        for kind, found in counts.items() if sum(found.values())
    )  # fmt: skip
    return HEAD.format(planner=Path(planner).name) + rows + "\n" + "\n".join(parts)


def all_printed(talks: Sequence[Talk], options: Sequence[str]) -> Iterator[tuple[Talk, list[str]]]:
    """Yield each conversation with the command's output, each home in its own folder."""
    with tempfile.TemporaryDirectory() as root:
        for number, talk in enumerate(talks):
            if not talk.later:
                folder = Path(root) / str(number)
                folder.mkdir()
            yield talk, printed(talk, options, folder)


def main(
    planner: str = "karma-nano",
    profile: str = "",
    said: Path = ROOT / "eval" / "talk" / "said.txt",
    out: Path = ROOT / "docs" / "plugins" / "transcript.md",
) -> None:
    """Write the page."""
    options = ["--planner", planner, *(["--profile", profile] if profile else [])]
    out.write_text(page(read(said), options, planner), encoding="utf-8")
    print(f"written: {out}")


if __name__ == "__main__":
    typer.run(main)
