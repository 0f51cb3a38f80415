"""For tests of what is built on this package, without weights: models that cost nothing.

Tiny models of random weights, in the architectures and formats of real ones, load, chat, plan and
look as those do; stand-ins answer what they were told to. Fixtures: `karma.train.testing.plugin`.
"""

from karma.infer.scripted import ScriptedModel
from karma.train.testing.doubles import StubEmbedder, StubVision
from karma.train.testing.families import FAMILIES, PICTURE_FAMILIES, Size
from karma.train.testing.models import MadePair, make_llama, make_picture_model, make_planner

__all__ = [
    "FAMILIES",
    "PICTURE_FAMILIES",
    "MadePair",
    "ScriptedModel",
    "Size",
    "StubEmbedder",
    "StubVision",
    "make_llama",
    "make_picture_model",
    "make_planner",
]
