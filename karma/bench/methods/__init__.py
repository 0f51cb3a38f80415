"""The rows beside the agent's own: baselines, the expert, controls."""
