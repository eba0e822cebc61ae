"""read_runs: every refusal says what, where, and what to do."""

import sys

import h5py
import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat
from scipy.io.matlab import MatlabFunction, MatlabObject
from support.mat5 import opaque

from skhoid import read_runs

T = np.arange(3) / 100
COLUMNS = {"t": T, "e": [1.0, 2.0, 3.0], "u": [4.0, 5.0, 6.0]}
ROLES = {"inputs": "e", "output": "u", "time": "t"}
MATLAB_OBJECT = "is a MATLAB object.*d.InputData.*d.OutputData.*d.SamplingInstants"


def fails(message, paths, error=ValueError, **changes):
    with pytest.raises(error, match=f"(?s){message}"):
        read_runs(paths, **(ROLES | changes))


def csv(folder, text, name="run.csv"):
    path = folder / name
    path.write_text(text)
    return path


class TestArguments:
    def test_clock(self, tmp_path, write):
        path = write(tmp_path, "csv", COLUMNS)
        fails("'t'.* or dt .*, not both", path, dt=0.01)
        for dt in (0, -1, np.nan, np.inf):
            fails("'dt' parameter of read_runs must be a float", path, time=None, dt=dt)

    def test_channels(self, tmp_path, write):
        path = write(tmp_path, "csv", COLUMNS)
        fails("inputs is empty", path, inputs=[])
        fails("output must name one channel", path, output={"e": "a", "u": "b"})
        fails("inputs must name channels by strings", path, TypeError, inputs=[0])
        fails("output must name channels by strings", path, TypeError, output=["u"])
        fails("channel 'e' is named more than once", path, inputs=["e", "e"])
        fails("channel 'u' is named more than once", path, inputs=["e", "u"])
        fails("units has 'f', which is not one of the channels.*'e'", path, units={"f": "deg"})

    def test_paths(self, tmp_path, write):
        path = write(tmp_path, "csv", COLUMNS)
        fails("paths is empty", [])
        fails("holds 3 .int.", [path, 3], TypeError)
        fails("no file .*absent.csv", tmp_path / "absent.csv", FileNotFoundError)
        fails(r"No file matches the pattern .*\*\.mat", f"{tmp_path}/*.mat", FileNotFoundError)
        (tmp_path / "empty").mkdir()
        fails("has no file that can be read", tmp_path / "empty", FileNotFoundError)
        fails("is named twice", [path, f"{path.parent}/*.csv"])
        other = tmp_path / "run.xls"
        other.write_bytes(b"\xd0\xcf\x11\xe0\0\0")
        fails(r"extension '.xls'; skhoid reads text and .csv.*\.mat", other)


class TestColumns:
    @pytest.mark.parametrize("kind", ["csv", "parquet", "mat5", "hdf5"])
    def test_missing_column(self, tmp_path, write, kind):
        path = write(tmp_path, kind, COLUMNS | {"Error": T})
        fails("run1.* has no .* 'eror'.*It has: .*'t'.*Did you mean 'Error'", path, inputs="eror")
        fails("has no .* 'clock'", path, time="clock")
        fails("has no .* 'label'", path, run="label")

    def test_duplicate_columns(self, tmp_path):
        fails("has 2 columns 'e'.*rename all but one", csv(tmp_path, "t,e,e,u\n0,1,2,3\n"))
        path = csv(tmp_path, "t,e [deg],e [rad],u\n0,1,2,3\n")
        fails(r"has 2 columns 'e'.*\['e \[deg\]', 'e \[rad\]'\]: name one", path)
        X, _ = read_runs(path, **(ROLES | {"inputs": "e [rad]"}))
        assert X["e"].to_list() == [2.0]

    @pytest.mark.parametrize("above", ["# subject 1\n", "Experiment 12\n\n", "% 1, run 2\n"])
    def test_lines_above_the_header(self, tmp_path, above):
        X, y = read_runs(csv(tmp_path, above + "t,e,u\n0,1,2\n"), **ROLES)
        assert (X["e"].to_list(), y.to_list()) == ([1.0], [2.0])

    @pytest.mark.parametrize(
        ("text", "advice"),
        [
            ("t,e,u\n0,a,1\n1,b,2\n", r"\(2 of 2 rows.*Name another column"),
            ("t,e,u\n0,1,2\n,,\n1,1,2\n", "missing in its row 2.*row is empty, delete it"),
            ('t,e,u\n0,"1,2\n1,1,2\n', r"run.csv.*quote \(\"\) in line 2 is closed only"),
            ('t,e,u,n\n0,1,2,"a\n1,1,2,a\n2,1,2,"a"\n', r"quote \(\"\) in line 2 is closed only"),
            ('t,e,u,"n\n0,1,2,a\n1,1,2,a"\n2,1,2,a\n', r"quote \(\"\) in line 1 is closed only"),
            ("t,e,u\n0,1,2\n\0\0\0\0", "run.csv has a zero byte"),
        ],
    )
    def test_advice(self, tmp_path, text, advice):
        fails(advice, csv(tmp_path, text))

    def test_not_numeric(self, tmp_path):
        path = csv(tmp_path, "t,e,u\n0,1,3\n1,,3\n2,off,4\n3,x,4\n")
        fails(r"'e' of .*run.csv is not numeric: row 3 .*'off' \(2 of 4 rows", path)
        fails(r"'e'.*row 1 .*'1,5'", csv(tmp_path, 't,e,u\n0,"1,5",3\n'))
        fails(r"'e'.*row 2 .*'1,000,5'", csv(tmp_path, "t;e;u\n0;1,5;3\n0;1,000,5;3\n"))
        fails(r"'e'.*row 3 .*'off' \(1 of 3", csv(tmp_path, "t;e;u\n0;1,5;3\n0;1;3\n0;off;3\n"))
        frame = pd.DataFrame(COLUMNS).assign(e=["1", "2", "a"])
        frame.to_parquet(tmp_path / "run.parquet")
        fails("'e' of .*parquet is not numeric: row 3 .*'a'", tmp_path / "run.parquet")
        savemat(tmp_path / "run.mat", COLUMNS | {"e": "text"})
        fails("'e' of .*mat is not numeric: row 1 .*'text'", tmp_path / "run.mat")

    def test_dates(self, tmp_path):
        dates = pd.to_datetime(["2020-01-01"] * 3)
        pd.DataFrame(COLUMNS).assign(e=dates).to_parquet(tmp_path / "run.parquet")
        fails("'e'.*holds dates .*total_seconds", tmp_path / "run.parquet")
        frame = pd.DataFrame(COLUMNS).assign(t=dates + pd.to_timedelta([0, 5, 10], "ms"))
        frame.to_parquet(tmp_path / "run.parquet")
        X, _ = read_runs(tmp_path / "run.parquet", **ROLES)
        assert X.index.get_level_values("time").to_list() == [0.0, 0.005, 0.01]

    def test_units(self, tmp_path):
        first = csv(tmp_path, "t,e [deg],u\n0,1,2\n", "a.csv")
        second = csv(tmp_path, "t,e [rad],u\n0,1,2\n", "b.csv")
        fails("'e' is 'deg' in .*a.csv and 'rad' in .*b.csv", [first, second])
        read_runs([first, second], **ROLES, units={"e": "deg"})
        fails("unit 'h' of the time.*not one of s, ", csv(tmp_path, "t [h],e,u\n0,1,2\n"))

    def test_missing_instant(self, tmp_path):
        path = csv(tmp_path, "r,t,e,u\n1,0,1,2\n2,0,1,2\n2,,1,2\n")
        fails("time of run 2 in .*run.csv is missing in its row 2", path, run="r")


class TestRuns:
    def test_same_label_in_two_files(self, tmp_path, write):
        (tmp_path / "b").mkdir()
        first = write(tmp_path, "csv", COLUMNS | {"r": [1, 1, 2]})
        second = write(tmp_path / "b", "csv", COLUMNS | {"r": [3, 2, 2]})
        X, _ = read_runs([first, second], **ROLES)
        assert list(X.index.unique("run")) == ["csv/run1", "b/csv/run1"]
        fails(f"labelled 2, {first} and {second}: give every run", [first, second], run="r")

    def test_not_contiguous(self, tmp_path, write):
        path = write(tmp_path, "csv", COLUMNS | {"r": ["a", "b", "a"]})
        fails("run 'a' in column 'r' .*not contiguous: .*row 1.*row 3", path, run="r")

    def test_missing_label(self, tmp_path, write):
        path = write(tmp_path, "csv", COLUMNS | {"r": [1, np.nan, 1]})
        fails("'r' .*has no run label in row 2", path, run="r")


class TestFiles:
    @pytest.mark.parametrize("name", ["run.csv", "run.mat"])
    def test_empty(self, tmp_path, name):
        path = tmp_path / name
        path.touch()
        fails(f"{name} is empty", path)

    def test_no_rows(self, tmp_path, write):
        for text in ("t,e,u", "t,e,u\n", "t,e,u\n\n"):
            fails("has a header but no rows", csv(tmp_path, text))
        for kind in ("parquet", "mat5"):
            fails("'e' .*has no samples", write(tmp_path, kind, {name: [] for name in "teu"}))
        path = tmp_path / "run.mat"
        with h5py.File(path, "w") as file:
            for name in "teu":
                # So does MATLAB: the data of an empty array are its shape.
                file[name] = np.zeros(2, dtype=np.uint64)
                file[name].attrs["MATLAB_empty"] = 1
        fails("'e' .*has no samples", path)

    def test_ragged_rows(self, tmp_path):
        fails("table of 3 columns separated by ','", csv(tmp_path, "t,e,u\n0,1,2\n0,1,2,3\n"))
        fails("table of 3 columns separated by ','", csv(tmp_path, "t,e,u\n0,1,2,3\n"))

    def test_no_header(self, tmp_path):
        fails("has no column 'e'.*'1', '2', '3'. It has no header", csv(tmp_path, "0,1,2\n1,2,3\n"))

    @pytest.mark.parametrize(
        ("name", "content"),
        [
            ("run.parquet", b"PAR1 and nothing else"),
            ("run.mat", b"something else" * 100),
            ("run.mat", b"\x89HDF\r\n\x1a\n" + bytes(600)),
        ],
    )
    def test_damaged(self, tmp_path, name, content):
        (tmp_path / name).write_bytes(content)
        fails(f"{name} cannot be read as", tmp_path / name)

    @pytest.mark.parametrize(("kind", "package"), [("parquet", "pyarrow"), ("hdf5", "h5py")])
    def test_missing_package(self, tmp_path, write, monkeypatch, kind, package):
        path = write(tmp_path, kind, COLUMNS)
        monkeypatch.setitem(sys.modules, package, None)
        fails(rf'{package}: pip install "skhoid\[io\]"', path, ImportError)


class TestMatlab:
    def test_lengths(self, tmp_path):
        path = write_mat(tmp_path, COLUMNS | {"u": [1.0, 2.0]})
        fails("variables differ in length, {'e': 3, 'u': 2, 't': 3}", path)
        path = write_mat(tmp_path, COLUMNS | {"r": [1.0, 1.0]})
        fails("differ in length, {'r': 2, 'the channels': 3}", path, run="r")

    def test_shapes(self, tmp_path):
        pair = np.ones((3, 2))
        path = write_mat(tmp_path, COLUMNS | {"u": pair})
        fails("different numbers of columns, {'e': 1, 'u': 2}", path)
        path = write_mat(tmp_path, COLUMNS | {"u": pair, "e": pair, "r": [1, 2, 3]})
        fails("columns of each variable are runs", path, run="r")
        path = write_mat(tmp_path, {"t": np.ones((3, 4)), "u": pair, "e": pair})
        fails("'t' .*has 4 columns, but the channels have 2", path)
        path = write_mat(tmp_path, {"t": T, "u": pair.T, "e": pair.T})
        fails("differ in length.*is it transposed", path)
        path = write_mat(tmp_path, COLUMNS | {"e": np.ones((3, 2, 2))})
        fails(r"'e' .*has the shape \(3, 2, 2\)", path)

    def test_structs_and_cells(self, tmp_path):
        cell = np.array([T, T], dtype=object)
        array = np.zeros((1, 2), dtype=[("e", object)])
        path = write_mat(tmp_path, COLUMNS | {"s": {"e": T}, "c": cell, "a": array})
        fails("'s' is a struct: .*such as s.e", path, inputs="s")
        fails("has no variable 's.f'.*'s.e'", path, inputs="s.f")
        fails("'c' is a cell array", path, inputs="c")
        fails("'a.e' is a struct array", path, inputs="a.e")

    def test_old_objects_and_functions_of_v5(self, tmp_path, monkeypatch):
        fields = np.array([[(T,)]], dtype=[("expr", object)])
        path = write_mat(tmp_path, COLUMNS | {"d": MatlabObject(fields, "iddata")})
        fails(f"'d' {MATLAB_OBJECT}", path, inputs="d.expr")
        # SciPy reads functions but does not write them.
        content = {"f": MatlabFunction(fields)}
        monkeypatch.setattr("scipy.io.loadmat", lambda _: content)
        fails("'f' is a function handle", path, inputs="f")

    def test_opaque_object_of_v5(self, tmp_path):
        path = write_mat(tmp_path, COLUMNS)
        with path.open("ab") as file:
            file.write(opaque(b"d", b"iddata"))
        fails(f"'d' {MATLAB_OBJECT}", path, inputs="d")
        fails(f"'d' {MATLAB_OBJECT}", path, inputs="d.InputData")
        fails(f"has no variable 'f'.*also has 'd', which {MATLAB_OBJECT}", path, inputs="f")
        read_runs(path, **ROLES)

    def test_what_is_not_an_array_in_v73(self, tmp_path):
        path = tmp_path / "run.mat"
        classes = {"d": "iddata", "c": "cell", "w": "char", "f": "function_handle", "n": "string"}
        with h5py.File(path, "w") as file:
            for name, matlab_class in classes.items():
                file[name] = np.zeros((1, 6), dtype=np.uint32)
                file[name].attrs["MATLAB_class"] = np.bytes_(matlab_class)
            file["d"].attrs["MATLAB_object_decode"] = 3
            file["#refs#/a"] = T
            file["s/e"] = T
            file["s/u"] = T
            file["sparse/data"] = T
            file["sparse"].attrs["MATLAB_sparse"] = 3
            references = file.create_dataset("array/e", (2,), dtype=h5py.ref_dtype)
            references[0] = file["#refs#/a"].ref
        fails(f"'d' {MATLAB_OBJECT}", path, inputs="d.InputData")
        fails(r"'n' is a MATLAB object \(string\).*cellstr\(n\)", path, inputs="n")
        fails("'c' is a cell array", path, inputs="c")
        fails("'f' is a function handle", path, inputs="f")
        fails("'s' is a struct: .*such as s.e", path, inputs="s")
        fails("'array.e' is a struct array", path, inputs="array.e")
        fails(r"'sparse' is sparse: save full\(sparse\)", path, inputs="sparse")
        fails("has no variable 'x'. It has: .*'s.e'.*The file also has 'd'", path, inputs="x")


def write_mat(folder, variables):
    path = folder / "run.mat"
    savemat(path, variables)
    return path


def test_a_damaged_page_of_a_parquet_file(tmp_path):
    path = tmp_path / "run1.parquet"
    pd.DataFrame({"t": [0.0, 0.01], "e": [1.5, 2.5], "u": [0.5, 0.25]}).to_parquet(path)
    content = bytearray(path.read_bytes())
    content[4:60] = b"\xff" * 56  # the first page; the schema stands at the end
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"run1\.parquet cannot be read as Parquet"):
        read_runs(path, inputs="e", output="u", time="t")


def test_a_text_that_ends_inside_a_character(tmp_path):
    path = tmp_path / "run1.csv"
    path.write_bytes("t,e,u\n0,1,2\n0.01,1,2\nÚ".encode("cp1252"))
    _, y = read_runs(path, inputs="e", output="u", time="t")
    assert len(y) == 2
