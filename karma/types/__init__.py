"""Types of the core by topic: frozen dataclasses with units in field names, and roles."""
