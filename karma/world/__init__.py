"""Simulate the household where the robot lives, in AI2-THOR 5.0.0's vocabulary."""
