"""Tool mode: the language model calls tools and reads their results."""
