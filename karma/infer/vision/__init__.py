"""Read pictures: object states, and what stands where."""
