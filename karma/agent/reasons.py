"""Why the world refused an action: AI2-THOR's `errorMessage`, read here and nowhere else."""

import re

from karma.contracts import Reason, ReasonKind

_UNKNOWN = "the world refused"  # where it says nothing
_ROOM_MATTERS = re.compile(
    r"block|collid|collision|in the way|no valid position|not found within|visib|interact|reach",
    re.IGNORECASE,
)
_UNREACHED = ("not found within", "not interactable", "visib", "block", "collid", "in the way")
_KINDS: tuple[tuple[ReasonKind, tuple[str, ...]], ...] = (
    ("held", ("if it is in the agent's hand",)),
    ("open", ("must be closed",)),
    ("on", ("must be off",)),
    ("closed", ("is closed",)),
    ("pickupable", ("property pickupable",)),
    ("sliceable", ("property sliceable",)),
    ("breakable", ("property breakable",)),
    ("canFillWithLiquid", ("property canfill",)),
    ("openable", ("not an openable",)),
    ("toggleable", ("not a toggleable",)),
    ("empty", ("already empty",)),
    ("broken", ("is broken", "already broken")),
    ("misplaced", ("cannot be placed", "not a receptacle")),
    ("full", ("no valid position",)),
    ("unreached", _UNREACHED),
)  # the first whose signs stand in the words


def reason_of(words: str) -> Reason:
    """Return what a refusal means.

    Args:
        words: the world's.
    """
    text = words.split(". trace:")[0].strip()
    text = re.sub(r"^\w+Exception: ", "", text)
    text = re.sub(r"\b([A-Z][A-Za-z]+)_[0-9a-f]{8}\b", r"\1", text) or _UNKNOWN
    said = text.lower()
    kinds = (kind for kind, signs in _KINDS if any(sign in said for sign in signs))
    elsewhere = bool(_ROOM_MATTERS.search(text))
    return Reason(words=text, kind=next(kinds, "other"), elsewhere=elsewhere)
