"""LoTa-Bench, modified (KARMA Table 1)."""
