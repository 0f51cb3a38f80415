"""Memories of a home where people live; one file a design, all behind `HomeMemory`."""
