"""Describe one moment of the household, and the rules by which it becomes the next."""
