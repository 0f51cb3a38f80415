"""Turn texts and pictures into vectors."""
