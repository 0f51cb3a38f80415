"""The hints that a planner is told: by its words file, where it has learnt to read them."""

from pathlib import Path

from karma import registry
from karma.contracts import Embedder, Hints
from karma.infer.manifest.manifest import check_file, file_paths, find_model, is_gguf_path
from karma.language.hints import Hinter, load_words

NO_WORDS = "none"  # as a words file: no hints
WORDS = "words.json"  # a GGUF without an entry has its words file beside it, if any
_EMBEDDER = "minilm"  # planners have learnt its similarities, whatever recall uses


def hints_for(planner: str, words: str = "", embedder: Embedder | None = None) -> Hints | None:
    """Return what gives a planner its hints; None where it has not learnt to read them.

    Args:
        planner: a name of the manifest or a GGUF's path.
        words: a words file in place of the planner's own; "none" for no hints.
        embedder: that is loaded already; another one is not used.

    Raises:
        ModelError: the words file of the manifest is not as it should be.
        FileError: it is missing or torn.
    """
    path = chosen_words(planner, words)
    if path is None:
        return None
    if embedder is None or embedder.name != _EMBEDDER:
        embedder = registry.load("embedders", _EMBEDDER)()
    return Hinter(load_words(path, embedder), embedder).hints


def chosen_words(planner: str, words: str = "") -> Path | None:
    """Return the words file that is used: the one that is named, else the planner's own."""
    if words:
        return None if words == NO_WORDS else Path(words)
    return words_of(planner)


def words_of(planner: str) -> Path | None:
    """Return a planner's own words file, checked where the manifest vouches for it."""
    if is_gguf_path(planner):
        beside = Path(planner).with_name(WORDS)
        return beside if beside.exists() else None
    entry = find_model(planner)
    if not entry.words:
        return None
    places = dict(zip([file.path for file in entry.files], file_paths(entry), strict=True))
    stem = entry.words.rpartition(".")[0]
    for file in entry.files:
        if file.path.startswith(f"{stem}."):  # the words, and the vectors beside them
            check_file(places[file.path], file.sha256, size=file.bytes, restore=entry.fix)
    return places[entry.words]
