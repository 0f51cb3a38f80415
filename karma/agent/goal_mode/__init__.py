"""Goal mode: a small model says what is to be true, and the agent brings it about."""
