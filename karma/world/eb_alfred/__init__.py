"""EB-ALFRED's rooms: ALFRED's trials with the benchmark's list of actions, its limits, its score.

Source: EmbodiedBench (arXiv 2502.09560); docs/alfred-benchmarks.md says what equals it.
"""
