"""Recordings to read, options about them, and where results go."""

import os
import re
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from support.labs import BROKEN, BY_NAME, LABS, broken, record

from skhoid import ControlledElement, load_human_tracking, make_tracking_runs, read_runs
from skhoid.lab.cli import main
from skhoid.lab.cli.files import check_folders, save_figures
from skhoid.lab.guessing import guess_columns
from skhoid.lab.opening import read_element

QUICK = ["--na", "1", "--nb", "1", "--nk", "15", "--no-pictures"]
FILES = ["run.csv", "--time", "t"]


# Options about files.


@pytest.mark.parametrize("command", ["identify", "diagnose", "report"])
def test_options_about_files_need_files(capsys, command):
    """Else the bundled recordings would be taken for the user's."""
    words = [["--input", "e", "run.csv"]] if command == "identify" else []
    words += [["--output", "u"], ["--run", "run"], ["--unit", "e=deg"], ["--resample"]]
    words += [["--dt", "0.01"], ["--time", "t"]]
    for given in words:
        assert main([command, *given]) == 2
        said = capsys.readouterr().err
        assert said.startswith(f"skhoid: error: {given[0]} is about files, and there are none.")
        assert said.endswith("name the files first.\n")


@pytest.mark.parametrize(
    "line",
    [
        "identify --nk 7 --longest-delay 0.5",
        "identify --nk 7 --instruments f_t",
        "identify --no-pictures --out out",
        "identify run.csv --dt 0.01 --resample",
        "diagnose --overwrite",
        "diagnose --no-pictures --out out",
        "report --effects none --display pursuit",
        "report --effects none --controlled-element 1 0",
    ],
)
def test_options_without_effect_are_refused(capsys, line):
    assert main(line.split()) == 2
    last = [word for word in line.split() if word.startswith("--")][-1]
    assert capsys.readouterr().err.startswith(f"skhoid: error: {last} ")
    assert not Path("out").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--input", "e", "--x", "e"], "'e' has two roles, 'e' and 'x': name different channels"),
        (["--x", "x", "--target", "x"], "'x' has two roles, 'x' and 'f_t'"),
        (["--unit", "e=deg", "--unit", "e=rad"], "--unit says twice what 'e' is, 'deg' and 'rad'"),
    ],
)
def test_a_channel_is_one_thing(capsys, words, said):
    assert main(["diagnose", *FILES, *words]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "element"),
    [
        ("90 6", ControlledElement(90.0, 6.0)),
        ("1/(s(s+1))", ControlledElement("1/(s(s+1))")),
    ],
)
def test_controlled_elements(text, element):
    assert read_element(text) == element
    with pytest.raises(ValueError, match="'K' is unknown"):
        read_element("K/s")


# What is in the files.


def test_row_numbers_for_time_are_noted_and_clocks_resampled(capsys, run_json, run_files):
    words = [*run_files, "--input", "target", "--output", "cursor", *QUICK]
    found = run_json("identify", *words, "--time", "t", "--resample", "--dt", "0.04")
    assert found["dt_s"] == pytest.approx(0.04)
    for path in run_files:
        table = pd.read_csv(path)
        table["t [s]"] = range(len(table))
        table.to_csv(path, index=False)
    assert main(["identify", *words, "--time", "t"]) == 0
    assert "t advances by 1 a row, counted as 1 s" in capsys.readouterr().err
    assert main(["identify", *words, "--dt", "0.01"]) == 0
    assert "counted as" not in capsys.readouterr().err


@pytest.fixture
def people(tmp_path):
    """One file with the runs of two subjects under two conditions."""
    X, y = make_tracking_runs(n_runs=4, duration=20.48, sampling_rate=50, random_state=0)
    frame = X.assign(stick=y).reset_index()
    number = frame["run"].astype(int)
    frame["subject"], frame["condition"] = number % 2 + 1, np.where(number < 2, "near", "far")
    path = tmp_path / "people.csv"
    frame.to_csv(path, index=False)
    return str(path)


@pytest.mark.filterwarnings("default::skhoid.exceptions.PooledRunsWarning")
def test_one_subject_or_condition_is_selected(people, run_files, run_json, capsys):
    assert run_json("identify", people, *QUICK, "--condition", "far")["n_runs"] == 2
    both = ["--subject", "2", "--condition", "far"]
    assert run_json("identify", people, *QUICK, *both)["n_runs"] == 1
    assert main(["identify", people, *QUICK]) == 0  # all of them are one operator's
    said = capsys.readouterr().err
    assert "note: Runs of 2 subjects are fitted as those of one: 1, 2." in said
    assert "--subject" in said
    assert "groupby" not in said
    assert main(["identify", people, "--subject", "7"]) == 2
    assert "There is no subject '7' in the files, only '1', '2'." in capsys.readouterr().err
    assert main(["identify", *run_files, "--output", "cursor [px]", "--subject", "7"]) == 2
    assert "no column of the files tells subjects apart" in capsys.readouterr().err


def test_names_are_printed_and_drawn_as_they_are(capsys):
    """Neither emoji nor mathematics, which would also fail."""
    X, y = load_human_tracking("phase-size 2b")
    table = X[:600].droplevel("run").reset_index().assign(u=y[:600].to_numpy())
    labels = ["12:100:0", r"c$\frac$"]
    runs = [table.assign(run=label) for label in labels]
    pd.concat(runs).rename(columns={"f_t": "a$x_1$b"}).to_csv("runs.csv", index=False)
    words = ["runs.csv", "--output", "u", "--time", "time", "--run", "run", "--input", "a$x_1$b"]
    assert main(["identify", *words, "--na", "2", "--nk", "6", "--memory-time", "5"]) == 0
    printed = capsys.readouterr().out
    assert "12:100:0" in printed
    assert "input a$x_1$b" in printed
    assert "Pictures in skhoid-identify: simulation.png, parameters.png" in printed


# Files of twelve labs, and their broken twins: nothing but the name of the file is said.


@pytest.fixture(scope="module")
def rows():
    return record()


@pytest.mark.parametrize("lab", LABS, ids=lambda lab: lab.name)
def test_all_labs_have_recorded_the_same(tmp_path, rows, lab, capsys):
    path = lab.write(lab.frame(rows), tmp_path)
    X, y = read_runs(path)
    assert capsys.readouterr().out.startswith("Columns: time ")
    scale = 57.29578 if lab.name == "turned" else 1.0
    for channel in ("e", "x", "f_t"):
        assert scale * X[channel].to_numpy() == pytest.approx(rows[channel].to_numpy(), abs=2e-4)
    assert scale * y.to_numpy() == pytest.approx(rows["u"].to_numpy(), abs=2e-4)
    assert X.index.get_level_values("run").nunique() == 3
    first = X.index.get_level_values("time")[:3]
    assert (first - first[0]).tolist() == pytest.approx([0.0, 0.02, 0.04])
    found = guess_columns(path).as_dict()
    taken = {role: header for header, role in found["channels"].items()}
    taken |= {name: found[name] for name in ("time", "run")} | {"u": found["output"]}
    assert {role: taken.get(role) for role in lab.roles} == lab.roles


@pytest.mark.parametrize("name", BROKEN)
def test_one_message_says_all_that_is_wrong(tmp_path, rows, name, capsys):
    lab, (changes, expected) = BY_NAME[name], BROKEN[name]
    path = lab.write(broken(name, lab.frame(rows)), tmp_path)
    assert main(["diagnose", str(path)]) == 2
    said = capsys.readouterr().err
    assert said.count("skhoid: error: ") == 1
    assert f"{len(changes)} problems" in said or len(changes) == 1
    for part in expected:
        assert re.search(part, said), said
    assert "It has: " in said


def test_what_is_named_is_not_guessed(tmp_path, rows, capsys):
    path = tmp_path / "two.csv"
    rows.rename(columns={"u": "stick"}).assign(throttle=np.roll(rows["u"], 9)).to_csv(
        path, index=False
    )
    assert main(["identify", str(path), "--no-pictures"]) == 2
    assert "--output stick or --output throttle" in capsys.readouterr().err
    assert main(["identify", str(path), "--output", "stick", *QUICK]) == 0
    assert 'output u "stick"' in " ".join(capsys.readouterr().out.split())


# Where results go.


def test_formulas_of_a_figure_are_no_names_of_data():
    X, y = pd.DataFrame({"a$x_1$b": [1.0]}), pd.Series([1.0], name="u")
    figure = Figure()
    panel = figure.subplots()
    panel.loglog([1, 1000], [1, 1000])
    title = panel.set_title(r"of 'a$x_1$b' and $\frac$")
    label = panel.set_xlabel("$f_t$")
    save_figures({"one": figure}, Path("out"), "identify", named=(X, y))
    assert not title.get_parse_math()
    assert label.get_parse_math()
    assert all(tick.get_parse_math() for tick in panel.get_xticklabels())


@pytest.mark.parametrize(
    "words",
    [
        ["demo", "--out"],
        ["diagnose", "--out"],
        ["identify", "--tables"],
        ["report", "--tables"],
        ["study", "fig13", "--out"],
    ],
)
def test_a_file_is_no_folder(capsys, words):
    Path("notes.txt").write_text("precious")
    assert main([*words, "notes.txt"]) == 2
    assert capsys.readouterr().err == "skhoid: error: notes.txt is a file; name a folder.\n"
    for line in (words, ["simulate", "--out"], ["diagnose", "--report"]):
        assert main([*line, "notes.txt/new.csv"]) == 2
        assert "error: notes.txt is a file and no folder; " in capsys.readouterr().err


def test_folders_that_may_not_be_written_into(monkeypatch):
    check_folders(".", "new/one")
    monkeypatch.setattr(os, "access", lambda *_: False)  # root may write everywhere
    with pytest.raises(ValueError, match=r"The folder \. may not be written into"):
        check_folders("new/one")


def test_tables_are_checked_before_the_work(capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    for command in ("demo", "diagnose", "report", "identify"):
        assert main([command, "--tables", "tables", "--table-format", "parquet"]) == 2
        said = capsys.readouterr()
        assert said.out == ""
        assert 'pip install "skhoid[io]"' in said.err
