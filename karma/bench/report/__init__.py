"""Report pages without scripts: tables, plots and replayed episodes."""
