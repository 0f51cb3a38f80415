"""The only place where memory, models and world meet; one file per row of Table 1."""
