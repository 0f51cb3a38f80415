"""The score of every continuation, not only of the best: what the search is held against."""

from dataclasses import dataclass

import numpy as np

from karma.models.llama.scoring import path_to


@dataclass(frozen=True, slots=True, kw_only=True)
class Scores:
    """All continuations scored, in the order given, and what that took in tokens."""

    values: np.ndarray
    prompt_tokens: int
    reused_tokens: int  # of the prompt, kept from an earlier call
    run_tokens: int  # of continuations


def every_score(scorer, prompt, continuations, *, scoring="sum"):
    """Score every continuation with a `SkillScorer`; arguments and errors as in its `choose`."""
    paths, reused = scorer.begin(prompt, continuations)
    for number in _lowest_run(paths.trie):
        paths.run(path_to(paths.trie, number))
    values = np.empty(len(continuations), np.float64)
    for number, node in enumerate(paths.trie):
        divisor = max(node.depth, 1) if scoring == "average" else 1
        values[node.ends] = paths.found[number] / divisor
    return Scores(
        values=values, prompt_tokens=paths.start, reused_tokens=reused, run_tokens=paths.count
    )


def _lowest_run(trie):
    """Return the nodes to run that none to run is below; neighbours share most of their paths."""
    inner = [number for number, node in enumerate(trie) if number and node.children]
    lowest = [n for n in inner if not any(trie[c].children for c in trie[n].children.values())]
    return sorted(lowest, key=lambda number: path_to(trie, number))
