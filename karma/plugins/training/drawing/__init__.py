"""Tasks drawn from a grammar of our own, or read off ALFRED's sentences."""
