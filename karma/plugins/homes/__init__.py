"""Persistent homes: residents, long-lived memory, the lived-in-homes benchmark."""
