"""AI2-THOR's metadata dumps made into scenes."""
