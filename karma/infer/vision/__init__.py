"""Models that read pictures: object states, and what stands where."""
