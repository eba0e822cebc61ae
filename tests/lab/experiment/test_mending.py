"""Recordings that are known to be wrong are inverted or left out, which is said, with numbers."""

import json

import numpy as np
import pandas as pd
import pytest
from support.experiments import people_in_the_loop

from skhoid import check_experiment
from skhoid.lab.cli import main
from skhoid.lab.experiment import mend_recordings


@pytest.fixture(scope="module")
def right():
    return people_in_the_loop(4, ("fast_rested", "fast_tired", "slow_rested", "slow_tired"), 1)


@pytest.fixture(scope="module")
def wrong(right):
    """The stick of S2 inverted, the output of S4 in other units."""
    X, y = right
    factor = y.index.get_level_values("subject").map({"S1": 1, "S2": -1, "S3": 1, "S4": 1000})
    return X, y * np.asarray(factor)


def test_what_the_check_is_sure_of_is_mended(right, wrong):
    mended = mend_recordings(*wrong, check_experiment(*wrong))
    told = mended.changes[["subject", "condition", "runs", "done", "channel", "by"]]
    assert told.to_numpy().tolist() == [
        ["S2", "all", "all", "inverted", "u", "check"],
        ["S4", "all", "all", "left out", "", "check"],
    ]
    people = ["S1", "S2", "S3"]
    pd.testing.assert_frame_equal(mended.X, right[0].loc[people])
    pd.testing.assert_series_equal(mended.y, right[1].loc[people])
    assert mended.recorded[1] is wrong[1]
    assert list(mended.X.index.unique("subject")) == people


def test_your_word_goes_before_that_of_the_check(right, wrong):
    X, y = wrong
    mended = mend_recordings(
        X, y, check_experiment(X, y), invert=["S4/fast_tired/1"], leave_out=["S2", "S1/slow_tired"]
    )
    assert mended.changes["by"].tolist() == ["you"] * 3
    assert set(mended.X.index.unique("subject")) == {"S1", "S3", "S4"}
    assert "slow_tired" not in mended.X.loc["S1"].index.unique("condition")
    np.testing.assert_array_equal(mended.y.loc["S4", "fast_tired"], -y.loc["S4", "fast_tired"])
    np.testing.assert_array_equal(mended.y.loc["S4", "slow_tired"], y.loc["S4", "slow_tired"])
    assert mend_recordings(X, y).changes.empty
    with pytest.raises(ValueError, match="no runs of 'S9' to be inverted: people are S1, S2"):
        mend_recordings(X, y, invert=["S9"])
    with pytest.raises(ValueError, match="Nobody would be left"):
        mend_recordings(X, y, leave_out=["S1", "S2", "S3", "S4"])


@pytest.mark.slow  # which draws the page twice
def test_the_command_shows_numbers_with_and_without(wrong, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    X, y = wrong
    for (who, condition, run), rows in X.groupby(level=["subject", "condition", "run"]):
        path = tmp_path / "data" / who / condition / f"run{run}.csv"
        path.parent.mkdir(parents=True, exist_ok=True)
        table = rows.assign(u=y[rows.index]).droplevel(["subject", "condition", "run"])
        table.reset_index().to_csv(path, index=False)
    words = ["experiment", "data", "--effects", "none", "--core", "arx", "--nk", "12", "--na", "1"]
    words += ["--nb", "1", "--json", "--overwrite", "--leave-out", "S4"]
    assert main(words) == 0
    found = json.loads(capsys.readouterr().out)
    assert [row["done"] for row in found["changes"]] == ["left out", "inverted"]
    (b0,) = (row for row in found["with_and_without"] if row["parameter"] == "b0")
    assert (b0["used_n"], b0["recorded_n"], b0["without_n"]) == (3, 4, 2)
    assert b0["recorded_sd"] > 10 * b0["used_sd"]
    page = (tmp_path / "experiment.html").read_text()
    assert "u of S2 is inverted: its correlations" in page
    assert "S4 is left out: as you asked" in page
    assert "As recorded, the mean of a1 over people would be " in page
    assert main([*words, "--as-recorded"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [row["done"] for row in found["changes"]] == ["left out"]
