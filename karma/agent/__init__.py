"""The agent's body and mind: what it sees, how it plans, what its skills do."""
