"""Planner models by llama.cpp: opened, prompted, constrained and scored."""
