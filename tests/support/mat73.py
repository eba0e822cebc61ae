"""MAT files of version 7.3, as MATLAB writes them: structs, struct arrays, cells, text, empties."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

_CLASSES = {"f8": "double", "f4": "single", "i2": "int16", "i4": "int32", "i8": "int64"}


def write_mat73(path: Path, content: dict[str, Any]) -> None:
    """Dicts are structs, lists of dicts are struct arrays, tuples are cells."""
    with h5py.File(path, "w") as file:
        refs = file.require_group("#refs#")
        for key, value in content.items():
            _put(file, refs, key, value)


def _put(group: Any, refs: Any, key: str, value: Any) -> None:
    if isinstance(value, dict):
        own = group.create_group(key)
        own.attrs["MATLAB_class"] = np.bytes_("struct")
        for name, item in value.items():
            _put(own, refs, name, item)
    elif isinstance(value, list):
        own = group.create_group(key)
        own.attrs["MATLAB_class"] = np.bytes_("struct")
        for name in value[0]:
            own.create_dataset(name, data=_links(refs, [item[name] for item in value]))
    elif isinstance(value, tuple):
        cell = group.create_dataset(key, data=_links(refs, value))
        cell.attrs["MATLAB_class"] = np.bytes_("cell")
    elif isinstance(value, str):
        text = group.create_dataset(key, data=np.array([[ord(c)] for c in value], np.uint16))
        text.attrs["MATLAB_class"] = np.bytes_("char")
    else:
        numbers = np.atleast_2d(np.asarray(value))
        whole = numbers.T if numbers.size else np.array(numbers.shape, np.uint64)
        data = group.create_dataset(key, data=whole)
        data.attrs["MATLAB_class"] = np.bytes_(_CLASSES.get(numbers.dtype.str[1:], "double"))
        if not numbers.size:
            data.attrs["MATLAB_empty"] = np.uint8(1)


def _links(refs: Any, items: Any) -> np.ndarray:
    links = np.empty((len(items), 1), dtype=h5py.ref_dtype)
    for number, item in enumerate(items):
        key = f"r{len(refs)}"
        _put(refs, refs, key, item)
        links[number, 0] = refs[key].ref
    return links
