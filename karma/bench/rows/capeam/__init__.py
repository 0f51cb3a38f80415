"""CAPEAM-style (after Kim et al. 2023)."""
