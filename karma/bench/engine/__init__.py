"""One engine: a benchmark's tasks, played by workers, kept in a folder, resumed."""
