"""Models behind an OpenAI-compatible endpoint, with cassettes and a bill."""
