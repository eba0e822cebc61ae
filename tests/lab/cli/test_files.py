"""Recordings to read, and where results go."""

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from skhoid import make_tracking_runs
from skhoid.lab.cli import main
from skhoid.lab.cli.files import check_folders, column_of, save_figures

pytestmark = pytest.mark.slow  # starts and reads much


def test_names_with_dollars_leave_formulas_and_powers_of_ten():
    X, y = pd.DataFrame({"a$x_1$b": [1.0]}), pd.Series([1.0], name="u")
    figure = Figure()
    panel = figure.subplots()
    panel.loglog([1, 1000], [1, 1000])
    title = panel.set_title(r"of 'a$x_1$b' and $\frac$")
    label = panel.set_xlabel("$f_t$")
    save_figures({"one.png": figure}, Path("out"), "identify", named=(X, y))
    assert not title.get_parse_math()
    assert label.get_parse_math()
    assert all(tick.get_parse_math() for tick in panel.get_xticklabels())


def test_pictures_of_before_go_if_they_are_the_commands_own():
    folder = Path("out")
    save_figures({"a.png": Figure(), "b.png": Figure(), "mine.png": Figure()}, folder, "demo")
    save_figures({"c.png": Figure()}, folder, "identify")
    Figure().savefig(folder / "d.png")
    names = [f"{letter}.png" for letter in "abcde"]
    assert save_figures({"a.png": Figure()}, folder, "demo", others=names) == ["out/a.png"]
    assert {path.stem for path in folder.iterdir()} == {"a", "c", "d", "mine"}


@pytest.mark.parametrize(
    ("asked", "found"),
    [("e", "e"), ("x [deg]", "x"), ("d.f_t", "f_t"), ("a.b", "a.b"), ("d.r [deg/s]", "r")],
)
def test_columns_by_what_was_asked_for(asked, found):
    assert column_of(pd.DataFrame(columns=["e", "x", "f_t", "a.b", "r"]), asked) == found


def test_whole_headers_are_names(biased_file, run_json):
    table = pd.read_csv(biased_file[0])
    table.rename(columns={"error": "e [deg]", "angle": "x [deg]"}).to_csv("h.csv", index=False)
    words = ["--input", "e [deg]", "--x", "x [deg]", "--target", "wanted", "--output", "stick"]
    words += ["--time", "time", "--run", "run", "--core", "arx", "--nk", "15", "--effects", "bias"]
    found = run_json("diagnose", "h.csv", *words, "--no-pictures")
    assert found["comparison"]["noise_ceiling"] is not None  # which takes e and f_t


def test_row_numbers_for_time_are_noted(capsys, run_files):
    for path in run_files:
        table = pd.read_csv(path)
        table["t [s]"] = range(len(table))
        table.to_csv(path, index=False)
    words = ["identify", *run_files, "--input", "target", "--output", "cursor", "--no-pictures"]
    words += ["--na", "2", "--nb", "2", "--nk", "6"]
    assert main([*words, "--time", "t"]) == 0
    assert "t advances by 1 a row, counted as 1 s" in capsys.readouterr().err
    assert main([*words, "--dt", "0.01"]) == 0
    assert "counted as" not in capsys.readouterr().err


@pytest.mark.parametrize("name", [".", "new/one"])
def test_folders_that_may_not_be_written_into(monkeypatch, name):
    check_folders(name)
    monkeypatch.setattr(os, "access", lambda *_: False)  # root may write everywhere
    with pytest.raises(ValueError, match=r"The folder \. may not be written into"):
        check_folders(name)


@pytest.fixture
def people(tmp_path):
    """One file with the runs of two subjects under two conditions."""
    X, y = make_tracking_runs(n_runs=4, duration=20.48, random_state=0)
    frame = X.assign(stick=y).reset_index()
    number = frame["run"].astype(int)
    frame["subject"], frame["condition"] = number % 2 + 1, np.where(number < 2, "near", "far")
    path = tmp_path / "people.csv"
    frame.to_csv(path, index=False)
    return str(path)


FEW_ORDERS = ["--na", "1", "--nb", "1", "--nk", "29", "--no-pictures"]


def test_one_subject_or_condition_is_selected(people, run_json):
    assert run_json("identify", people, *FEW_ORDERS, "--subject", "2")["n_runs"] == 2
    assert run_json("identify", people, *FEW_ORDERS, "--condition", "far")["n_runs"] == 2
    both = ["--subject", "2", "--condition", "far"]
    assert run_json("identify", people, *FEW_ORDERS, *both)["n_runs"] == 1


@pytest.mark.filterwarnings("default::skhoid.exceptions.PooledRunsWarning")
def test_subjects_that_are_pooled_are_noted_with_the_option(people, capsys):
    assert main(["identify", people, *FEW_ORDERS]) == 0
    said = capsys.readouterr().err
    assert (
        "note: Runs of 2 subjects are fitted as those of one: 1, 2. Say --subject 1 to fit" in said
    )
    assert "--condition near" in said
    assert "groupby" not in said


def test_a_subject_who_is_not_there(people, run_files, capsys):
    assert main(["identify", people, "--subject", "7"]) == 2
    assert "There is no subject '7' in the files, only '1', '2'." in capsys.readouterr().err
    words = ["--output", "cursor [px]", "--subject", "7"]
    assert main(["identify", *run_files, *words]) == 2
    assert "no column of the files tells them apart" in capsys.readouterr().err
