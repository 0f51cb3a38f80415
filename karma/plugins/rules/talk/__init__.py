"""The assistant `rules`: dialogue, questions about memory, and answers."""
