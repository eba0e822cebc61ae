"""Runs, tables and figures come back as they were, and no file is ever half-written."""

import errno
import os

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from skhoid import make_tracking_runs, read_runs, write_runs
from skhoid.io import check_table_format, is_left_over, save_figure, write_tables, written_whole

LINKS = pytest.mark.skipif(os.name == "nt", reason="Windows lets not everyone make links")


@pytest.fixture(scope="module")
def runs():
    settings = {"channels": ["e", "x"], "duration": 8.0, "run_in": 4.0, "random_state": 0}
    return make_tracking_runs("C2", n_runs=2, remnant_gain=0.02, keep_run_in=1.5, **settings)


@pytest.mark.parametrize("extension", ["csv", "tsv", "parquet"])
def test_tables_come_back_bit_for_bit(runs, tmp_path, extension):
    X, y = runs
    path = write_runs(X, y, tmp_path / f"runs.{extension}")
    again = read_runs(path, inputs=["e", "x"], output="u", time="time", run="run")
    pd.testing.assert_frame_equal(again[0], X, check_exact=True)
    pd.testing.assert_series_equal(again[1], y, check_exact=True)


def test_matlab_files_come_back_with_labels_of_their_own(runs, tmp_path):
    X, y = runs
    path = write_runs(X, y, tmp_path / "runs.mat")
    X_again, y_again = read_runs(path, inputs=["e", "x"], output="u", time="time")
    np.testing.assert_array_equal(X_again, X)
    np.testing.assert_array_equal(y_again, y)
    labels, times = (X_again.index.get_level_values(level) for level in ("run", "time"))
    assert list(labels.unique()) == ["runs-1", "runs-2"]
    np.testing.assert_array_equal(times, X.index.get_level_values("time"))


def test_existing_files_stay_unless_told(runs, tmp_path):
    path = tmp_path / "runs.csv"
    path.write_text("precious")
    with pytest.raises(FileExistsError, match="overwrite=True"):
        write_runs(*runs, path)
    assert path.read_text() == "precious"
    write_runs(*runs, path, overwrite=True)
    assert path.read_text().startswith("run,time,e,x,u")


def test_errors_say_what_to_do(runs, tmp_path):
    X, y = runs
    with pytest.raises(ValueError, match=r"skhoid writes \.csv, \.tsv, \.parquet, \.mat"):
        write_runs(X, y, tmp_path / "runs.xlsx")
    with pytest.raises(FileNotFoundError, match="does not exist"):
        write_runs(X, y, tmp_path / "nowhere" / "runs.csv")
    with pytest.raises(ValueError, match="not a column of X"):
        write_runs(X, y.rename("e"), tmp_path / "runs.csv")
    with pytest.raises(ValueError, match="one matrix per channel"):
        write_runs(X[:-1], y[:-1], tmp_path / "runs.mat")
    with pytest.raises(ValueError, match="cannot hold the channel '_e'"):
        write_runs(X.rename(columns={"x": "_e"}), y, tmp_path / "runs.mat")
    assert list(tmp_path.iterdir()) == []


@LINKS
def test_a_link_that_leads_nowhere_is_there(runs, tmp_path):
    link = tmp_path / "link.csv"
    link.symlink_to("real.csv")
    with pytest.raises(FileExistsError, match=r"link\.csv exists"):
        write_runs(*runs, link)
    write_runs(*runs, link, overwrite=True)
    assert link.is_symlink()
    assert (tmp_path / "real.csv").is_file()


@pytest.mark.parametrize("name", ["table.csv.gz", "plain", "v" * 240 + ".csv"])
def test_the_file_is_moved_when_it_is_whole(tmp_path, name):
    path = tmp_path / name
    path.write_text("precious")
    with written_whole(str(path)) as aside:
        assert (aside.parent, aside.suffixes) == (tmp_path, [".tmp", *path.suffixes])
        assert is_left_over(aside)
        assert not is_left_over(path)
        aside.write_text("new")
        assert path.read_text() == "precious"
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


def fail(path, error):
    with written_whole(path) as aside:
        aside.write_text("half")
        raise error


def test_an_error_leaves_what_was_there_and_names_the_file(tmp_path):
    path = tmp_path / "runs.csv"
    path.write_text("precious")
    with pytest.raises(KeyboardInterrupt):
        fail(path, KeyboardInterrupt)
    with pytest.raises(OSError, match="No space left") as caught:
        fail(path, OSError(errno.ENOSPC, "full"))
    assert caught.value.filename == str(path)
    assert path.read_text() == "precious"
    assert list(tmp_path.iterdir()) == [path]


def test_folders_and_what_is_no_ordinary_file_are_refused(tmp_path):
    table = pd.DataFrame({"gain": [1.0]})
    (tmp_path / "a.tsv").write_text("precious")
    (tmp_path / "b.tsv").mkdir()
    with pytest.raises(IsADirectoryError, match=r"b\.tsv is a folder; name a file in it"):
        write_tables({"a.tsv": table, "b.tsv": table}, tmp_path)
    assert (tmp_path / "a.tsv").read_text() == "precious"
    link = tmp_path / "link.csv"
    link.symlink_to("link.csv")
    with pytest.raises(OSError, match="not a regular file"), written_whole(link):
        pass
    assert len(list(tmp_path.iterdir())) == 3


@pytest.fixture
def table():
    index = pd.MultiIndex.from_tuples([("a", 0.1), ("a", 0.2)], names=["run", "time"])
    cells = {"gain": [0.1 + 0.2, np.nan], "names": [["x", "y"], []], "at": [1.5, "line\tbreak\n"]}
    return pd.DataFrame(cells, index=index)


def test_tables_hold_what_they_held_in_every_format(tmp_path, table):
    names = ["t.tsv", "t.csv.gz", "t.parquet"]
    paths = write_tables(dict.fromkeys(names, table), tmp_path / "new" / "folder")
    frames = [
        pd.read_csv(paths[0], sep="\t"),
        pd.read_csv(paths[1]),
        pd.read_parquet(paths[2]),
    ]
    for frame in frames:
        assert list(frame) == ["run", "time", "gain", "names", "at"]
        np.testing.assert_allclose(frame["gain"], table["gain"], rtol=1e-15)  # pandas 2 rounds
        assert frame["names"].fillna("").tolist() == ["x, y", ""]
        assert frame["at"].tolist() == ["1.5", "line\tbreak\n"]


def test_columns_get_names_of_their_own(tmp_path, table):
    columns = pd.MultiIndex.from_tuples([("vaf", "mean"), ("n", ""), (0.5, ""), ("0.5", "")])
    deep, twice = pd.DataFrame([[1, 2, 3, 4]], columns=columns), table[["gain"]].assign(time=7.0)
    paths = write_tables({"deep.csv": deep, "twice.parquet": twice}, tmp_path)
    assert list(pd.read_csv(paths[0])) == ["vaf_mean", "n", "0.5", "0.5_2"]
    assert list(pd.read_parquet(paths[1])) == ["run", "time", "gain", "time_2"]


def test_unknown_formats_are_refused():
    with pytest.raises(ValueError, match="written as tsv, csv, parquet; got 'doc'"):
        check_table_format("doc")


def test_a_saved_figure_is_whole_closed_and_fit_for_journals(tmp_path):
    figure, ax = plt.subplots()
    ax.set_title("A title")
    path = save_figure(figure, tmp_path / "one.png", metadata={"Software": "skhoid demo"})
    assert b"Software\0skhoid demo" in path.read_bytes()
    assert not plt.fignum_exists(figure.number)
    content = save_figure(figure, tmp_path / "one.pdf").read_bytes()
    assert b"/Type0" in content
    assert b"/Type3" not in content
    with pytest.raises(ValueError, match="doc"):
        save_figure(figure, tmp_path / "one.doc")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one.pdf", "one.png"]
