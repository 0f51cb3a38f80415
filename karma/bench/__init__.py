"""Tasks, goals, runs and figures; reaches implementations through the registry."""
