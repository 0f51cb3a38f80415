"""What models, prompts and worlds an agent runs with: named, checked, loaded once each."""
