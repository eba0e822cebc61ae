"""Elements of MAT 5 files that SciPy does not write."""

from __future__ import annotations

import struct


def element(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def opaque(name: bytes, class_name: bytes) -> bytes:
    """A classdef object as MATLAB writes it: flags, name, kind, class and a handle."""
    text, array = 1, 14
    handle = element(6, struct.pack("<II", 13, 0)) + element(5, struct.pack("<ii", 6, 1))
    handle += element(text, b"") + element(6, struct.pack("<6I", 0xDD000000, 2, 1, 1, 1, 1))
    body = element(6, struct.pack("<II", 17, 0))
    for part in (name, b"MCOS", class_name):
        body += element(text, part)
    return element(array, body + element(array, handle))
