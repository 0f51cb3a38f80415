"""A run as one page without scripts: tables, plots, and replayed episodes."""
