"""What one instruction may cost: HELPER and CAPEAM give up by the same two counts."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    """The most that one instruction may take."""

    steps: int  # world actions
    failures: int

    def is_spent(self, steps: int, failures: int) -> bool:
        """Return whether nothing more may be tried."""
        return steps >= self.steps or failures >= self.failures

    def left(self, steps: int) -> int:
        """Return how many world actions the next skill may take, at least 1."""
        return max(self.steps - steps, 1)
