"""Parser of English requests: verbs, objects, references, times."""
