"""Scores of continuations by their definition: a run for each text, token by token."""

import numpy as np

from karma.types.completion import END


def scores(model, prompt, texts, scoring="sum"):
    """Return the scores of all texts behind a prompt under a `GgufModel`."""
    found = []
    for text in texts:
        model.evaluate([model.tokens(part, begins=not n) for n, part in enumerate(prompt)])
        tokens = [model.end_token] if text == END else model.tokens(text)
        score = 0.0
        for token in tokens:
            logits = model.logits().astype(np.float64)
            score += logits[token] - np.logaddexp.reduce(logits)
            model.extend([token])
        found.append(score / (len(tokens) if scoring == "average" else 1))
    return np.array(found)
