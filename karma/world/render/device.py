"""Create the Embree device that draws every picture.

Embree chooses its kernels by the processor, and AVX-512 rounds differently: 42 of the 197 pictures
in `tests/golden/pictures.json` changed. On x86-64 the device is therefore limited to AVX2. embreex
cannot pass Embree a configuration, so the handle inside its device object is replaced.
"""

import ctypes
import platform
from functools import cache

from embreex import rtcore
from embreex.rtcore import EmbreeDevice

CONFIG = b"max_isa=avx2"


@cache
def device() -> EmbreeDevice:
    """Return the device of this process.

    Raises:
        RuntimeError: this embreex keeps the handle elsewhere.
    """
    wrapper = EmbreeDevice()
    if platform.machine() not in {"x86_64", "AMD64"}:
        return wrapper
    header_bytes = object.__basicsize__
    if EmbreeDevice.__basicsize__ != header_bytes + ctypes.sizeof(ctypes.c_void_p):
        raise RuntimeError("EmbreeDevice is not laid out as in embreex 4.4: install that version")
    embree = ctypes.CDLL(rtcore.__file__)
    embree.rtcNewDevice.restype = ctypes.c_void_p
    embree.rtcNewDevice.argtypes = [ctypes.c_char_p]
    embree.rtcReleaseDevice.argtypes = [ctypes.c_void_p]
    handle = ctypes.c_void_p.from_address(id(wrapper) + header_bytes)
    embree.rtcReleaseDevice(handle)
    handle.value = embree.rtcNewDevice(CONFIG)
    return wrapper
