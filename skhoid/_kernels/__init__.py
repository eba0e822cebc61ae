"""Compiled loops over plain arrays; they and numba are loaded on first use."""

from __future__ import annotations

import math
from importlib import import_module
from typing import Any

import numpy as np

MODULES = {
    "arx",
    "delay_bank",
    "fir",
    "greybox",
    "inside",
    "kalman",
    "limb",
    "loop",
    "rls",
    "trade_off",
    "whitened",
    "window",
}


def __getattr__(name: str) -> Any:
    if name in MODULES:
        return import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def gate(array: Any, dtype: type = np.float64) -> np.ndarray:
    """Make an array writable, C-contiguous and of one type, so that one signature is compiled."""
    if type(array) is np.ndarray and array.dtype == dtype:
        flags = array.flags
        if flags.c_contiguous and flags.writeable and flags.aligned:
            return array
    return np.require(array, dtype=dtype, requirements=("C", "W", "A"))


def aligned(shape: tuple[int, ...]) -> np.ndarray:
    """Make an array without values that begins at a whole cache line, as wide vectors like it."""
    size = math.prod(shape)
    room = np.empty(size + 7)
    first = -room.ctypes.data % 64 // 8
    return room[first : first + size].reshape(shape)
