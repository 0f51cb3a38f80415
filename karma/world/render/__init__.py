"""Draw pictures of a moment on the CPU with Embree; needs no display."""
