"""Do AI2-THOR's actions on the embedded world, one file a family."""
