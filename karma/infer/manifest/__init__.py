"""List the models there are, verify their files, add and remove some."""
