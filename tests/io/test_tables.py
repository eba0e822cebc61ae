"""Tables in files."""

import numpy as np
import pandas as pd
import pytest

from skhoid.io.writing import check_table_format, write_tables


@pytest.fixture
def table():
    index = pd.MultiIndex.from_tuples([("a", 0.1), ("a", 0.2)], names=["run", "time"])
    cells = {"gain": [0.1 + 0.2, np.nan], "names": [["x", "y"], []], "at": [1.5, "line\tbreak\n"]}
    return pd.DataFrame(cells, index=index)


def test_text_holds_what_the_table_holds(tmp_path, table):
    (path,) = write_tables({"one.tsv": table}, tmp_path / "new" / "folder")
    again = pd.read_csv(path, sep="\t", keep_default_na=False, na_values={"gain": ""})
    assert list(again) == ["run", "time", "gain", "names", "at"]
    np.testing.assert_array_equal(again["gain"], table["gain"])
    assert again["names"].tolist() == ["x, y", ""]
    assert again["at"].tolist() == ["1.5", "line\tbreak\n"]


def test_formats_agree(tmp_path, table):
    paths = write_tables({"t.parquet": table, "t.csv.gz": table, "t.csv": table}, tmp_path)
    assert paths == [tmp_path / "t.parquet", tmp_path / "t.csv.gz", tmp_path / "t.csv"]
    frames = [pd.read_parquet(paths[0]), *map(pd.read_csv, paths[1:])]
    for frame in frames[1:]:
        pd.testing.assert_frame_equal(frame.fillna({"names": ""}), frames[0], check_dtype=False)


def test_columns_of_numbers_and_pairs_get_names(tmp_path):
    (path,) = write_tables({"wide.parquet": pd.DataFrame({0.5: [1], 1.5: [2]})}, tmp_path)
    assert list(pd.read_parquet(path)) == ["0.5", "1.5"]
    frame = pd.DataFrame([[1, 2]], columns=pd.MultiIndex.from_tuples([("vaf", "mean"), ("n", "")]))
    (path,) = write_tables({"deep.csv": frame}, tmp_path)
    assert list(pd.read_csv(path)) == ["vaf_mean", "n"]


@pytest.mark.parametrize("name", ["time.csv", "time.parquet"])
def test_columns_called_like_an_index_level_are_kept(tmp_path, table, name):
    twice = table[["gain"]].assign(time=[7.0, 8.0])
    (path,) = write_tables({name: twice}, tmp_path)
    found = pd.read_parquet(path) if path.suffix == ".parquet" else pd.read_csv(path)
    assert list(found) == ["run", "time", "gain", "time_2"]
    assert found["time"].tolist() == [0.1, 0.2]
    assert found["time_2"].tolist() == [7.0, 8.0]


def test_names_that_are_one_as_text_stay_apart(tmp_path):
    frame = pd.DataFrame([[1, 2]], columns=[0.5, "0.5"])
    (path,) = write_tables({"wide.csv": frame}, tmp_path)
    assert list(pd.read_csv(path)) == ["0.5", "0.5_2"]


def test_nothing_is_half_written(tmp_path, table):
    (tmp_path / "first.tsv").write_text("precious")
    with pytest.raises(KeyError):
        write_tables({"first.tsv": table, "second.doc": table}, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["first.tsv"]
    assert (tmp_path / "first.tsv").read_text() == "precious"


def test_unknown_formats_are_refused():
    with pytest.raises(ValueError, match="written as tsv, csv, parquet; got 'doc'"):
        check_table_format("doc")
