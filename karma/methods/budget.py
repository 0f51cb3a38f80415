"""What one instruction may cost: HELPER and CAPEAM give up by the same two counts."""

from dataclasses import dataclass

from karma.agent.skills import Skills
from karma.household.uses import TAPS


@dataclass(slots=True)
class Budget:
    """What a body has spent of the most that one instruction may take."""

    skills: Skills
    steps: int  # world actions at most
    most_failures: int
    failures: int = 0

    @property
    def is_spent(self) -> bool:
        """Whether nothing more may be tried."""
        return self.skills.actions >= self.steps or self.failures >= self.most_failures

    @property
    def left(self) -> int:
        """How many world actions the next skill may take, at least 1."""
        return max(self.steps - self.skills.actions, 1)


def is_known_tap(name: str, skills: Skills) -> bool:
    """Return whether a name is that of a tap which the skill finds over the basin last used."""
    return name in TAPS and bool(skills.experience.handled_ids)
