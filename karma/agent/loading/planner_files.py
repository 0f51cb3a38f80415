"""What was fitted to a planner: its words file, for hints, and its doubt, by which it refuses."""

from pathlib import Path
from typing import Literal

from karma import registry
from karma.agent.planning.refused_requests import LogisticDoubt, read_doubt
from karma.contracts import Embedder, Hints
from karma.infer.manifest.manifest import (
    check_file,
    file_paths,
    find_model,
    is_gguf_path,
    resolve_planner,
)
from karma.language.hints import Hinter, load_words

WORDS, DOUBT = "words.json", "doubt.json"  # beside a GGUF that has no entry, if it has them
NO_WORDS = "none"  # as a words file: no hints
_EMBEDDER = "minilm"  # whatever recall uses: planners have learnt its similarities


def may_refuse(planner: str, said: bool | None = None) -> bool:
    """Return whether a local planner may refuse: as said, else where it has learnt to."""
    if said is not None:
        return said
    return resolve_planner(planner).refuses or (
        is_gguf_path(planner) and doubt_path(planner) is not None
    )


def doubt_of(planner: str) -> LogisticDoubt | None:
    """Return what was fitted for a planner, by its name in the manifest or its path, if any."""
    path = doubt_path(planner)
    return read_doubt(path) if path is not None else None


def doubt_path(planner: str) -> Path | None:
    """Return where a planner's doubt lies, checked where the manifest vouches for it."""
    return _own(planner, "doubt", DOUBT)


def hints_for(planner: str, words: str = "", embedder: Embedder | None = None) -> Hints | None:
    """Return what gives a planner its hints; None where it has not learnt to read them.

    `words` is a words file in place of the planner's own, "none" for no hints.
    """
    path = chosen_words(planner, words)
    if path is None:
        return None
    embedder = learnt_embedder(embedder)
    return Hinter(load_words(path, embedder), embedder).hints


def learnt_embedder(loaded: Embedder | None) -> Embedder:
    """Return the embedder that hints and examples go by: the one that is loaded, if it is that."""
    if loaded is not None and loaded.name == _EMBEDDER:
        return loaded
    found: Embedder = registry.load("embedders", _EMBEDDER)()
    return found


def chosen_words(planner: str, words: str = "") -> Path | None:
    """Return the words file that is used: the one that is named, else the planner's own."""
    if words:
        return None if words == NO_WORDS else Path(words)
    return _own(planner, "words", WORDS)


def _own(planner: str, key: Literal["words", "doubt"], beside: str) -> Path | None:
    """Return a planner's own file of a kind, checked with what belongs to it, such as vectors."""
    if is_gguf_path(planner):
        path = Path(planner).with_name(beside)
        return path if path.exists() else None
    entry = find_model(planner)
    named: str = getattr(entry, key)
    if not named:
        return None
    places = dict(zip([file.path for file in entry.files], file_paths(entry), strict=True))
    for file in entry.files:
        if file.path.startswith(f"{named.rpartition('.')[0]}."):
            check_file(places[file.path], file.sha256, size=file.bytes, restore=entry.fix)
    return places[named]
