"""Run planner models by llama.cpp: open, prompt, constrain and score."""
