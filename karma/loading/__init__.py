"""What an agent runs with: models, prompts, examples, worlds; named, checked, loaded."""
