"""The nano VLM: moments of rooms in many states, training, and scoring of any vision model."""
