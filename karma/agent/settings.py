"""Options of the method `karma`."""

from dataclasses import dataclass
from typing import Annotated, Literal

from msgspec import Meta

from karma import registry
from karma.agent.seeing.eyes import METADATA
from karma.memory.policies import make_policy


@dataclass(frozen=True, slots=True, kw_only=True)
class KarmaSettings:
    """Options of the method `karma`; without either memory it is an ablation (Table 2)."""

    long_term: bool = True
    short_term: bool = True
    policy: str = "wtinylfu-karma[9,1]"  # of short-term memory (§4.4: the best at 10 units)
    recall_k: Annotated[int, Meta(ge=1)] = 3  # units in the prompt, to the whole memory
    paper_prompt: bool = False  # §3.3's map; recalled units only, by the user's whole text
    seen_kept: Annotated[int, Meta(ge=0)] = 2  # objects only seen, remembered per instruction
    means: Literal["used", "recalled"] = "used"  # of several `Plate`s: used last, recalled best
    perception: str = METADATA  # how the agent sees: or "pictures"

    def __post_init__(self) -> None:
        """Refuse an unknown policy or perception before a model loads."""
        registry.load("perceptions", self.perception.partition(":")[0])
        make_policy(self.policy)
