"""Training data and fine-tuning of planners."""
