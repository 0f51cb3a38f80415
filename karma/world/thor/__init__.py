"""Drive the real AI2-THOR 5.0.0: its own client, a user's Unity build, and what goes wrong."""
