"""Say on which device, and in which numbers, torch models are computed."""

import re
from dataclasses import dataclass
from typing import Literal, get_args

from karma.errors import ModelError

DType = Literal["auto", "float32", "bfloat16", "float16"]
_DEVICES = re.compile(r"auto|cpu|mps|cuda(:\d+)?|xpu(:\d+)?")


@dataclass(frozen=True, slots=True, kw_only=True)
class TorchOptions:
    """How a model of transformers or sentence-transformers is opened.

    Raises:
        ModelError: a value is none that there is.
    """

    device: str = "auto"  # "cuda" where there is one, else "cpu"
    dtype: DType = "auto"  # float32; large models that are stored in 16 bits stay so

    def __post_init__(self) -> None:
        """Refuse what torch would speak of in its own words, after seconds."""
        if not _DEVICES.fullmatch(self.device):
            raise ModelError(f'device = {self.device!r}: "auto", "cpu", "cuda", "cuda:1" or "mps"')
        if self.dtype not in get_args(DType):
            raise ModelError(f"dtype = {self.dtype!r}: one of {', '.join(get_args(DType))}")
