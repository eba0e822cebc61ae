"""Columns read block by block are those that pandas' own inference reads, bit for bit."""

import sys

import numpy as np
import pandas as pd
import pytest

from skhoid import read_runs
from skhoid.io import delimited
from skhoid.io.files import as_numbers

NUMBERS = ["1", "-1", ".5", "5.", "-.5", "1e5", "1E+5", "1e-5", "1e400", "-1e400", "1e-400"]
NUMBERS += ["5e-324", "2.4703282292062327e-324", "2.4703282292062328e-324", "1e23", "8.5e-17"]
NUMBERS += ["2.2250738585072011e-308", "1.7976931348623157e308", "1.7976931348623159e308"]
NUMBERS += ["9007199254740993", "9007199254740992.50000000000000000000001", "0.30000000000000004"]
NUMBERS += ["-9223372036854775809", "-0.0", "00012", "inf", "-Infinity"]
NUMBERS += ["0." + "0" * 400 + "1", "3.14159265358979323846264338327950288419716939937510", "7 "]
MISSING = ["", "NaN", "nan", "-nan", "NA", "n/a", "null", "None", "<NA>", "#N/A", " ", " NaN"]
STRANGE = ["+1", "+.5", "True", "NAN", "Nan", "nan(1)", "1_000", "0x1A", "1d5", "1 2", "--1"]
STRANGE += ["1.2.3", "1e", "e5", "١", "1f", "#1", '"2"', '"2']


def read_by(monkeypatch, path, reader):
    """A column of numbers by one of the readers; None if it leaves the file to inference."""
    with monkeypatch.context() as patch:
        if reader == "pandas":
            patch.setitem(sys.modules, "pyarrow.csv", None)
        else:
            patch.setattr(delimited, "_by_pandas", delimited._by_arrow)
        found = delimited.plain_columns(sheet_of(path), [1], None)
    return None if found is None else found[0][0]


def sheet_of(path):
    return delimited._sheet(delimited.survey(path))


def inferred(path):
    try:
        return as_numbers(sheet_of(path).column(1), "it")
    except ValueError:
        return None


@pytest.mark.parametrize("reader", ["arrow", "pandas"])
def test_cells_are_read_as_by_inference_or_not_at_all(tmp_path, monkeypatch, reader):
    path = tmp_path / "run.csv"
    for cell in [*NUMBERS, *MISSING, *STRANGE]:
        path.write_text(f"t,e\n0,{cell}\n1,0.5\n2,\n", encoding="utf-8")
        found, expected = read_by(monkeypatch, path, reader), inferred(path)
        if found is not None:
            assert expected is not None, cell
            assert found.tobytes() == expected.tobytes(), cell
        elif cell in NUMBERS or cell in MISSING[:10]:
            pytest.fail(f"{cell} is left to inference")


def digits(seed, n):
    """Numbers of up to 25 digits with exponents, half way between two floats or nearly so."""
    rng = np.random.default_rng(seed)
    between = [
        f"{int(m) * 2 + 1}e{e}"
        for m, e in zip(rng.integers(2**52, 2**53, n), rng.integers(-40, 40, n), strict=True)
    ]
    return [
        *between,
        *(repr(float(x)) for x in rng.standard_normal(n) * 10.0 ** rng.integers(-300, 300, n)),
    ]


@pytest.mark.parametrize("reader", ["arrow", "pandas"])
def test_numbers_are_rounded_as_python_does(tmp_path, monkeypatch, reader):
    cells = digits(0, 500)
    path = tmp_path / "run.csv"
    path.write_text("t,e\n" + "".join(f"0,{cell}\n" for cell in cells))
    found = read_by(monkeypatch, path, reader)
    assert found.tobytes() == np.array([float(cell) for cell in cells]).tobytes()


@pytest.mark.parametrize("reader", ["arrow", "pandas"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize(
    ("above", "separator", "decimal"),
    [("", ",", "."), ("\n\n", ";", ","), ("", "\t", "."), ("\ufeff", ";", ".")],
)
def test_forms_of_files(tmp_path, monkeypatch, reader, end, above, separator, decimal):
    rows = ["t,e", "0,1.5", "1,2.25", "", "2,-3.125"]
    text = "\n".join(row.replace(",", separator).replace(".", decimal) for row in rows)
    path = tmp_path / "run.csv"
    path.write_bytes((above + text).replace("\n", end).encode())
    np.testing.assert_array_equal(read_by(monkeypatch, path, reader), [1.5, 2.25, -3.125])
    np.testing.assert_array_equal(inferred(path), [1.5, 2.25, -3.125])


@pytest.mark.parametrize("reader", ["arrow", "pandas", "inference"])
@pytest.mark.parametrize(
    ("cells", "labels"),
    [
        (["1", "1", "02"], [1, 1, 2]),
        (["1.0", "1", "2.5"], [1.0, 1.0, 2.5]),
        (["b", " b ", "a"], ["b", "b", "a"]),
        (["True", "True", "False"], [True, True, False]),
        (
            ["20240101123456789", "20240101123456788", "1"],
            [20240101123456789, 20240101123456788, 1],
        ),
        (["1", "a", "x y"], ["1", "a", "x y"]),
    ],
)
def test_labels(tmp_path, monkeypatch, cells, labels, reader):
    path = tmp_path / "run.csv"
    path.write_text("r,t,e,u\n" + "".join(f"{c},{i},1,2\n" for i, c in enumerate(cells)))
    if reader == "pandas":
        monkeypatch.setitem(sys.modules, "pyarrow.csv", None)
    elif reader == "inference":
        monkeypatch.setattr("skhoid.io.delimited.plain_columns", lambda *_: None)
    X, _ = read_runs(path, inputs="e", output="u", time="t", run="r")
    found = X.index.get_level_values("run").to_list()
    assert found == labels
    assert list(map(type, found)) == list(map(type, labels))


@pytest.mark.parametrize("reader", ["arrow", "pandas"])
def test_blocks_join(tmp_path, monkeypatch, reader):
    rng = np.random.default_rng(0)
    frame = pd.DataFrame(
        {"run": np.repeat(["a", "b", "c"], 400), "t": np.tile(np.arange(400) / 8, 3)}
    )
    frame = frame.assign(e=rng.standard_normal(1200), u=rng.standard_normal(1200))
    frame.to_csv(tmp_path / "runs.csv", index=False)
    monkeypatch.setattr(delimited, "_BYTES", 1000)
    monkeypatch.setattr(delimited, "_ROWS", 7)
    monkeypatch.setattr("skhoid.io.archives._ROWS", 7)
    if reader == "pandas":
        monkeypatch.setitem(sys.modules, "pyarrow.csv", None)
    else:
        monkeypatch.setattr(delimited, "_by_pandas", None)
    frame.to_parquet(tmp_path / "runs.parquet")
    expected = frame.set_index(["run", "t"])
    for name in ("runs.csv", "runs.parquet"):
        X, y = read_runs(tmp_path / name, inputs="e", output="u", time="t", run="run")
        np.testing.assert_array_equal(X["e"], expected["e"])
        np.testing.assert_array_equal(y, expected["u"])
        assert X.index.rename(["run", "t"]).equals(expected.index)


def test_a_long_row_far_down_is_named(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("t,e,u\n" + "0,1,2\n" * 5000 + "0,1,2,3\n" + "0,1,2\n" * 10)
    with pytest.raises(ValueError, match="line 5002 has 4 cells"):
        read_runs(path, inputs="e", output="u", time="t")


def test_what_was_read_may_be_changed_apart(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("t,a\n0,1\n1,2\n")
    X, y = read_runs(path, inputs={"a": "e"}, output={"a": "u"}, time="t")
    X.iloc[0, 0] = 7.0
    y.iloc[1] = 8.0
    assert (X["e"].to_list(), y.to_list()) == ([7.0, 2.0], [1.0, 8.0])


def test_a_named_regular_index_of_parquet(tmp_path):
    frame = pd.DataFrame({"e": [1.0, 2.0], "u": [3.0, 4.0]}, pd.RangeIndex(0, 20, 10, name="time"))
    frame.to_parquet(tmp_path / "run.parquet")
    X, _ = read_runs(
        tmp_path / "run.parquet", inputs="e", output="u", time="time", units={"time": "ms"}
    )
    assert X.index.get_level_values("time").to_list() == [0.0, 0.01]


def test_big_labels_of_parquet_stay_apart(tmp_path):
    labels = [2**60, 2**60 + 1]
    pd.DataFrame({"r": labels, "e": [1.0, 2.0], "u": [3.0, 4.0]}).to_parquet(tmp_path / "a.parquet")
    X, _ = read_runs(tmp_path / "a.parquet", inputs="e", output="u", dt=1.0, run="r")
    assert X.index.get_level_values("run").to_list() == labels
