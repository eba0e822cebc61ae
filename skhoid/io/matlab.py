"""MATLAB files as tables: version 5 through SciPy, checked before, version 7.3 through h5py."""

from __future__ import annotations

import math
import warnings
import zlib
from collections import deque
from collections.abc import Callable, Collection, Iterator
from io import BytesIO
from pathlib import Path
from struct import Struct, unpack_from
from typing import Any, BinaryIO, NoReturn

import numpy as np
from scipy import io as scipy_io
from scipy import sparse
from scipy.io.matlab import MatlabFunction, MatlabObject, MatlabOpaque, matfile_version

from .._machine import check_memory
from .files import FileTable, one_by_one, read_as, require

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


_MOST_NAMES = 100_000  # links that lead to each other never end
_HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
# "" is a file that h5py wrote, not MATLAB.
_NUMERIC_CLASSES = {"", "double", "single", "logical"} | {
    f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)
}
_IS_OBJECT = (
    "is a MATLAB object, which only MATLAB can open. Save its parts as plain arrays; for an "
    "iddata d: u = d.InputData; y = d.OutputData; t = d.SamplingInstants; save(file, 'u', 'y', 't')"
    ", one vector per channel."
)
_IS_STRUCT = "is a struct: ask for one of its fields by a dotted path, such as {}."
_STRUCT_ARRAY = "is a struct array: save one plain variable per channel, one column per run."
_IS_CELL = "is a cell array: save one plain variable per channel, one column per run."
_IS_FUNCTION = "is a function handle, not data."
_NOT_NUMBERS = {"cell": _IS_CELL, "char": "is text, not numbers.", "function_handle": _IS_FUNCTION}


def read_mat(path: Path) -> FileTable:
    """List the variables and struct fields of a MAT file under dotted names."""
    return _read_hdf5(path) if is_hdf5(path) else _read_v5(path)


def is_hdf5(path: Path) -> bool:
    """Whether a MAT file is of version 7.3, which is HDF5."""
    with path.open("rb") as file:
        head = file.read(1024)
    if not head:
        raise ValueError(f"{path} is empty.")
    # MATLAB puts 512 bytes of its own before the HDF5 signature.
    return head.startswith(_HDF5_SIGNATURE) or head[512:].startswith(_HDF5_SIGNATURE)


def content_of(path: Path) -> dict[str, Any]:
    """The variables of a MAT file of version 5, as SciPy gives them."""
    with warnings.catch_warnings(), read_as(path, "a MATLAB file"):
        # Objects all carry the name "None" for SciPy < 1.18; they are reported by read_mat.
        warnings.simplefilter("ignore", scipy_io.matlab.MatReadWarning)
        content: dict[str, Any] = {}
        for part in checked(path):
            content |= scipy_io.loadmat(part)
    return content


def _read_v5(path: Path) -> FileTable:
    content = content_of(path)
    arrays: dict[str, Any] = {}  # sparse ones too
    unreadable: dict[str, str] = {}
    note = ""
    for name, value in content.items():
        if isinstance(value, MatlabOpaque):
            fields = value.dtype.names or ()
            stored = value["s0"].item() if "s0" in fields else name
            shown = stored.decode("latin1") if isinstance(stored, bytes) else str(stored)
            unreadable[shown] = _IS_OBJECT
            note = f"The file also has {shown!r}, which {_IS_OBJECT}"
        elif not name.startswith("__"):
            _flatten(name, value, arrays, unreadable)
    runs, faults = _runs_of_struct_arrays(content, arrays, unreadable)
    names = list(arrays)

    def load(position: int) -> np.ndarray:
        values = arrays[names[position]]
        if sparse.issparse(values):
            what = f"The sparse variable {names[position]!r} of {path}, with its zeros,"
            check_memory(math.prod(values.shape), what)
            with read_as(path, f"a MATLAB file, at its variable {names[position]!r}"):
                values = values.tocsc()
                values.check_format()  # SciPy would write out of bounds
                values = values.toarray()
        return values

    return FileTable(
        path,
        names,
        one_by_one(load),
        unreadable=unreadable,
        note=note,
        kind="variable",
        run_name=runs,
        faults=faults,
        peek=lambda count: [first_of(load(position), count) for position in range(len(names))],
    )


def _runs_of_struct_arrays(
    content: dict[str, Any], arrays: dict[str, Any], unreadable: dict[str, str]
) -> tuple[str | None, list[str]]:
    """Join the fields of a struct array of which each element is a run.

    Returns the name of the variable that numbers the runs, and what is wrong with them.
    """
    faults: list[str] = []
    for name, value in content.items():
        if not isinstance(value, np.ndarray) or value.dtype.names is None or value.size == 1:
            continue
        elements = [{key: _plain(e[key]) for key in value.dtype.names} for e in value.flat]
        sizes = [[v.size for v in e.values() if v is not None and v.size > 1] for e in elements]
        if not all(sizes):
            continue
        lengths = [max(set(own), key=own.count) for own in sizes]
        for key in value.dtype.names:
            parts = []
            for k, (element, length) in enumerate(zip(elements, lengths, strict=True), 1):
                part = element[key]
                if part is None or part.size == 0:
                    break
                if part.size not in (1, length):
                    faults.append(
                        f'"{name}({k}).{key}" has {part.size} samples, the other fields of '
                        f"{name}({k}) {length}: all need one value per sample."
                    )
                    part = np.resize(part, length)
                parts.append(np.repeat(part, length) if part.size == 1 else part)
            if len(parts) == len(elements):
                arrays[f"{name}.{key}"] = np.concatenate(parts)
            else:
                unreadable[f"{name}.{key}"] = "is not in every element of its struct array."
        arrays[name] = np.repeat(np.arange(1, len(lengths) + 1), lengths)
        del unreadable[name]
        return name, faults
    return None, faults


def _plain(value: Any) -> np.ndarray | None:
    """Numbers of a vector, or one number or text; None for anything else."""
    if not isinstance(value, np.ndarray) or value.dtype.names or max(value.shape) < value.size:
        return None
    return value.ravel() if value.dtype.kind in "biufU" else None


def _flatten(name: str, value: Any, arrays: dict[str, Any], unreadable: dict[str, str]) -> None:
    if isinstance(value, MatlabOpaque | MatlabObject):
        unreadable[name] = _IS_OBJECT
    elif isinstance(value, MatlabFunction):
        unreadable[name] = _IS_FUNCTION
    elif sparse.issparse(value):
        arrays[name] = value
    elif value.dtype.names:
        if value.size != 1:
            unreadable[name] = _STRUCT_ARRAY
            return
        unreadable[name] = _IS_STRUCT.format(f"{name}.{value.dtype.names[0]}")
        for key in value.dtype.names:
            _flatten(f"{name}.{key}", value.flat[0][key], arrays, unreadable)
    elif value.dtype == object:
        texts = [cell.item() if getattr(cell, "size", 0) == 1 else cell for cell in value.flat]
        if texts and all(isinstance(text, str) for text in texts):
            arrays[name] = np.array(texts)
        else:
            unreadable[name] = _IS_CELL
    else:
        arrays[name] = value


def _read_hdf5(path: Path) -> FileTable:
    h5py = require("h5py", f"Reading the MATLAB 7.3 file {path}")
    places: dict[str, str] = {}
    unreadable: dict[str, str] = {}
    with read_as(path, "a MATLAB 7.3 file"), h5py.File(path, "r") as file:
        _list_hdf5(h5py, file, places, unreadable)
    names = list(places)

    def load(position: int) -> np.ndarray:
        part = f"a MATLAB 7.3 file, at its variable {names[position]!r}"
        with read_as(path, part), h5py.File(path, "r") as file:
            dataset = file[places[names[position]]]
            if dataset.attrs.get("MATLAB_empty", 0):
                # An empty array is stored as its shape.
                return np.empty(0)
            values = dataset[()]
        if values.dtype.names == ("real", "imag"):
            values = values["real"] + 1j * values["imag"]
        # MATLAB stores by columns and HDF5 by rows, so the axes come reversed.
        return np.asarray(values).T

    def peek(count: int) -> list[Any]:
        found = []
        with read_as(path, "a MATLAB 7.3 file"), h5py.File(path, "r") as file:
            for name in names:
                dataset = file[places[name]]
                stored = dataset.attrs.get("MATLAB_empty", 0) or not dataset.shape
                values = np.empty(0) if stored else dataset[..., :count]
                if dataset.ndim == 2 and dataset.shape[1] == 1:  # stored as a row in MATLAB
                    values = dataset[:count]
                found.append(first_of(np.asarray(values).T, count))
        return found

    return FileTable(
        path, names, one_by_one(load), unreadable=unreadable, kind="variable", peek=peek
    )


def first_of(values: np.ndarray, count: int) -> np.ndarray:
    """The first samples of a variable, or of its first run if its columns are runs."""
    if values.ndim == 2 and 1 not in values.shape:
        return values[:count, 0]
    return np.ravel(values)[:count]


def _list_hdf5(h5py: Any, file: Any, places: dict[str, str], unreadable: dict[str, str]) -> None:
    """List what a file holds, shallow names first; links may lead anywhere, even back."""
    waiting = deque([("", "", file, frozenset([_identity(h5py, file)]))])
    while waiting and len(places) + len(unreadable) < _MOST_NAMES:
        prefix, route, group, above = waiting.popleft()
        for key in group:
            # MATLAB keeps the content of cells and objects in #refs# and #subsystem#.
            if key.startswith("#"):
                continue
            name, place = f"{prefix}{key}", f"{route}/{key}"
            try:
                item = group[key]
                what = _not_numbers(h5py, name, item)
                is_struct = _is_struct(h5py, item)
            except (KeyError, OSError, RuntimeError) as error:
                unreadable[name] = f"is damaged, or a link to nothing: {error.args[0]}."
                continue
            if what is None:
                places[name] = place
                continue
            unreadable[name] = what
            if is_struct:
                itself = _identity(h5py, item)
                if itself not in above:
                    waiting.append((f"{name}.", place, item, above | {itself}))


def _identity(h5py: Any, group: Any) -> tuple[int, int]:
    """What identifies a group under all its names."""
    info = h5py.h5o.get_info(group.id)
    return info.fileno, info.addr


def _class_of(item: Any) -> str:
    found = item.attrs.get("MATLAB_class", b"")
    return found.decode() if isinstance(found, bytes) else str(found)


def _is_struct(h5py: Any, item: Any) -> bool:
    other = {"MATLAB_sparse", "MATLAB_object_decode"} & {*item.attrs}
    return isinstance(item, h5py.Group) and not other and _class_of(item) in ("", "struct")


def _not_numbers(h5py: Any, name: str, item: Any) -> str | None:
    """What an object in a file is instead of numbers; None if it holds numbers."""
    is_group = isinstance(item, h5py.Group)
    matlab_class = _class_of(item)
    if "MATLAB_sparse" in item.attrs:
        return f"is sparse: save full({name})."
    if "MATLAB_object_decode" in item.attrs:
        return _IS_OBJECT
    if _is_struct(h5py, item):
        return _IS_STRUCT.format(f"{name}.{next(iter(item), 'field')}")
    if matlab_class in _NOT_NUMBERS:
        return _NOT_NUMBERS[matlab_class]
    if is_group or matlab_class not in _NUMERIC_CLASSES or not isinstance(item, h5py.Dataset):
        return _IS_OBJECT
    # The fields of a struct array are references, without a class of their own.
    return _STRUCT_ARRAY if item.dtype.kind == "O" else None
