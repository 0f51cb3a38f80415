"""Benchmarks: EB-ALFRED, LoTa-Bench's ALFRED, lived-in homes, replacement policies."""
