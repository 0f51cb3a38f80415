"""ALFRED's trials with the actions, limits and score of EB-ALFRED, and of LoTa-Bench, its ancestor.

Source: EmbodiedBench (arXiv 2502.09560), LoTa-Bench (2402.08178);
docs/plugins/alfred.md says what equals them.
"""
