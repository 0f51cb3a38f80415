"""The bundle: everything in one archive for a machine without a network."""
