"""read_runs: what comes out is what was written, in every format."""

import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pandas.testing import assert_frame_equal, assert_series_equal
from scipy.io import savemat

from skhoid import read_runs

KINDS = ["csv", "semicolon", "parquet", "mat5", "hdf5"]
T = np.arange(5) / 100
E = np.array([1.5, -2.25, np.nan, 1e-3, 12.0])
U = np.array([0.1, 0.2, 0.3, -0.4, 1 / 3])
ROLES = {"inputs": "e", "output": "u", "time": "t"}


def assert_same(read, expected):
    assert_frame_equal(read[0], expected[0], check_exact=True)
    assert_series_equal(read[1], expected[1], check_exact=True)
    assert read[0].attrs == expected[0].attrs
    assert read[1].attrs == expected[1].attrs


@pytest.mark.parametrize("kind", KINDS)
def test_one_file_is_one_run(tmp_path, write, kind):
    path = write(tmp_path, kind, {"t": T, "e": E, "u": U, "other": U})
    X, y = read_runs(path, **ROLES)
    assert X.index.names == ["run", "time"]
    assert X.index.get_level_values("run").unique().to_list() == ["run1"]
    np.testing.assert_array_equal(X.index.get_level_values("time"), T)
    assert X.columns.to_list() == ["e"]
    assert X.dtypes.to_list() == [np.float64]
    np.testing.assert_array_equal(X["e"], E)
    np.testing.assert_array_equal(y, U)
    assert y.name == "u"
    assert X.index.equals(y.index)
    assert X.attrs == {"units": {}}


@pytest.mark.parametrize("kind", KINDS)
def test_run_column(tmp_path, write, kind):
    columns = {"subject_run": [7, 7, 3, 3, 3], "t": [0, 0.1, 0, 0.1, 0.2], "e": E, "u": U}
    path = write(tmp_path, kind, columns)
    X, _ = read_runs(path, run="subject_run", **ROLES)
    assert X.index.get_level_values("run").to_list() == [7, 7, 3, 3, 3]
    X, _ = read_runs(path, run="subject_run", inputs="e", output="u", dt=0.5)
    assert X.index.get_level_values("time").to_list() == [0, 0.5, 0, 0.5, 1.0]


finite = st.floats(allow_infinity=False, allow_nan=True, width=64)


@pytest.mark.slow
@given(data=arrays(np.float64, st.tuples(st.integers(2, 12), st.just(2)), elements=finite))
@settings(deadline=None, max_examples=40)
def test_formats_agree(write, data):
    columns = {"t": np.arange(len(data)) / 100, "e": data[:, 0], "u": data[:, 1]}
    with tempfile.TemporaryDirectory() as folder:
        read = [read_runs(write(Path(folder), kind, columns), **ROLES) for kind in KINDS]
    np.testing.assert_array_equal(read[0][0]["e"], data[:, 0])
    np.testing.assert_array_equal(read[0][1], data[:, 1])
    for other in read[1:]:
        assert_same(other, read[0])


def test_parquet_of_skhoid_frame_round_trips(tmp_path, write):
    X, y = read_runs(write(tmp_path, "csv", {"t [s]": T, "e [deg]": E, "u (N m)": U}), **ROLES)
    frame = X.assign(u=y)
    frame.attrs["units"] = X.attrs["units"] | y.attrs["units"]
    path = tmp_path / "all.parquet"
    frame.to_parquet(path)
    assert_same(read_runs(path, inputs="e", output="u", time="time", run="run"), (X, y))


def test_parquet_types(tmp_path):
    frame = pd.DataFrame({"r": pd.Categorical(["b", "b", "a"]), "e": ["1", None, "2.5"]})
    frame["u"] = pd.array([1, None, 3], dtype="Int64")
    frame.to_parquet(tmp_path / "run.parquet")
    X, y = read_runs(tmp_path / "run.parquet", inputs="e", output="u", dt=1, run="r")
    assert X.index.to_list() == [("b", 0), ("b", 1), ("a", 0)]
    np.testing.assert_array_equal(X["e"], [1, np.nan, 2.5])
    np.testing.assert_array_equal(y, [1, np.nan, 3])


def test_several_files_patterns_and_order(tmp_path, write):
    for stem in ("run10", "run2", "run1"):
        write(tmp_path, "csv", {"t": T, "e": E, "u": U}, stem=stem)
    X, _ = read_runs(str(tmp_path / "csv" / "run*.csv"), **ROLES)
    assert X.index.get_level_values("run").unique().to_list() == ["run1", "run2", "run10"]
    X, _ = read_runs((tmp_path / "csv" / f"run{k}.csv" for k in (10, 1)), **ROLES)
    assert X.index.get_level_values("run").unique().to_list() == ["run10", "run1"]
    bracketed = write(tmp_path, "csv", {"t": T, "e": E, "u": U}, stem="a[1]")
    X, _ = read_runs(str(bracketed), **ROLES)
    assert X.index.get_level_values("run")[0] == "a[1]"


def test_rows_are_left_as_they_are(tmp_path, write):
    time = [0.3, 0.1, 0.1, 9.0, 0.2]
    X, _ = read_runs(write(tmp_path, "csv", {"t": time, "e": E, "u": U}), **ROLES)
    assert X.index.get_level_values("time").to_list() == time


def test_renaming(tmp_path, write):
    path = write(tmp_path, "csv", {"t": T, "err": E, "stick [V]": U, "pos": U})
    X, y = read_runs(path, inputs={"pos": "x", "err": "e"}, output={"stick": "u"}, time="t")
    assert X.columns.to_list() == ["x", "e"]
    assert y.name == "u"
    assert y.attrs["units"] == {"u": "V"}
    # The same column may serve twice under two names.
    X, y = read_runs(path, inputs={"pos": "x"}, output={"pos": "u"}, dt=0.01)
    np.testing.assert_array_equal(X["x"], y)


@pytest.mark.parametrize(
    ("header", "units", "factor"),
    [
        ("t [ms]", None, 1000),
        ("t (ms)", None, 1000),
        ("t", {"time": "ms"}, 1000),
        ("t", {"t": "us"}, 1e6),
        ("t [ms]", {"time": "s"}, 1),
        ("t [s]", None, 1),
        ("t", None, 1),
    ],
)
def test_time_in_seconds(tmp_path, write, header, units, factor):
    path = write(tmp_path, "csv", {header: [0, 10, 25], "e": [1, 2, 3], "u": [1, 2, 3]})
    for time in ("t", header):
        X, _ = read_runs(path, inputs="e", output="u", time=time, units=units)
        expected = np.array([0, 10, 25]) / factor
        np.testing.assert_array_equal(X.index.get_level_values("time"), expected)


def test_units_of_channels(tmp_path, write):
    path = write(tmp_path, "csv", {"e [deg]": E, "x (cm/s)": U, "run (2)": U, "u": U, "z [-]": U})
    X, y = read_runs(
        path,
        inputs=["e [deg]", "x", "run (2)", "z"],
        output="u",
        dt=0.01,
        units={"x": "m", "u": "V"},
    )
    assert X.columns.to_list() == ["e", "x", "run (2)", "z"]
    assert X.attrs["units"] == {"e": "deg", "x": "m", "z": "-"}
    assert y.attrs["units"] == {"u": "V"}


class TestText:
    def read(self, folder, content, **kwargs):
        path = folder / "run.csv"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return read_runs(path, **({"inputs": "e", "output": "u", "dt": 0.01} | kwargs))

    @pytest.mark.parametrize("separator", [",", ";", "\t", ", ", " ;"])
    def test_separators(self, tmp_path, separator):
        rows = [["e [deg]", "u"], ["1.5", ""], ["-2e-3", "NaN"]]
        X, y = self.read(tmp_path, "\n".join(separator.join(row) for row in rows) + "\n")
        assert X["e"].to_list() == [1.5, -0.002]
        assert y.isna().all()

    @pytest.mark.parametrize("separator", [";", "\t"])
    def test_decimal_comma(self, tmp_path, separator):
        rows = [["e", "u", "note"], ["1,5", "1", "a,b"], ["-2,25e-1", "2", "c.d"], ["", ",5", ""]]
        X, y = self.read(tmp_path, "\n".join(separator.join(row) for row in rows))
        np.testing.assert_array_equal(X["e"], [1.5, -0.225, np.nan])
        assert y.to_list() == [1, 2, 0.5]

    def test_exponent_without_point_is_not_ambiguous(self, tmp_path):
        X, y = self.read(tmp_path, "e;u\n1,5;1e-06\n2e-3;2\n")
        assert X["e"].to_list() == [1.5, 0.002]
        assert y.to_list() == [1e-6, 2]

    def test_commas_and_points_are_ambiguous(self, tmp_path):
        with pytest.raises(ValueError, match=r"'e' has commas .*'1,5'.* 'e' has points"):
            self.read(tmp_path, "e;u\n1,5;1\n2.5;2\n")
        with pytest.raises(ValueError, match=r"'e' has commas .*'1,234'.* 'u' has points"):
            self.read(tmp_path, "e;u\n1,234;0.5\n2,345;0.25\n")

    @pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252", "utf-16"])
    def test_encodings(self, tmp_path, encoding):
        X, _ = self.read(tmp_path, "\r\ne [°],u\r\n1,2\r\n".lstrip().encode(encoding))
        assert X.attrs["units"] == {"e": "°"}

    @pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
    def test_newlines(self, tmp_path, newline):
        X, _ = self.read(tmp_path, newline.join(["e,u", "1,2", "3,4", ""]))
        assert X["e"].to_list() == [1, 3]

    def test_blank_lines_and_quotes(self, tmp_path):
        X, y = self.read(tmp_path, '\n\n"e","u"\n1,2\n\n3,4\n\n')
        assert X["e"].to_list() == [1, 3]
        assert y.to_list() == [2, 4]


class TestMatlab:
    def test_orientation_of_vectors(self, tmp_path, write_mat73):
        variables = {"t": T[None, :], "e": E[:, None], "u": U[None, :]}
        savemat(tmp_path / "v5.mat", variables)
        write_mat73(tmp_path / "v73.mat", variables)
        for name in ("v5", "v73"):
            X, y = read_runs(tmp_path / f"{name}.mat", **ROLES)
            np.testing.assert_array_equal(X["e"], E)
            np.testing.assert_array_equal(y, U)

    def test_fields_of_structs(self, tmp_path, write_mat73):
        variables = {"data": {"e": E[:, None], "log": {"u": U[:, None]}}, "t": T[:, None]}
        savemat(tmp_path / "v5.mat", variables)
        write_mat73(tmp_path / "v73.mat", variables)
        for name in ("v5", "v73"):
            X, y = read_runs(
                tmp_path / f"{name}.mat", inputs={"data.e": "e"}, output="data.log.u", time="t"
            )
            np.testing.assert_array_equal(X["e"], E)
            assert y.name == "u"

    def test_names_of_fields(self, tmp_path):
        """Roles are taken from names, so a field has its own; two of one name keep their paths."""
        savemat(tmp_path / "a.mat", {"d": {"e": E, "u": U, "x": E}, "k": {"x": U}, "t": T})
        given = {"output": "d.u", "time": "t", "units": {"d.e": "deg"}}
        X, y = read_runs(tmp_path / "a.mat", inputs=["d.e", "d.x", "k.x"], **given)
        assert [*X.columns, y.name] == ["e", "d.x", "k.x", "u"]
        assert X.attrs["units"] == {"e": "deg"}
        renamed, _ = read_runs(tmp_path / "a.mat", inputs={"d.e": "d.e"}, **given)
        assert list(renamed) == ["d.e"]
        pd.DataFrame({"d.e": E, "t": T, "d.u": U}).to_csv(tmp_path / "a.csv", index=False)
        X, y = read_runs(tmp_path / "a.csv", inputs="d.e", **given)
        assert [*X.columns, y.name] == ["d.e", "d.u"]  # names of columns stay as they are

    @pytest.mark.parametrize("shared", [True, False])
    def test_matrix_columns_are_runs(self, tmp_path, write_mat73, shared):
        e, u = np.arange(15.0).reshape(5, 3), np.arange(15.0, 30.0).reshape(5, 3)
        t = T[:, None] if shared else T[:, None] + [[0, 1, 2]]
        savemat(tmp_path / "v5.mat", {"t": t, "e": e, "u": u})
        write_mat73(tmp_path / "v73.mat", {"t": t, "e": e, "u": u})
        for name in ("v5", "v73"):
            X, y = read_runs(tmp_path / f"{name}.mat", **ROLES)
            labels = X.index.get_level_values("run").unique().to_list()
            assert labels == [f"{name}-1", f"{name}-2", f"{name}-3"]
            for k, label in enumerate(labels):
                np.testing.assert_array_equal(X.loc[label, "e"], e[:, k])
                np.testing.assert_array_equal(y.loc[label], u[:, k])
                np.testing.assert_array_equal(X.loc[label].index, t[:, 0 if shared else k])

    def test_text_labels(self, tmp_path):
        cells = np.array(["first", "first", "b", "b", "b"], dtype=object)[:, None]
        chars = np.array(["first", "first", "b", "b", "b"])
        for name, labels in (("cells", cells), ("chars", chars)):
            savemat(tmp_path / f"{name}.mat", {"t": T, "e": E, "u": U, "label": labels})
            X, _ = read_runs(tmp_path / f"{name}.mat", run="label", **ROLES)
            assert X.index.get_level_values("run").unique().to_list() == ["first", "b"]

    def test_integers_and_sparse(self, tmp_path):
        from scipy.sparse import csc_array

        variables = {"e": np.array([[1], [2]], dtype=np.int16), "u": csc_array([[0.0], [3.0]])}
        savemat(tmp_path / "r.mat", variables)
        X, y = read_runs(tmp_path / "r.mat", inputs="e", output="u", dt=1)
        assert X["e"].to_list() == [1.0, 2.0]
        assert y.to_list() == [0.0, 3.0]
