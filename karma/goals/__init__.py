"""What is to be so when a task is done, and whether it is."""
