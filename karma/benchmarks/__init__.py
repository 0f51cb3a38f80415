"""Other people's benchmarks by their own protocols, in our world."""
