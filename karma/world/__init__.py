"""Where the robot lives: a headless household that speaks AI2-THOR 5.0.0."""
