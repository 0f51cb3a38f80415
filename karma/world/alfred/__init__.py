"""ALFRED's demonstrations: read, built into scenes, replayed through the public `step`, judged."""
