"""Tool mode: the language model acts by tool calls and sees what each call brought about."""
