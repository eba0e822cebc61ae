"""MAT 5 files, checked before SciPy reads them: wrong types and sizes crash SciPy.

A file is a header and elements; an element is a tag (type and size) and data; an array is an
element of elements: flags, dimensions, name, and data or further arrays. The format:
https://www.mathworks.com/help/pdf_doc/matlab/matfile_format.pdf (without functions and objects).
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Collection, Iterator
from io import BytesIO
from pathlib import Path
from struct import Struct, unpack_from
from typing import Any, BinaryIO, NoReturn

from scipy.io.matlab import matfile_version

__all__ = ["checked"]

_HEADER = 128
_TAG = 8
_ARRAY, _PACKED = 14, 15
_BYTES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8}  # of a number, by type
_INTEGERS = {5, 6}
_TEXT = {1, 2, 4, 16, 17, 18}
_NAMES = {1, 16}
_CELL, _STRUCT, _OBJECT, _CHAR, _SPARSE, _FUNCTION, _OPAQUE = 1, 2, 3, 4, 5, 16, 17
_NUMBERS = range(6, 16)
_COMPLEX = 0x800
_MOST_DIMENSIONS = 32  # of SciPy
_DEEPEST = 100  # SciPy would recurse until the stack overflows
_PIECE = 2**16
_MOST_AT_ONCE = 2**20
_MOST_WITHOUT_BYTES = 2**20  # characters, or structs without fields


def checked(path: Path) -> Iterator[Any]:
    """What SciPy reads instead of a file: itself, or its variables unpacked, a few at a time.

    Unpacking takes most of the time of reading, so it is done once. Other versions are not checked.
    """
    with path.open("rb") as file:
        if matfile_version(file)[0] != 1:
            yield path
            return
        file.seek(0)
        header = file.read(_HEADER)
        tag = Struct("<II" if header.endswith(b"IM") else ">II")
        elements = list(_listed(file, tag))
        if all(kind == _ARRAY for kind, _, _ in elements):
            for _, start, stop in elements:
                _Array(file, tag, start).check(stop)
            yield path
            return
        unpacked = BytesIO()
        for element in elements:
            if unpacked.tell() > _MOST_AT_ONCE:
                yield unpacked
                unpacked = BytesIO()
            start = unpacked.tell() or unpacked.write(header)
            _unpack(file, tag, element, unpacked)
            stop = unpacked.tell()
            _Array(unpacked, tag, start).check(stop)
            unpacked.seek(stop)
        yield unpacked


def _damaged(where: str, what: str) -> ValueError:
    return ValueError(
        f"it is damaged at {where}: {what}. Use another copy, or save the file again."
    )


def _listed(file: BinaryIO, tag: Struct) -> Iterator[tuple[int, int, int]]:
    """Type, start and stop of the elements that are not part of others."""
    end = file.seek(0, 2)
    start = _HEADER
    while start < end:
        file.seek(start)
        head = file.read(_TAG)
        kind, size = tag.unpack(head) if len(head) == _TAG else (0, 0)
        stop = start + _TAG + size
        if kind not in (_ARRAY, _PACKED) or not size or stop > end:
            what = f"{size} bytes of type {kind} do not fit into the {end - start} that are left"
            raise _damaged(f"its byte {start}", what)
        yield kind, start, stop
        start = stop


def _unpack(file: BinaryIO, tag: Struct, element: tuple[int, int, int], to: BinaryIO) -> None:
    """Append an element, unpacked, to others."""
    kind, start, stop = element
    where = f"its byte {start}"
    unpack: Callable[[bytes], bytes] = bytes
    if kind == _PACKED:
        # Some writers leave out the end of the stream, which zlib.decompress asks for.
        unpack, start = zlib.decompressobj().decompress, start + _TAG
    file.seek(start)
    size = done = 0
    for left in range(stop - start, 0, -_PIECE):
        try:
            piece = unpack(file.read(min(left, _PIECE)))
        except zlib.error as error:
            raise _damaged(where, str(error)) from error
        if not done and len(piece) >= _TAG:
            kind, size = tag.unpack(piece[:_TAG])
        done += to.write(piece)
        if done > _TAG + size:
            break
    if kind != _ARRAY or done != _TAG + size:
        raise _damaged(where, f"{done} bytes are packed instead of {_TAG + size}")


class _Array:
    """An array, traversed in the order in which SciPy reads it, except for its numbers."""

    def __init__(self, stream: BinaryIO, tag: Struct, start: int) -> None:
        self.stream = stream
        self.tag = tag
        self.at = start + _TAG
        self.name = ""
        stream.seek(self.at)

    def check(self, end: int, depth: int = 0) -> None:
        """Check what follows the tag of an array that ends at ``end``."""
        self.pair(end)  # the tag of the flags
        flags, _ = self.pair(end)
        kind, parts = flags & 0xFF, 2 if flags & _COMPLEX else 1
        shape = () if kind == _OPAQUE else self.integers(end)
        _, _, name = self.part(end, _NAMES, needed=True)
        self.name = self.name or name[:63].decode("latin1")
        count = math.prod(shape)
        for _ in range({_OBJECT: 1, _OPAQUE: 2}.get(kind, 0)):
            self.part(end, _NAMES)
        if kind in _NUMBERS:
            for _ in range(parts):
                stored, size, _ = self.part(end, _BYTES)
                if size != count * _BYTES[stored]:
                    self.fail(f"{size} bytes hold no numbers of the shape {shape}")
        elif kind == _SPARSE:
            for _ in range(2 + parts):
                self.part(end, _BYTES)
        elif kind == _CHAR:
            _, size, _ = self.part(end, _TEXT)
            if count > (size or _MOST_WITHOUT_BYTES):  # blanks may be stored as no bytes
                self.fail(f"{size} bytes hold no text of the shape {shape}")
        elif kind == _CELL:
            self.arrays(count, end, depth)
        elif kind in (_STRUCT, _OBJECT):
            self.arrays(count * self.fields(count, end), end, depth)
        elif kind in (_FUNCTION, _OPAQUE):
            self.arrays(1, end, depth)
        else:
            self.fail(f"there is no class {kind} of arrays")
        if not end <= self.at < end + 8:  # the last padding may be missing
            self.fail(f"its parts end {self.at - end} bytes behind it")

    def arrays(self, count: int, end: int, depth: int) -> None:
        if depth == _DEEPEST or count * _TAG > end - self.at:
            self.fail(f"{end - self.at} bytes, {depth} arrays deep, hold no {count} arrays")
        for _ in range(count):
            kind, size = self.pair(end)
            if kind != _ARRAY or size > end - self.at:
                self.fail(f"an array in it cannot be {size} bytes of type {kind}")
            if size:  # else it is empty
                self.check(self.at + size, depth + 1)

    def fields(self, count: int, end: int) -> int:
        """The number of fields of a struct."""
        width = self.integers(end)
        _, _, names = self.part(end, _NAMES, needed=True)
        # Each name ends with a zero.
        if len(width) != 1 or not width[0] or any(names[width[0] - 1 :: width[0]]):
            self.fail(f"{len(names)} bytes hold no names of fields of {width} bytes")
        if not names and count > _MOST_WITHOUT_BYTES:
            self.fail(f"{count} structs have no fields")
        return len(names) // width[0]

    def integers(self, end: int) -> tuple[int, ...]:
        """Dimensions, or a size."""
        _, size, data = self.part(end, _INTEGERS, needed=True)
        values = unpack_from(f"{self.tag.format[0]}{size // 4}i", data)
        if len(values) > _MOST_DIMENSIONS or min(values, default=-1) < 0:
            self.fail(f"{len(values)} dimensions {values[:4]} are no shape")
        return values

    def part(
        self, end: int, kinds: Collection[int], needed: bool = False
    ) -> tuple[int, int, bytes]:
        """Type, size and, if they are needed, data of the element that begins here."""
        kind, size = self.pair(end)
        left, data = end - self.at, b""
        if kind > 0xFFFF:  # up to four bytes, which stand in the tag
            data = self.tag.pack(size, 0)
            kind, size, left = kind & 0xFFFF, kind >> 16, 4
        elif size <= left:
            data = self.stream.read(size) if needed else b""
            self.at += size + -size % 8
            self.stream.seek(self.at)
        if kind not in kinds or size > left:
            self.fail(f"{size} bytes of type {kind} cannot be in it")
        return kind, size, data[:size]

    def pair(self, end: int) -> tuple[int, int]:
        """The next two numbers: a tag, or flags."""
        self.at += _TAG
        if self.at > end:
            self.fail("it ends too early")
        return self.tag.unpack(self.stream.read(_TAG))

    def fail(self, what: str) -> NoReturn:
        raise _damaged(f"its variable {self.name!r}" if self.name else "one of its variables", what)
