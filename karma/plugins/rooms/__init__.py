"""Draw rooms from a table of furniture: equal seeds give equal scenes."""
