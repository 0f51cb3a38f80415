"""Recorded sessions of the real simulator, replayed and compared."""
