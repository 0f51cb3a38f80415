"""One archive that carries everything over the air gap: built, verified, installed."""
