"""LoTa-Bench's ALFRED: its tasks and draws, its two planners, its prompt, its table."""
