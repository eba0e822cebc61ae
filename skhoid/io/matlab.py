"""MATLAB files as tables: version 5 through SciPy, version 7.3 through h5py."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from scipy import io as scipy_io
from scipy import sparse
from scipy.io.matlab import MatlabFunction, MatlabObject, MatlabOpaque

from .files import FileTable, one_by_one, read_as, require

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


def read_content(path: Path) -> dict[str, Any]:
    """The variables of a MAT file of version 5, as SciPy gives them."""
    with warnings.catch_warnings(), read_as(path, "a MATLAB file"):
        # Objects all carry the name "None" for SciPy < 1.18; they are reported by read_mat.
        warnings.simplefilter("ignore", scipy_io.matlab.MatReadWarning)
        return scipy_io.loadmat(path)


def _read_v5(path: Path) -> FileTable:
    content = read_content(path)
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
        if not sparse.issparse(values):
            return values
        with read_as(path, f"a MATLAB file, at its variable {names[position]!r}"):
            return values.toarray()

    return FileTable(
        path,
        names,
        one_by_one(load),
        unreadable=unreadable,
        note=note,
        kind="variable",
        run_name=runs,
        faults=faults,
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
        _list_hdf5(h5py, file, "", places, unreadable)
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

    return FileTable(path, names, one_by_one(load), unreadable=unreadable, kind="variable")


def _list_hdf5(
    h5py: Any, group: Any, prefix: str, places: dict[str, str], unreadable: dict[str, str]
) -> None:
    for key, item in group.items():
        # MATLAB keeps the content of cells and objects in #refs# and #subsystem#.
        if key.startswith("#") or item is None:  # a link to nothing
            continue
        name = f"{prefix}{key}"
        what = _not_numbers(h5py, name, item)
        if what is None:
            places[name] = item.name
            continue
        unreadable[name] = what
        if _is_struct(h5py, item):
            _list_hdf5(h5py, item, f"{name}.", places, unreadable)


def _name_class(item: Any) -> str:
    found = item.attrs.get("MATLAB_class", b"")
    return found.decode() if isinstance(found, bytes) else str(found)


def _is_struct(h5py: Any, item: Any) -> bool:
    other = {"MATLAB_sparse", "MATLAB_object_decode"} & {*item.attrs}
    return isinstance(item, h5py.Group) and not other and _name_class(item) in ("", "struct")


def _not_numbers(h5py: Any, name: str, item: Any) -> str | None:
    """What an object in a file is instead of numbers; None if it holds numbers."""
    is_group = isinstance(item, h5py.Group)
    matlab_class = _name_class(item)
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
