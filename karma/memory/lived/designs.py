"""All designs of a home's memory, by the names that experiments use."""

from collections.abc import Callable, Mapping

from karma.contracts import HomeMemory
from karma.memory.lived.append_only import AppendOnly
from karma.memory.lived.controls import LastSeen, NoMemory
from karma.memory.lived.karma_units import KarmaUnitsFifo, KarmaUnitsLru, KarmaUnitsWTinyLfu
from karma.memory.lived.mem0 import Mem0Style
from karma.memory.lived.memgpt import MemGptStyle
from karma.memory.lived.remembr import ReMEmbRStyle
from karma.memory.lived.setting import MemorySetting
from karma.memory.lived.temporal_graph import TemporalGraph
from karma.memory.lived.true_memory import TrueMemory
from karma.memory.lived.true_units import TrueUnits

DESIGNS: Mapping[str, Callable[[MemorySetting], HomeMemory]] = {
    "ours": TrueMemory,
    "ours-units": TrueUnits,
    "append-only": AppendOnly,
    "mem0": Mem0Style,
    "temporal-graph": TemporalGraph,
    "remembr": ReMEmbRStyle,
    "memgpt": MemGptStyle,
    "karma-fifo": KarmaUnitsFifo,
    "karma-lru": KarmaUnitsLru,
    "karma-wtinylfu": KarmaUnitsWTinyLfu,
    "last-seen": LastSeen,
    "none": NoMemory,
}
