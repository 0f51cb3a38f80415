"""ALFRED: replay and import of trials, EB-ALFRED and LoTa-Bench suites, authors' tasks."""
