"""A robot in a home where people live: its body, and how it uses a memory to answer and to act."""
