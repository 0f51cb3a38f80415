"""How the nano VLM learns, and how any vision model is scored."""
