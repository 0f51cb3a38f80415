"""Looks at model files and at free memory before a byte of the weights is parsed."""
