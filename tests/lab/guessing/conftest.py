"""Write one recording in every format that skhoid reads."""

import h5py
import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

SUFFIXES = {
    "csv": ".csv",
    "semicolon": ".csv",
    "parquet": ".parquet",
    "mat5": ".mat",
    "hdf5": ".mat",
}


def write_columns(folder, kind, columns, stem="run1"):
    """Write columns as ``stem`` in a folder of its own, and return the path."""
    path = folder / kind / f"{stem}{SUFFIXES[kind]}"
    path.parent.mkdir(exist_ok=True)
    frame = pd.DataFrame(columns)
    if kind == "csv":
        frame.to_csv(path, index=False)
    elif kind == "semicolon":
        frame.to_csv(path, index=False, sep=";", decimal=",")
    elif kind == "parquet":
        frame.to_parquet(path)
    elif kind == "mat5":
        savemat(path, {name: np.asarray(values) for name, values in columns.items()})
    else:
        write_hdf5(path, {name: np.asarray(values)[:, None] for name, values in columns.items()})
    return path


def write_hdf5(path, variables):
    """Write a tree of arrays as MATLAB 7.3 does: HDF5 behind a header, axes reversed."""
    with h5py.File(path, "w", userblock_size=512) as file:
        _fill(file, variables)
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


def _fill(group, variables):
    for name, values in variables.items():
        if isinstance(values, dict):
            _fill(group.create_group(name), values)
            group[name].attrs["MATLAB_class"] = np.bytes_("struct")
        else:
            dataset = group.create_dataset(name, data=values.T)
            dataset.attrs["MATLAB_class"] = np.bytes_("double")


@pytest.fixture(scope="session")
def write():
    """Function ``write(folder, kind, columns, stem="run1")`` that returns the path."""
    return write_columns


@pytest.fixture(scope="session")
def write_mat73():
    """Function ``write_mat73(path, variables)``; a dict among the variables is a struct."""
    return write_hdf5
