"""What is asked: goals, task files, instructions taken apart, and the expert who knows the way."""
