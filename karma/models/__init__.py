"""Run models, local and hosted, one adapter each; all heavy imports live here."""
