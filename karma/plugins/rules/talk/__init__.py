"""An agent that one talks to: what it understood, what it did, what is so afterwards."""
