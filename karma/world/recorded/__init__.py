"""Replay recorded sessions of the real simulator and compare."""
