"""ALFRED as EB-ALFRED (EmbodiedBench) and LoTa-Bench play it: one loop, two planners."""
