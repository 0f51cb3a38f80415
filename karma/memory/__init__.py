"""What the robot knows; no model and no world inside."""
