"""Ask models behind an OpenAI-compatible endpoint, record the answers, count the cost."""
