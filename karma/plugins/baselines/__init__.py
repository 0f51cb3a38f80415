"""Published methods that KARMA is compared with: HELPER, CAPEAM and LoTa-Bench's planner."""
