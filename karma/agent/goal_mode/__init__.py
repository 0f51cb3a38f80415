"""Goal mode: a small model states goals, and the agent achieves them."""
