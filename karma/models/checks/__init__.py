"""Check model files and free memory before a byte of the weights is parsed."""
