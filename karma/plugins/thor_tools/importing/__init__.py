"""Make scenes from AI2-THOR's metadata dumps."""
