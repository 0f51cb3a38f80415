"""Local models, one adapter each; all heavy imports live here."""
