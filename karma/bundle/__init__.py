"""Carry everything over the air gap in one archive: build, verify, install."""
