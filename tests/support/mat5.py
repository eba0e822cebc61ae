"""MAT 5 files, byte by byte, right and wrong."""

from __future__ import annotations

import struct
import zlib
from typing import Any

from hypothesis import strategies as st

HEADER = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
BIG_ENDIAN = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x01\x00MI"
CELL, STRUCT, CHAR, SPARSE, DOUBLE, UINT32, FUNCTION, OPAQUE = 1, 2, 4, 5, 6, 13, 16, 17
COMPLEX_DOUBLE = 0x800 | DOUBLE
INT8, INT32, NUMBERS, ARRAY, PACKED = 1, 5, 9, 14, 15
WORDS = [*range(22), 64, 255, 256, 2**16 - 1, 2**16, 2**20, 2**28, 2**31 - 1, 2**31, 2**32 - 1]


def element(kind: int, data: bytes, order: str = "<") -> bytes:
    return struct.pack(f"{order}II", kind, len(data)) + data + bytes(-len(data) % 8)


def integers(*values: int, order: str = "<") -> bytes:
    return element(INT32, struct.pack(f"{order}{len(values)}i", *values), order)


def doubles(*values: float, order: str = "<") -> bytes:
    return element(NUMBERS, struct.pack(f"{order}{len(values)}d", *values), order)


def array(
    kind: int, shape: tuple[int, ...], parts: bytes, name: bytes = b"x", order: str = "<"
) -> bytes:
    """An array of a class (with flags) of the parts that follow its name."""
    flags = element(6, struct.pack(f"{order}II", kind, 0), order)
    named = element(INT8, name, order)
    return element(ARRAY, flags + integers(*shape, order=order) + named + parts, order)


def unpadded(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", kind, len(data)) + data


def packed(content: bytes) -> bytes:
    """An element, compressed."""
    return unpadded(PACKED, zlib.compress(content))


def opaque(name: bytes, class_name: bytes) -> bytes:
    """A classdef object as MATLAB writes it: flags, name, kind, class and a handle."""
    handle = element(6, struct.pack("<6I", 0xDD000000, 2, 1, 1, 1, 1))
    body = element(6, struct.pack("<II", OPAQUE, 0))
    for text in (name, b"MCOS", class_name):
        body += element(INT8, text)
    return element(ARRAY, body + array(UINT32, (6, 1), handle, b""))


@st.composite
def wrong_words(draw: Any, content: bytes) -> bytes:
    """A little-endian file in which tags, sizes, shapes or classes are wrong, also packed ones."""
    starts, at = [], len(HEADER)
    while at < len(content):
        starts.append(at)
        at += 8 + struct.unpack_from("<I", content, at + 4)[0]
    start = draw(st.sampled_from(starts))
    kind, size = struct.unpack_from("<II", content, start)
    stop = start + 8 + size
    body = content[start:stop]
    body = bytearray(zlib.decompress(body[8:]) if kind == PACKED else body)
    # Numbers that are as small as sizes are more interesting than data.
    words = struct.unpack(f"<{len(body) // 4}I", body)
    small = [4 * k for k, word in enumerate(words) if word < 2**12]
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.sampled_from(small))
        old = struct.unpack_from("<I", body, at)[0]
        near = st.sampled_from([1, -1, 4, -4, 8, -8]).map(
            lambda step, old=old: (old + step) % 2**32
        )
        new = draw(st.sampled_from(WORDS) | near | st.integers(0, 2**32 - 1))
        struct.pack_into("<I", body, at, new)
    return (
        content[:start] + (packed(bytes(body)) if kind == PACKED else bytes(body)) + content[stop:]
    )
