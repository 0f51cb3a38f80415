"""Examples for the nano planner: task grammar, phrases, teacher's programs."""
