"""read_runs: what comes out is what was written, in every format."""

import numpy as np
import pandas as pd
import pytest
from pandas.testing import assert_frame_equal, assert_series_equal
from scipy.io import savemat

from skhoid import read_runs, write_runs

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


def test_numbers_are_those_of_python_in_every_format(tmp_path, write):
    rng = np.random.default_rng(0)
    half_way = [
        float(f"{int(m) * 2 + 1}e{e}")  # half way between two floats, or nearly so
        for m, e in zip(rng.integers(2**52, 2**53, 50), rng.integers(-40, 40, 50), strict=True)
    ]
    values = np.array([*half_way, 5e-324, 1.7976931348623157e308, -0.0, 1e23, np.nan, 0.1 + 0.2])
    columns = {"t": np.arange(values.size) / 100, "e": values, "u": -values}
    read = [read_runs(write(tmp_path, kind, columns), **ROLES) for kind in KINDS]
    np.testing.assert_array_equal(read[0][0]["e"], values)
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


def test_a_named_regular_index_of_parquet(tmp_path):
    frame = pd.DataFrame({"e": [1.0, 2.0], "u": [3.0, 4.0]}, pd.RangeIndex(0, 20, 10, name="time"))
    frame.to_parquet(tmp_path / "run.parquet")
    units = {"time": "ms"}
    X, _ = read_runs(tmp_path / "run.parquet", inputs="e", output="u", time="time", units=units)
    assert X.index.get_level_values("time").to_list() == [0.0, 0.01]


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
        ("t", None, 1000),  # by its steps
        ("t", {"t": "s"}, 1),
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

    def test_commas_and_points_are_ambiguous(self, tmp_path):
        for rows in ("1,5;1\n2.5;2\n", "1,234;0.5\n2,345;0.25\n"):
            with pytest.raises(ValueError, match=r"decimal commas, and those of .* have points"):
                self.read(tmp_path, "e;u\n" + rows)

    @pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252", "utf-16"])
    def test_encodings(self, tmp_path, encoding):
        X, _ = self.read(tmp_path, "\r\ne [°],u\r\n1,2\r\n".lstrip().encode(encoding))
        assert X.attrs["units"] == {"e": "°"}

    @pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
    @pytest.mark.parametrize(
        "text",
        [
            '\n\n"e","u"\n1,2\n\n3,4\n\n',
            'e,u,note\n1,2,"a"\n3,4,"b, ""c"""\n',
            'e,u,note\n1,2,a 5" screen\n3,4,b\n',
            'e,u,"note\n[text, free]"\n1,2,a\n3,4,a',
        ],
    )
    def test_ends_of_lines_blank_lines_and_quotes(self, tmp_path, text, newline):
        X, y = self.read(tmp_path, text.replace("\n", newline).encode())
        assert X["e"].to_list() == [1, 3]
        assert y.to_list() == [2, 4]

    @pytest.mark.parametrize(
        ("cells", "labels"),
        [
            (["1", "1", "02"], [1, 1, 2]),
            (["b", " b ", "a"], ["b", "b", "a"]),
            (["1", "a", "x y"], ["1", "a", "x y"]),
        ],
    )
    def test_labels(self, tmp_path, cells, labels):
        rows = "".join(f"{cell},{i},1,2\n" for i, cell in enumerate(cells))
        X, _ = self.read(tmp_path, "r,t,e,u\n" + rows, run="r")
        found = X.index.get_level_values("run").to_list()
        assert found == labels
        assert list(map(type, found)) == list(map(type, labels))

    @pytest.mark.parametrize("header", ["run", "Run"])
    def test_runs_are_not_taken_for_one(self, tmp_path, header):
        rows = f"{header},e,u\n0,1,2\n1,3,4\n"
        with pytest.raises(ValueError, match=f"'{header}' of .*csv has 2 labels.*run='{header}'"):
            self.read(tmp_path, rows)
        assert len(self.read(tmp_path, rows, run=header)[0]) == 2


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mat"])
def test_names_that_are_not_utf_8(tmp_path, write, suffix):
    path = tmp_path / f"r\udcff{suffix}"
    try:
        path.touch()
    except (OSError, UnicodeEncodeError):
        pytest.skip("this file system has no such names")
    runs = read_runs(write(tmp_path, "csv", {"t": T, "e": E, "u": U}), **ROLES)
    write_runs(*runs, path, overwrite=True)
    again, _ = read_runs(path, inputs="e", output="u", time="time")
    assert again.index.get_level_values("run")[0] == r"r\xff"


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


@pytest.mark.parametrize("separator", ["\t", ";", ","])
@pytest.mark.parametrize("n", [3, 20])
def test_an_empty_cell_is_missing_and_moves_no_other(tmp_path, separator, n):
    rows = [[f"{0.01 * k:.2f}", f"{k + 1}.5", f"{k + 1}.25"] for k in range(n)]
    rows[1][1] = ""
    lines = [separator.join(row) for row in (["t", "e", "u"], *rows)]
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    X, y = read_runs(tmp_path / "a.csv", inputs="e", output="u", time="t")
    assert np.flatnonzero(X["e"].isna()).tolist() == [1]
    assert y.to_list() == [k + 1.25 for k in range(n)]
