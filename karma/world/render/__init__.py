"""Pictures of a moment, drawn on the CPU with Embree; needs no display."""
