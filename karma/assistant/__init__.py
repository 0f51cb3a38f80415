"""Assistants: what turns a person's text into instructions, and a report into words."""
