"""MiniLM, computed without sentence-transformers, gives the vectors of sentence-transformers."""

import json

import numpy as np
from support.paths import ROOT

from karma.models.embed.minilm import MiniLm
from karma.plugins.vision.sentence import SentenceEmbedder
from tests.models.test_embed import ODD, TEXTS


def test_embed_gives_the_vectors_of_sentence_transformers():
    lines = (ROOT / "eval/requests/written.jsonl").read_text(encoding="utf-8").splitlines()
    texts = [*TEXTS, *ODD, *(json.loads(line)["text"] for line in lines[::4])]
    assert len(texts) > 200
    assert np.abs(MiniLm().embed(texts) - SentenceEmbedder("minilm").embed(texts)).max() < 1e-6
