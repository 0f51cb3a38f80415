"""HELPER (Sarch et al. 2023), rebuilt."""
