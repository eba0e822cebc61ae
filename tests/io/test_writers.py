"""Runs written to files come back as they were, and no file is ever half-written."""

import os

import numpy as np
import pandas as pd
import pytest

from skhoid import make_tracking_runs, read_runs, select_runs, write_runs


@pytest.fixture(scope="module")
def runs():
    return make_tracking_runs(
        "C2",
        n_runs=3,
        channels=["e", "x"],
        remnant_gain=0.02,
        duration=8.0,
        run_in=4.0,
        keep_run_in=1.5,
        random_state=0,
    )


@pytest.mark.parametrize("extension", ["csv", "parquet"])
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
    assert list(labels.unique()) == ["runs-1", "runs-2", "runs-3"]
    np.testing.assert_array_equal(times, X.index.get_level_values("time"))


def test_one_run_as_matlab_file(runs, tmp_path):
    X, y = select_runs(*runs, last=1)
    path = write_runs(X, y, tmp_path / "one.mat")
    X_again, y_again = read_runs(path, inputs=["e", "x"], output="u", time="time")
    np.testing.assert_array_equal(X_again, X)
    np.testing.assert_array_equal(y_again, y)


def test_existing_files_stay_unless_told(runs, tmp_path):
    path = tmp_path / "runs.csv"
    path.write_text("precious")
    with pytest.raises(FileExistsError, match="overwrite=True"):
        write_runs(*runs, path)
    assert path.read_text() == "precious"
    write_runs(*runs, path, overwrite=True)
    assert path.read_text().startswith("run,time,e,x,u")


def test_a_failed_write_leaves_nothing(runs, tmp_path, monkeypatch):
    def fail(*_, **__):
        raise OSError("disk full")

    monkeypatch.setattr(pd.DataFrame, "to_csv", fail)
    path = tmp_path / "runs.csv"
    path.write_text("precious")
    with pytest.raises(OSError, match="disk full"):
        write_runs(*runs, path, overwrite=True)
    assert [p.name for p in tmp_path.iterdir()] == ["runs.csv"]
    assert path.read_text() == "precious"


def test_errors_say_what_to_do(runs, tmp_path):
    X, y = runs
    with pytest.raises(ValueError, match=r"skhoid writes \.csv, \.parquet, \.mat"):
        write_runs(X, y, tmp_path / "runs.xlsx")
    with pytest.raises(FileNotFoundError, match="does not exist"):
        write_runs(X, y, tmp_path / "nowhere" / "runs.csv")
    with pytest.raises(ValueError, match="not a column of X"):
        write_runs(X, y.rename("e"), tmp_path / "runs.csv")
    with pytest.raises(ValueError, match="one matrix per channel"):
        write_runs(X[:-1], y[:-1], tmp_path / "runs.mat")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["time", "_e"])
def test_names_that_matlab_loses_are_refused(runs, tmp_path, name):
    X, y = runs
    with pytest.raises(ValueError, match=f"cannot hold the channel '{name}'"):
        write_runs(X.rename(columns={"x": name}), y, tmp_path / "runs.mat")
    with pytest.raises(TypeError, match="must be a DataFrame"):
        write_runs(X.to_numpy(), y, tmp_path / "runs.mat")


@pytest.mark.skipif(os.name == "nt", reason="Windows lets not everyone make links")
def test_a_link_that_leads_nowhere_is_there(runs, tmp_path):
    X, y = runs
    link = tmp_path / "link.csv"
    link.symlink_to("real.csv")
    with pytest.raises(FileExistsError, match=r"link\.csv exists"):
        write_runs(X, y, link)
    assert not (tmp_path / "real.csv").exists()
    write_runs(X, y, link, overwrite=True)
    assert link.is_symlink()
    assert (tmp_path / "real.csv").is_file()
