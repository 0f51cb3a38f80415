"""EB-ALFRED of EmbodiedBench: its tasks, its planner's prompt, its players, its table."""
