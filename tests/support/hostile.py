"""Recordings, good and bad, as users may have them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from hypothesis import strategies as st

ODD = (RuntimeWarning, NotImplementedError)  # of NumPy and pyarrow at odd casts
LENGTHS = st.sampled_from([1, 2, 3, 4, 5, 8, 13, 40, 41, 100, 150])
NAMES = ["e", "x", "f_t", "motion_roll", "dist", "u", "error [deg]", "run", "time", "", "a b", 0, 1]
ODD_NAMES = [None, float("nan"), ("e", "deg"), 1.5, True, b"e", "\x00", "e\n", "λ"]

BAD_NAMES = [
    -1, 0, 0.5, float("nan"), float("inf"), "2", None, [], [1, 2], 10**9, 1e300, {}, True,
    "no such word", "", ["no such name"], ("e",), np.array([1.0]), object(),
]  # fmt: skip
BAD = [
    *BAD_NAMES, -1.5, 1e-300, "1", b"a", 1j, -(10**9), 10**30, [np.nan], [np.inf], ["1"], [[1]],
    [None], [[]], (1, 2, 3, 4, 5, 6), {"e": 1}, np.zeros((2, 2)), np.array(["a"]),
    pd.Series([1.0]), pd.NA, slice(1), len, lambda t: "a", lambda t: 1 / 0, lambda t: {}["a"],
]  # fmt: skip


@dataclass
class Recording:
    """Channels and output, and whether anything was done to them."""

    X: Any
    y: Any
    faults: tuple[str, ...] = ()

    def __repr__(self) -> str:
        X, y = self.X, self.y
        index = X.index[:4].tolist() if isinstance(X, pd.DataFrame) else None
        kinds = dict(zip(X.columns, X.dtypes, strict=True)) if index is not None else ""
        return f"Recording(faults={self.faults}, index={index}, columns={kinds},\nX=\n{X}\ny=\n{y})"


def filtered(rng: np.random.Generator, e: np.ndarray, noise: float) -> np.ndarray:
    """The output of a stable ARX system of order two."""
    u = np.zeros(len(e))
    disturbance = noise * rng.standard_normal(len(e))
    for t in range(len(e)):
        past = [u[t - k] if t >= k else 0.0 for k in (1, 2)]
        u[t] = 1.2 * past[0] - 0.5 * past[1] + 0.4 * e[t] - 0.2 * e[max(t - 1, 0)]
        u[t] += disturbance[t]
    return u


@st.composite
def good(draw: Any, min_runs: int = 1, lengths: Any = None, channels: Any = None) -> Recording:
    """Runs that keep the convention."""
    rng = np.random.default_rng(draw(st.integers(0, 2**16)))
    sizes = draw(st.lists(LENGTHS if lengths is None else lengths, min_size=min_runs, max_size=4))
    names = draw(
        st.sampled_from([["e"], ["e", "x"], ["e", "x", "f_t"], ["stick"], ["e", "motion_roll"]])
        if channels is None
        else channels
    )
    dt = draw(st.sampled_from([0.01, 0.02, 0.1, 1 / 3, 1.0]))
    labels = draw(st.permutations(["a", "b", "c", "d"] if draw(st.booleans()) else [3, 1, 2, 10]))
    frames, outputs = [], []
    for label, size in zip(labels, sizes, strict=False):
        index = pd.MultiIndex.from_arrays(
            [[label] * size, dt * np.arange(size)], names=["run", "time"]
        )
        values = {name: rng.standard_normal(size) for name in names}
        frames.append(pd.DataFrame(values, index=index))
        outputs.append(filtered(rng, values[names[0]], draw(st.sampled_from([0.0, 0.1]))))
    X = pd.concat(frames)
    return Recording(X, pd.Series(np.concatenate(outputs), index=X.index, name="u"))


@st.composite
def recordings(draw: Any) -> Recording:
    """Good runs to which up to three things were done."""
    return draw(worsened(draw(good()), sorted(FAULTS)))


@st.composite
def worsened(draw: Any, recording: Recording, faults: list[str], most: int = 3) -> Recording:
    """A recording to which some of the faults were done."""
    for fault in draw(st.lists(st.sampled_from(faults), max_size=most, unique=True)):
        try:
            X, y = FAULTS[fault](draw, recording.X, recording.y)
        except (
            AssertionError,
            AttributeError,
            TypeError,
            ValueError,
            IndexError,
            KeyError,
            OverflowError,
            Warning,
        ):
            continue  # what pandas does not do to what was already done
        recording = Recording(X, y, (*recording.faults, fault))
    return recording


def _some(draw: Any, n: int) -> np.ndarray:
    """Some of n rows: one, a few, a stretch, every other, all."""
    start = draw(st.integers(0, max(n - 1, 0)))
    kind = draw(st.sampled_from(["one", "stretch", "other", "all", "first"]))
    rows = {
        "one": [start],
        "stretch": range(start, min(start + 7, n)),
        "other": range(0, n, 2),
        "all": range(n),
        "first": [0],
    }[kind]
    return np.array([row for row in rows if row < n], dtype=int)


def _change_column(draw: Any, X: Any, y: Any) -> Any:
    X = X.copy()
    name = draw(st.sampled_from(list(X.columns)))
    n = len(X)
    X[name] = {
        "constant": lambda: np.full(n, 2.0),
        "zero": lambda: np.zeros(n),
        "ramp": lambda: np.arange(float(n)),
        "pulse": lambda: np.arange(n) == n // 2,
        "output": lambda: np.asarray(y),
        "huge": lambda: X[name] * 1e39,
        "too huge": lambda: X[name] * 1e200,
        "tiny": lambda: X[name] * 1e-39,
        "too tiny": lambda: X[name] * 1e-200,
        "denormal": lambda: X[name] * 1e-310,
        "rank": lambda: X[X.columns[-1]] * (1 + 1e-15),
        "offset": lambda: X[name] + 1e12,
    }[draw(st.sampled_from(COLUMNS))]()
    return X, y


COLUMNS = [
    "constant", "zero", "ramp", "pulse", "output", "huge", "too huge", "tiny", "too tiny",
    "denormal", "rank", "offset",
]  # fmt: skip
DTYPES = [
    "int64", "int8", "uint16", "bool", "float32", "float16", "object", "str", "category", "Int64",
    "Float64", "boolean", "complex128", "string", "timedelta64[ns]", "datetime64[ns]",
    "longdouble", "Sparse[float]", "double[pyarrow]",
]  # fmt: skip


def _change_dtype(draw: Any, X: Any, y: Any) -> Any:
    kind = draw(st.sampled_from(DTYPES))
    if draw(st.booleans()):
        return X, y.round().astype(kind)
    X = X.copy()
    name = draw(st.sampled_from(list(X.columns)))
    X[name] = (X[name] * 3).round().astype(kind)
    return X, y


def _objects(draw: Any, X: Any, y: Any) -> Any:
    X = X.astype(object)
    odd = draw(st.sampled_from(["1,5", "", None, pd.NA, [1], {}, "nan", 1j, pd.NaT, object, b"1"]))
    for row in _some(draw, len(X)):
        X.iloc[row, draw(st.integers(0, X.shape[1] - 1))] = odd
    return X, y


def _put(draw: Any, X: Any, y: Any) -> Any:
    value = draw(st.sampled_from([np.nan, np.nan, np.nan, np.inf, -np.inf, 1e41, 1e308, 0.0]))
    rows = _some(draw, len(X))
    if draw(st.booleans()):
        y = y.copy()
        y.iloc[rows] = value
    else:
        X = X.copy()
        X.iloc[rows, draw(st.integers(0, X.shape[1] - 1))] = value
    return X, y


def _rename(draw: Any, X: Any, y: Any) -> Any:
    names = st.sampled_from(NAMES + ODD_NAMES)
    return X.set_axis(draw(st.lists(names, min_size=X.shape[1], max_size=X.shape[1])), axis=1), y


def _select_rows(draw: Any, X: Any, y: Any) -> Any:
    n = len(X)
    rows = {
        "none": np.arange(0),
        "reversed": np.arange(n)[::-1],
        "twice": np.repeat(np.arange(n), 2),
        "again": np.tile(np.arange(n), 2),
        "gap": np.delete(np.arange(n), _some(draw, n)),
        "one": np.arange(1),
        "shuffled": np.random.default_rng(0).permutation(n),
    }[draw(st.sampled_from(["none", "reversed", "twice", "again", "gap", "one", "shuffled"]))]
    return X.iloc[rows], y.iloc[rows]


def _change_time(draw: Any, X: Any, y: Any) -> Any:
    time = X.index.get_level_values("time").to_numpy().copy()
    kind = draw(
        st.sampled_from(
            ["ms", "datetime", "timedelta", "text", "nan", "inf", "late", "early", "still",
             "jitter", "shaken", "object", "int", "zoned", "nat", "far", "float32", "zero step"]
        )
    )  # fmt: skip
    rng = np.random.default_rng(0)
    rows = _some(draw, len(time))
    if kind in ("nan", "inf"):
        time[rows] = float(kind)
    new: Any = {
        "ms": lambda: np.round(time * 1000).astype(int),
        "datetime": lambda: pd.Timestamp("2020-03-29 00:59:59") + pd.to_timedelta(time, unit="s"),
        "zoned": lambda: pd.Timestamp("2020-03-29", tz="UTC") + pd.to_timedelta(time, unit="s"),
        "timedelta": lambda: pd.to_timedelta(time, unit="s"),
        "nat": lambda: pd.to_timedelta(pd.Series(time).mask(np.isin(np.arange(len(time)), rows))),
        "text": lambda: time.astype(str),
        "object": lambda: time.astype(object),
        "int": lambda: np.arange(len(time)),
        "late": lambda: time + 1e9,
        "far": lambda: time + 1e16,
        "early": lambda: time - 5.0,
        "still": lambda: time * 0.0,
        "jitter": lambda: time + 1e-4 * rng.standard_normal(len(time)),
        "shaken": lambda: time * (1 + 0.3 * rng.standard_normal(len(time))),
        "zero step": lambda: np.maximum(time, time[len(time) // 2]),
        "float32": lambda: time.astype("float32"),
    }.get(kind, lambda: time)()
    index = pd.MultiIndex.from_arrays([X.index.get_level_values("run"), new], names=["run", "time"])
    return _with_index(draw, X, y, index)


def _change_runs(draw: Any, X: Any, y: Any) -> Any:
    run = X.index.get_level_values("run").to_numpy().astype(object)
    rows = _some(draw, len(run))
    run[rows] = draw(st.sampled_from([None, np.nan, "", 0, 1.5, True, (1, 2), pd.NaT, pd.NA, "b"]))
    time = X.index.get_level_values("time")
    return _with_index(draw, X, y, pd.MultiIndex.from_arrays([run, time], names=["run", "time"]))


def _change_levels(draw: Any, X: Any, y: Any) -> Any:
    index = X.index
    kind = draw(
        st.sampled_from(["swap", "no run", "no time", "none", "names", "subject", "extra", "empty"])
    )
    if kind == "swap":
        index = index.swaplevel()
    elif kind == "no run":
        index = index.droplevel("run")
    elif kind == "no time":
        index = index.droplevel("time")
    elif kind == "none":
        index = pd.RangeIndex(len(X))
    elif kind == "names":
        names = st.sampled_from(["run", "time", None, "e", "trial", "Time", 0])
        index = index.set_names([draw(names), draw(names)])
    elif kind == "subject":
        index = pd.concat({"S1": X}, names=["subject"]).index
    elif kind == "extra":
        index = X.set_index(pd.Index(range(len(X)), name="sample"), append=True).index
    else:
        index = index[:0]
    return _with_index(draw, X, y, index)


def _with_index(draw: Any, X: Any, y: Any, index: Any) -> Any:
    if draw(st.integers(0, 3)):  # mostly of both
        y = y.set_axis(index)
    return X.set_axis(index), y


def _change_output(draw: Any, X: Any, y: Any) -> Any:
    n = len(y)
    new: Any = {
        "array": lambda: y.to_numpy(),
        "list": lambda: y.tolist(),
        "column": lambda: y.to_frame(),
        "two columns": lambda: pd.concat([y, y], axis=1),
        "2-D": lambda: y.to_numpy()[:, None],
        "3-D": lambda: y.to_numpy()[:, None, None],
        "none": lambda: None,
        "number": lambda: 1.0,
        "text": lambda: "u",
        "short": lambda: y.iloc[:-1],
        "empty": lambda: y.iloc[:0],
        "long": lambda: np.append(y, 0.0),
        "masked": lambda: np.ma.masked_array(y.to_numpy(), mask=np.arange(n) % 5 == 0),
        "constant": lambda: y * 0 + 3.0,
        "zero": lambda: y * 0,
        "huge": lambda: y * 1e150,
        "tiny": lambda: y * 1e-150,
        "shuffled": lambda: y.sample(frac=1, random_state=0),
        "named": lambda: y.rename(X.columns[0]),
        "dict": lambda: dict(enumerate(y)),
    }[draw(st.sampled_from(OUTPUTS))]()
    return X, new


OUTPUTS = [
    "array", "list", "column", "two columns", "2-D", "3-D", "none", "number", "text", "short",
    "empty", "long", "masked", "constant", "zero", "huge", "tiny", "shuffled", "named", "dict",
]  # fmt: skip


def _flat(draw: Any, X: Any, y: Any) -> Any:
    return X.reset_index(), y if draw(st.booleans()) else y.reset_index(drop=True)


def _no_columns(draw: Any, X: Any, y: Any) -> Any:
    return X.iloc[:, :0], y


FAULTS: dict[str, Any] = {
    "column": _change_column,
    "dtype": _change_dtype,
    "flat": _flat,
    "levels": _change_levels,
    "no columns": _no_columns,
    "objects": _objects,
    "output": _change_output,
    "put": _put,
    "put again": _put,
    "rename": _rename,
    "rows": _select_rows,
    "runs": _change_runs,
    "time": _change_time,
}


@st.composite
def arrays(draw: Any) -> Recording:
    """The same as arrays, of which the container may be odd."""
    recording = draw(good())
    X, y = recording.X.to_numpy(), recording.y.to_numpy()
    faults = draw(st.lists(st.sampled_from(sorted(CONTAINERS)), max_size=2, unique=True))
    for fault in sorted(faults, key="container".__eq__):  # what it makes is no array
        try:
            X, y = CONTAINERS[fault](draw, X, y)
        except (AttributeError, TypeError, ValueError, IndexError, KeyError, *ODD):
            continue
    return Recording(X, y, tuple(faults))


def _readonly(draw: Any, X: Any, y: Any) -> Any:
    X, y = X.copy(), y.copy()
    X.flags.writeable = y.flags.writeable = False
    return X, y


def _strided(draw: Any, X: Any, y: Any) -> Any:
    step = draw(st.sampled_from([-1, 2, 3]))
    return np.repeat(X, abs(step), axis=0)[::step], np.repeat(y, abs(step))[::step]


def _put_array(draw: Any, X: Any, y: Any) -> Any:
    value = draw(st.sampled_from([np.nan, np.nan, np.inf, 1e41, 1e-310]))
    rows = _some(draw, len(X))
    X, y = (part.astype(float) if part.dtype.kind in "iu" else part.copy() for part in (X, y))
    if draw(st.booleans()):
        y[rows] = value
    else:
        X[rows, 0] = value
    return X, y


def _array_dtype(draw: Any, X: Any, y: Any) -> Any:
    kinds = ["int8", "bool", "float16", "float32", ">f8", "longdouble", "complex64", "object"]
    kind = draw(st.sampled_from([*kinds, "U5", "S5", "M8[s]", "m8[ms]", "V8"]))
    return (X.astype(kind), y) if draw(st.booleans()) else (X, y.astype(kind))


def _shape(draw: Any, X: Any, y: Any) -> Any:
    kind = draw(st.sampled_from(["1-D", "3-D", "0-D", "rows", "columns", "wide", "transposed"]))
    new: Any = {
        "1-D": lambda: X[:, 0],
        "3-D": lambda: X[:, :, None],
        "0-D": lambda: np.array(1.0),
        "rows": lambda: X[:0],
        "columns": lambda: X[:, :0],
        "wide": lambda: np.tile(X, (1, 50)),
        "transposed": lambda: X.T,
    }[kind]()
    return new, y[: len(new)] if kind == "rows" else y


def _shown(X: np.ndarray) -> np.ndarray:
    """What pandas can write into a message: not bytes without a type."""
    return X.astype(object) if X.dtype.kind == "V" else X


def _container(draw: Any, X: Any, y: Any) -> Any:
    import pyarrow as pa
    import scipy.sparse

    new = draw(
        st.sampled_from(
            [
                np.asfortranarray,
                np.ndarray.tolist,
                lambda X: np.ma.masked_array(X, mask=np.abs(X) > 2),
                lambda X: np.ma.masked_array(X, mask=True),
                lambda X: pa.table({f"c{k}": X[:, k] for k in range(X.shape[1])}),
                scipy.sparse.csr_array,
                lambda X: pd.DataFrame(_shown(X)),
                lambda X: pd.Series(_shown(X)[:, 0]),
                lambda X: dict(enumerate(X.T)),
                lambda X: np.rec.fromarrays(list(X.T)),
            ]
        )
    )
    return new(X), y


CONTAINERS: dict[str, Any] = {
    "container": _container,
    "dtype": _array_dtype,
    "put": _put_array,
    "read-only": _readonly,
    "shape": _shape,
    "strided": _strided,
}
