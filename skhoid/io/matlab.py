"""MATLAB files as tables: version 5 through SciPy, version 7.3 through h5py."""

from __future__ import annotations

import importlib
import warnings
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy import io as scipy_io
from scipy import sparse
from scipy.io.matlab import MatlabFunction, MatlabObject, MatlabOpaque

from ..runs.roles import names_time
from .archives import grid_of, stream
from .files import FileTable, numbers_of, read_as, read_clock, require
from .structs import Columns, Structs, Unreadable, as_table, find_columns

_HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
# "" is a file that h5py wrote, not MATLAB.
_NUMERIC_CLASSES = {"", "double", "single", "logical"} | {
    f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)
}
_IS_OBJECT = "is a MATLAB object{}, which only MATLAB can open. In MATLAB: {}"
_DATASET = (
    "d.t = {0}{{1}}.Values.Time; for k = 1:{0}.numElements, d.(matlab.lang.makeValidName("
    "{0}{{k}}.Name)) = squeeze({0}{{k}}.Values.Data); end, save('runs.mat', '-struct', 'd')"
)
_IN_MATLAB = {
    "timeseries": "t = {0}.Time; x = squeeze({0}.Data); save('runs.mat', 't', 'x')",
    "timetable": "t = seconds({0}.Properties.RowTimes - {0}.Properties.RowTimes(1)); writetable("
    "[table(t), timetable2table({0}, 'ConvertRowTimes', false)], 'runs.csv')",
    "table": "writetable({0}, 'runs.csv')",
    "iddata": "u = {0}.InputData; y = {0}.OutputData; t = {0}.SamplingInstants; save('runs.mat', "
    "'u', 'y', 't')",
    "string": "{0} = cellstr({0}); save('runs.mat')",
    "Simulink.SimulationData.Dataset": _DATASET,
    "Simulink.SimulationOutput": "logsout = {0}.logsout; " + _DATASET.replace("{0}", "logsout"),
}
_OR_INSTALL = '. Or in Python: pip install "skhoid[matlab]", which opens tables and timetables.'
_OF_OTHERS = "save its parts as plain arrays, one vector per channel."
_IS_FUNCTION = "is a function handle, not data."
_SAMPLED = 2  # signals, from which on objects beside them may be left alone


def read_mat(path: Path) -> FileTable:
    """List the signals of a MAT file, under dotted names where structs hold them."""
    tree = read_tree(path)
    _open_tables(path, tree)
    found = find_columns(tree)
    remarks = [] if found.run_name else _on_one_clock(path, found)
    objects = {n: v.why for n, v in tree.items() if isinstance(v, Unreadable) and v.is_object}
    signals = [v for v in found.arrays.values() if v.dtype.kind in "iuf" and max(v.shape) > 1]
    if objects and len(signals) < _SAMPLED:
        name, why = next(iter(objects.items()))
        raise ValueError(f"In {path}, {name!r} {why}")
    table = as_table(path, "a MATLAB file", tree, found)
    table.note = " ".join(f"The file also has {n!r}, which {why}" for n, why in objects.items())
    table.remarks += remarks
    return table


def _open_tables(path: Path, tree: dict[str, Any]) -> None:
    """Tables and timetables as structs, where mat-io is installed, which can open them."""
    names = [n for n, v in tree.items() if isinstance(v, Unreadable) and v.is_object]
    opened = {}
    with warnings.catch_warnings(), suppress(Exception):  # then they stay closed, and are named
        warnings.simplefilter("ignore")
        if names:
            opened = importlib.import_module("matio").load_from_mat(path, variable_names=names)
    for name in names:
        frame = opened.get(name)
        if isinstance(frame, pd.DataFrame):
            clock = frame.index.to_series().reset_index(drop=True)
            timed = {"Time": read_clock(clock)} if clock.dtype.kind in "mM" else {}
            numbers = {str(k): np.asarray(v) for k, v in frame.items() if v.dtype.kind in "biuf"}
            tree[name] = timed | numbers


def _on_one_clock(path: Path, found: Columns) -> list[str]:
    """Interpolate signals whose structs have clocks of their own, where these differ."""
    clocks: dict[str, str] = {}
    for name in found.arrays:
        place, _, own = name.rpartition(".")
        if place and names_time(own) and np.size(found.arrays[name]) > 1:
            clocks[place] = name
    of_clock = {
        name: clocks[place]
        for name, values in found.arrays.items()
        if (place := name if name in clocks else name.rpartition(".")[0]) in clocks
        and name not in clocks.values()
        and np.size(values) == np.size(found.arrays[clocks[place]])
    }
    times = [np.ravel(found.arrays[name]) for name in dict.fromkeys(of_clock.values())]
    if all(np.array_equal(times[0], other) for other in times[1:]):
        return []
    streams = {
        name: stream(name, numbers_of(found.arrays[clock]), numbers_of(found.arrays[name]))
        for name, clock in of_clock.items()
    }
    instants, start = grid_of(path, list(streams.values()), None)
    for name, one in streams.items():
        found.arrays[name] = one.at(instants + start, 0)
    for name in clocks.values():
        del found.arrays[name]
    found.arrays["time"] = instants
    return ["signals have clocks that differ, and are interpolated onto that of the fastest"]


def read_tree(path: Path) -> dict[str, Any]:
    """The variables of a MAT file: arrays, text, lists (cells), dicts (structs), Unreadable."""
    if _is_hdf5(path):
        h5py = require("h5py", f"Reading the MATLAB 7.3 file {path}")
        with read_as(path, "a MATLAB 7.3 file"), h5py.File(path, "r") as file:
            return _of_group(h5py, path, file, "")
    with warnings.catch_warnings(), read_as(path, "a MATLAB file"):
        # Objects all carry the name "None" for SciPy < 1.18; what they are is said below.
        warnings.simplefilter("ignore", scipy_io.matlab.MatReadWarning)
        content = scipy_io.loadmat(path)
    tree: dict[str, Any] = {}
    for name, value in content.items():
        if isinstance(value, MatlabOpaque):
            own = {key: _text(value[key].item()) for key in ("s0", "s2") if _has(value, key)}
            shown = own.get("s0", name)
            tree[shown] = _is_object(shown, own.get("s2", ""))
        elif not name.startswith("__"):
            tree[name] = _from_scipy(name, value)
    return tree


def _is_hdf5(path: Path) -> bool:
    """Whether a MAT file is of version 7.3, which is HDF5."""
    with path.open("rb") as file:
        head = file.read(1024)
    if not head:
        raise ValueError(f"{path} is empty.")
    # MATLAB puts 512 bytes of its own before the HDF5 signature.
    return head.startswith(_HDF5_SIGNATURE) or head[512:].startswith(_HDF5_SIGNATURE)


def _has(value: Any, key: str) -> bool:
    return key in (value.dtype.names or ())


def _text(stored: Any) -> str:
    return stored.decode("latin1") if isinstance(stored, bytes) else str(stored)


def _is_object(name: str, matlab_class: str) -> Unreadable:
    of_class = f" ({matlab_class})" if matlab_class else ""
    line = _IN_MATLAB.get(matlab_class, _OF_OTHERS).format(name)
    line += _OR_INSTALL if matlab_class in ("table", "timetable") else ""
    return Unreadable(_IS_OBJECT.format(of_class, line), is_object=True)


def _from_scipy(name: str, value: Any) -> Any:
    if isinstance(value, MatlabOpaque | MatlabObject):
        return _is_object(name, getattr(value, "classname", ""))
    if isinstance(value, MatlabFunction):
        return Unreadable(_IS_FUNCTION)
    if sparse.issparse(value):
        return value
    if value is None:  # of an empty cell in a cell
        return np.empty(0)
    if value.dtype.names:
        kinds = value.dtype.names
        found = Structs({k: _from_scipy(f"{name}.{k}", e[k]) for k in kinds} for e in value.flat)
        return found[0] if len(found) == 1 else found
    if value.dtype == object:
        return [_from_scipy(name, cell) for cell in value.flat]
    if value.dtype.kind == "U":
        texts = [str(text) for text in value.flat]
        return texts if len(texts) > 1 else "".join(texts)
    return value


def _of_group(h5py: Any, path: Path, group: Any, name: str) -> Any:
    # MATLAB keeps the content of cells and objects in #refs# and #subsystem#; None leads nowhere.
    items = {k: v for k, v in group.items() if not k.startswith("#") and v is not None}
    below = {key: f"{name}.{key}".lstrip(".") for key in items}
    if items and all(
        isinstance(v, h5py.Dataset) and v.dtype.kind == "O" and not _class_of(v)
        for v in items.values()
    ):  # the fields of a struct array are references, without a class of their own
        fields = {
            key: [
                _from_hdf5(h5py, path, group.file[r], below[key]) if r else None
                for r in v[()].T.flat
            ]
            for key, v in items.items()
        }
        elements = zip(*fields.values(), strict=True)
        found = Structs(dict(zip(fields, element, strict=True)) for element in elements)
        return found[0] if len(found) == 1 else found
    return {key: _from_hdf5(h5py, path, item, below[key]) for key, item in items.items()}


def _class_of(item: Any) -> str:
    return _text(item.attrs.get("MATLAB_class", b""))


def _from_hdf5(h5py: Any, path: Path, item: Any, name: str) -> Any:
    matlab_class = _class_of(item)
    if "MATLAB_sparse" in item.attrs:
        return Unreadable(f"is sparse: save full({name}).")
    if "MATLAB_object_decode" in item.attrs:
        return _is_object(name, matlab_class)
    if isinstance(item, h5py.Group):
        known = matlab_class in ("", "struct")
        return _of_group(h5py, path, item, name) if known else _is_object(name, matlab_class)
    if matlab_class == "function_handle":
        return Unreadable(_IS_FUNCTION)
    if matlab_class not in _NUMERIC_CLASSES | {"cell", "char"}:
        return _is_object(name, matlab_class)
    with read_as(path, f"a MATLAB 7.3 file, at its variable {name!r}"):
        values = item[()]
        if item.attrs.get("MATLAB_empty", 0):  # an empty array is stored as its shape
            return "" if matlab_class == "char" else np.empty(0)
        if h5py.check_ref_dtype(item.dtype):
            return [_from_hdf5(h5py, path, item.file[r], name) if r else "" for r in values.T.flat]
        if matlab_class == "cell":
            return []
        if values.dtype.names == ("real", "imag"):
            values = values["real"] + 1j * values["imag"]
        # MATLAB stores by columns and HDF5 by rows, so the axes come reversed.
        values = np.asarray(values).T
        if matlab_class == "char":
            rows = ["".join(map(chr, row)).rstrip() for row in np.atleast_2d(values)]
            return rows if len(rows) > 1 else rows[0]
        return values
