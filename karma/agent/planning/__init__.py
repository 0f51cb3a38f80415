"""From a request to a program of skills that fits it, or a refusal with its reason."""
