"""How the nano planner learns."""
