"""What was said in a conversation and what was answered, in its run's folder."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import msgspec

from karma.errors import FileError
from karma.files import read_bytes, to_json

TURNS = "turns.json"
SAID = "said"  # the task of a conversation, and its kind


@dataclass(frozen=True, slots=True, kw_only=True)
class Turn:
    """One request or question, and what was said to it."""

    said: str
    status: str  # what became of it: "done", "answered", "refused" ...
    lines: tuple[tuple[str, str], ...]  # of the answer: what kind of line, and its words
    instruction: int | None = None  # which of the episode it is; None: nothing was tried for it


def turns_file(turns: Iterable[Turn]) -> dict[str, bytes]:
    """Return the file that holds a conversation, by its path in the run's folder."""
    return {TURNS: to_json(list(turns), indent=2)}


def read_turns(folder: Path) -> tuple[Turn, ...]:
    """Return the conversation of a run; () where it is none.

    Raises:
        FileError: the file is damaged.
    """
    path = folder / TURNS
    if not path.exists():
        return ()
    try:
        return msgspec.json.decode(read_bytes(path), type=tuple[Turn, ...])
    except msgspec.MsgspecError as error:
        raise FileError(path, f"is damaged: {error}", fix="talk again") from error
