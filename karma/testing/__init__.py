"""Make tiny models of random weights in the architectures and formats of real ones.

They load, chat, plan and look as the real ones do, and know nothing: for tests without a download.
"""

from karma.testing.architectures import Size
from karma.testing.families import FAMILIES, PICTURE_FAMILIES
from karma.testing.pictures import MadePair, make_picture_model
from karma.testing.planners import make_llama, make_planner

__all__ = [
    "FAMILIES",
    "PICTURE_FAMILIES",
    "MadePair",
    "Size",
    "make_llama",
    "make_picture_model",
    "make_planner",
]
