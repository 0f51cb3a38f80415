"""A run as one page that needs nothing else: tables, plots, and episodes to step through."""
