"""Optional features: each package here can be deleted without touching the core."""
