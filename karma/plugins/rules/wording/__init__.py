"""Phrases of a sentence, and the object types and actions that they come near to."""
