"""How memory comes into the prompt: what we measure, and the paper's own setting in one word."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from karma.errors import did_you_mean


@dataclass(frozen=True, slots=True, kw_only=True)
class Preset:
    """One setting of the agent."""

    recall: str  # which units come into the prompt
    recall_text: str  # how a unit is put in words for recall
    options: Mapping[str, Any] = field(default_factory=dict)  # of the row, where not the default


PRESETS = {
    "": Preset(recall="stateful", recall_text="sentence"),  # what the tables measure
    "paper": Preset(  # §3.5; it gives no K, so all units
        recall="cosine",
        recall_text="listing",
        options={
            "recall_k": 10,
            "query": "instruction",
            "whole_memory": False,
            "map_form": "paper",
            "seen_listed": False,
        },
    ),
}


def preset(name: str) -> Preset:
    """Return a preset.

    Raises:
        ValueError: there is none of that name.
    """
    if name not in PRESETS:
        there = [*filter(None, PRESETS)]
        hint = did_you_mean(name, there)
        raise ValueError(f"preset = {name!r}; there is {', '.join(there)!r}.{hint}")
    return PRESETS[name]
