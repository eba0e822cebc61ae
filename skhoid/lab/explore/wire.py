"""The envelope in which values with arrays travel to the component: JSON, and the arrays behind it.

4 bytes (little-endian): length of the header; the header as JSON, with the value and where its
arrays are; zeros up to a multiple of 8; the arrays. ``static/wire.js`` reads it.
"""

from __future__ import annotations

import base64
import gzip
import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

ALIGNED = 8  # bytes
LEVELS = 65_533  # of a compact array, in which one more stands for NaN
MISSING = -32_768
LITTLE = "<"


def pack(value: Any, *, compact: bool = False) -> bytes:
    """A value of dicts, lists, numbers, texts and arrays as an envelope.

    Parameters
    ----------
    value : dict, list, ndarray, number, str or None
        Numbers that are not finite become None; arrays keep NaN.
    compact : bool, default=False
        Write float arrays as differences of 16-bit numbers, exact to 1/65533 of their range, which
        compress well.

    Returns
    -------
    envelope : bytes
    """
    arrays: list[dict[str, Any]] = []
    data = bytearray()

    def plain(item: Any) -> Any:
        if isinstance(item, np.ndarray):
            about, content = _array(item, compact)
            data.extend(b"\0" * (-len(data) % ALIGNED))
            arrays.append({**about, "offset": len(data), "n": item.size})
            data.extend(content)
            return {"$array": len(arrays) - 1}
        if isinstance(item, Mapping):
            return {str(key): plain(one) for key, one in item.items()}
        if isinstance(item, list | tuple):
            return [plain(one) for one in item]
        return _scalar(item)

    header = json.dumps({"value": plain(value), "arrays": arrays}, allow_nan=False).encode()
    begun = len(header).to_bytes(4, "little") + header
    return begun + b"\0" * (-len(begun) % ALIGNED) + bytes(data)


def pack_text(value: Any) -> str:
    """A compact envelope, compressed, as text that may stand in a page."""
    packed = gzip.compress(pack(value, compact=True), mtime=0)
    return base64.b64encode(packed).decode("ascii")


def unpack(envelope: bytes) -> Any:
    """The value of an envelope, its arrays as float64 (marks as uint8).

    Parameters
    ----------
    envelope : bytes
        What :func:`pack` returned.

    Returns
    -------
    value : Any
    """
    length = int.from_bytes(envelope[:4], "little")
    header = json.loads(envelope[4 : 4 + length])
    begin = 4 + length + (-(4 + length) % ALIGNED)
    data = memoryview(envelope)[begin:]

    def whole(item: Any) -> Any:
        if isinstance(item, dict):
            if "$array" in item:
                return _values(header["arrays"][item["$array"]], data)
            return {key: whole(one) for key, one in item.items()}
        return [whole(one) for one in item] if isinstance(item, list) else item

    return whole(header["value"])


def unpack_text(text: str) -> Any:
    """The value of :func:`pack_text`."""
    return unpack(gzip.decompress(base64.b64decode(text)))


def _scalar(item: Any) -> Any:
    if isinstance(item, np.generic):
        item = item.item()
    if isinstance(item, float) and not math.isfinite(item):
        return None
    if item is None or isinstance(item, str | int | float | bool):
        return item
    return str(item)


def _array(array: np.ndarray, compact: bool) -> tuple[dict[str, Any], bytes]:
    array = np.ravel(array)
    if array.dtype == bool or array.dtype == np.uint8:
        return {"dtype": "u1"}, array.astype(np.uint8).tobytes()
    values = array.astype(float)
    if not compact:
        return {"dtype": "f8"}, values.astype(f"{LITTLE}f8").tobytes()
    finite = np.isfinite(values)
    low = float(values[finite].min()) if finite.any() else 0.0
    scale = (float(values[finite].max()) - low) / LEVELS if finite.any() else 0.0
    zero = low - (MISSING + 1) * scale
    level = np.full(values.size, MISSING, dtype=np.int64)
    if scale > 0.0:
        level[finite] = np.rint((values[finite] - low) / scale).astype(np.int64) + MISSING + 1
    else:
        level[finite] = 0
        zero = low
    steps = np.diff(level, prepend=0).astype(np.uint16).astype(f"{LITTLE}u2")
    return {"dtype": "i2", "delta": True, "zero": zero, "scale": scale}, steps.tobytes()


def _values(about: dict[str, Any], data: memoryview) -> np.ndarray:
    kinds: dict[str, Any] = {"u1": np.uint8, "f8": f"{LITTLE}f8", "i2": f"{LITTLE}i2"}
    found = np.frombuffer(data, kinds[about["dtype"]], about["n"], about["offset"])
    if about["dtype"] != "i2":
        return found.copy()
    level = np.cumsum(found.astype(np.int64)).astype(np.uint16).astype(np.int16)
    values = about["zero"] + about["scale"] * level.astype(float)
    values[level == MISSING] = np.nan
    return values
