"""Which model files there are, and the check of each before a byte of it is parsed."""
