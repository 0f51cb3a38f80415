"""The skills: what a name means, hand, doors and switches, walking, the search for a thing."""
