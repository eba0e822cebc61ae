"""Files as they may be: what pandas reads is read, all else is refused by the file's name."""

import csv
from pathlib import Path
from tempfile import TemporaryDirectory

import h5py
import numpy as np
import pandas as pd
from hypothesis import strategies as st
from support.fuzzing import fuzz, outcome
from support.hostile import good

from skhoid import read_runs, write_runs

CELLS = [
    "0",
    "1",
    "-2.5",
    "1e3",
    "",
    "NaN",
    "nan",
    "NA",
    "inf",
    "-inf",
    "1,5",
    "1.000,5",
    "x",
    "1e400",
]
ODD_CELLS = [
    '"1"',
    '"',
    "#",
    "0x1F",
    "1_000",
    "\u221e",
    "\x00",
    " 3 ",
    "1;2",
    "\t",
    "'",
    "1d5",
    "9" * 400,
]
NUMBERS = st.floats(allow_nan=True, allow_infinity=False, width=64)
ENCODINGS = [
    "utf-8",
    "utf-8-sig",
    "utf-16",
    "utf-16-le",
    "utf-32",
    "latin-1",
    "cp1252",
    "utf-32-be",
]


def check_read(path, **names):
    """What a file holds as runs, or None where it is refused, by a message that names it."""
    found, error = outcome(read_runs, path, **names)
    if error is not None:
        assert Path(path).name in str(error), error
        return None
    X, y = found
    assert list(X.index.names) == ["run", "time"]
    assert len(X) == len(y)
    assert {dtype.name for dtype in X.dtypes} == {"float64"}
    assert y.dtype == float
    return X, y


@st.composite
def tables(draw):
    """Text with rows of numbers, and lines that are none."""
    separator = draw(st.sampled_from([",", ";", "\t", " ", "|"]))
    header = draw(
        st.sampled_from(
            [["t", "e", "u"], ["t [ms]", "e [deg]", "u"], ["t", "e"], ["e", "e", "u"],
             ["0", "1", "2"], ["t", "e", "u", ""], ["# t", "e", "u"], [" t", "e ", "u"],
             ['"t"', '"e"', '"u"']]
        )
    )  # fmt: skip
    cells = st.sampled_from(CELLS) | st.sampled_from(ODD_CELLS) | st.floats().map(repr)
    lines = [separator.join(header)]
    for k in range(draw(st.integers(0, 6))):
        row = [str(k * 0.01), *draw(st.lists(st.sampled_from(CELLS[:4]), min_size=2, max_size=2))]
        if not draw(st.integers(0, 3)):
            row = draw(st.lists(cells, max_size=5))
        lines.append(separator.join(row))
    odd = st.sampled_from(["", "# no", "   ", ",,,", "deg;deg;deg", '"', "\x00", "a" * 10**5])
    for line in draw(st.lists(odd, max_size=2)):
        lines.insert(draw(st.integers(0, len(lines))), line)
    return draw(st.sampled_from(["\n", "\n", "\r\n", "\r"])).join(lines) + draw(
        st.sampled_from(["", "\n"])
    )


@fuzz(
    text=tables() | st.text(),
    encoding=st.sampled_from(ENCODINGS),
    suffix=st.sampled_from([".csv", ".tsv", ".txt"]),
)
def test_text(text, encoding, suffix):
    with TemporaryDirectory() as folder:
        path = Path(folder, f"drawn{suffix}")
        path.write_bytes(text.encode(encoding, "replace"))
        check_read(path, inputs="e", output="u", time="t")
        check_read(path, inputs="e", output="u", dt=0.01)


@fuzz(data=st.data())
def test_numbers_that_pandas_wrote(data):
    n = data.draw(st.integers(1, 8))
    columns = {name: data.draw(st.lists(NUMBERS, min_size=n, max_size=n)) for name in "eu"}
    frame = pd.DataFrame({"t": 0.01 * np.arange(n), **columns})
    separator, decimal = data.draw(
        st.sampled_from([(",", "."), (";", "."), (";", ","), ("\t", ",")])
    )
    quoting = data.draw(st.sampled_from([csv.QUOTE_MINIMAL, csv.QUOTE_ALL, csv.QUOTE_NONNUMERIC]))
    ends = data.draw(st.sampled_from(["\n", "\r\n"]))
    text = frame.to_csv(
        index=False, sep=separator, decimal=decimal, quoting=quoting, lineterminator=ends
    )
    with TemporaryDirectory() as folder:
        path = Path(folder, "drawn.csv")
        path.write_bytes(text.encode(data.draw(st.sampled_from(ENCODINGS[:3]))))
        read = check_read(path, inputs="e", output="u", time="t")
    if read is None:  # few rows, or cells that are no plain numbers, may leave the layout open
        size = frame[["e", "u"]].abs()
        plain = (size == 0) | ((size > 1e-15) & (size < 1e15))
        assert n < 3 or not plain.to_numpy().all()
        return
    X, y = read
    np.testing.assert_array_equal(X["e"], frame["e"])
    np.testing.assert_array_equal(y, frame["u"])


@fuzz(recording=good(min_runs=1), suffix=st.sampled_from([".csv", ".tsv", ".parquet", ".mat"]))
def test_round_trip(recording, suffix):
    X, y = recording.X, recording.y
    with TemporaryDirectory() as folder:
        path = Path(folder, f"runs{suffix}")
        _, error = outcome(write_runs, X, y, path)
        if error is not None:  # runs of several lengths are no matrix, single rows have no rate
            assert suffix == ".mat" or X.groupby("run").size().max() == 1
            assert list(Path(folder).iterdir()) == []
            return
        run = {} if suffix == ".mat" else {"run": "run"}
        names = list(X.columns)
        again, output = check_read(path, inputs=names, output="u", time="time", **run)
    np.testing.assert_array_equal(again, X)
    np.testing.assert_array_equal(output, y)
    time = X.index.get_level_values("time")
    np.testing.assert_array_equal(again.index.get_level_values("time"), time)


def _written(suffix):
    """The bytes of a good file."""
    index = pd.MultiIndex.from_product([["a", "b"], 0.01 * np.arange(20)], names=["run", "time"])
    rng = np.random.default_rng(0)
    X = pd.DataFrame({"e": rng.standard_normal(40)}, index=index)
    y = pd.Series(rng.standard_normal(40), index=index, name="u")
    with TemporaryDirectory() as folder:
        if suffix == ".h5.mat":
            path = Path(folder, "runs.mat")
            with h5py.File(path, "w", userblock_size=512) as file:
                for name, values in (("e", X["e"]), ("u", y)):
                    file[name] = values.to_numpy().reshape(2, 20)
                    file[name].attrs["MATLAB_class"] = np.bytes_(b"double")
                file["time"] = 0.01 * np.arange(20)[None]
            with path.open("r+b") as file:
                file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
        else:
            path = Path(folder, f"runs{suffix}")
            write_runs(X, y, path)
        return path.read_bytes()


# SciPy's reader of version 5 of MATLAB ends the process on some damaged files.
GOOD = {suffix: _written(suffix) for suffix in (".csv", ".parquet", ".h5.mat")}


@st.composite
def damaged(draw):
    """A good file of which some bytes are changed, left out or put in."""
    suffix = draw(st.sampled_from(sorted(GOOD)))
    content = bytearray(GOOD[suffix])
    for _ in range(draw(st.integers(1, 4))):
        place = draw(
            st.integers(0, max(len(content) - 1, 0)) | st.integers(0, min(700, len(content)))
        )
        kind = draw(st.sampled_from(["change", "change", "cut", "remove", "insert", "zeros"]))
        some = draw(st.binary(min_size=1, max_size=8))
        if kind == "change":
            content[place : place + len(some)] = some
        elif kind == "cut":
            del content[place:]
        elif kind == "remove":
            del content[place : place + len(some)]
        elif kind == "insert":
            content[place:place] = some
        else:
            content[place : place + 64] = bytes(64)
    return suffix, bytes(content)


@fuzz(file=damaged())
def test_damaged_bytes(file):
    suffix, content = file
    with TemporaryDirectory() as folder:
        path = Path(folder, f"drawn{suffix}")
        path.write_bytes(content)
        run = {} if suffix.endswith(".mat") else {"run": "run"}
        check_read(path, inputs="e", output="u", time="time", **run)
