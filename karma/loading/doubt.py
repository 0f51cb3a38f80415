"""Whether a planner may refuse requests, and the doubt that was fitted for it."""

from pathlib import Path

from karma.agent.doubt import LogisticDoubt, read_doubt
from karma.infer.manifest.manifest import (
    check_file,
    file_paths,
    find_model,
    is_gguf_path,
    resolve_planner,
)

DOUBT = "doubt.json"  # a GGUF without an entry has its doubt beside it, if any


def may_refuse(planner: str, said: bool | None = None) -> bool:
    """Return whether a local planner may refuse: as said, else where it has learnt to.

    Raises:
        ModelError: there is no such planner.
    """
    if said is not None:
        return said
    return resolve_planner(planner).refuses or (
        is_gguf_path(planner) and doubt_path(planner) is not None
    )


def doubt_of(planner: str) -> LogisticDoubt | None:
    """Return what was fitted for a planner, by its name in the manifest or its path; None: nothing.

    Raises:
        ModelError: the manifest's file is not as it should be.
        FileError: it is missing or torn.
    """
    path = doubt_path(planner)
    return read_doubt(path) if path is not None else None


def doubt_path(planner: str) -> Path | None:
    """Return where a planner's doubt lies, checked where the manifest vouches for it."""
    if is_gguf_path(planner):
        beside = Path(planner).with_name(DOUBT)
        return beside if beside.exists() else None
    entry = find_model(planner)
    for file, place in zip(entry.files, file_paths(entry), strict=True):
        if entry.doubt and file.path == entry.doubt:
            check_file(place, file.sha256, size=file.bytes, restore=entry.fix)
            return place
    return None
