"""What makes a run's worlds."""

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

from karma import registry
from karma.contracts import World

PICTURES = {"renderDepthImage": True, "renderInstanceSegmentation": True}  # AI2-THOR's flags


def world_maker(name: str, options: Iterable[Mapping[str, Any]]) -> Callable[[], World]:
    """Return what makes a run's worlds: with depth and instance masks where a row looks at them."""
    make: Callable[..., World] = registry.load("worlds", name)
    looks = any(one.get("perception") == "pictures" for one in options)
    return partial(make, **PICTURES) if looks else make
