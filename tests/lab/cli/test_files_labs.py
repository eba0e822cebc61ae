"""Files of twelve labs, and their broken twins: nothing but the name of the file is said."""

import json
import re

import numpy as np
import pytest
from support.labs import BROKEN, BY_NAME, LABS, broken, record

from skhoid import read_runs
from skhoid.lab.cli import main
from skhoid.lab.guessing.columns import guess_columns

pytestmark = pytest.mark.slow  # starts and reads much

FEW = ["--effects", "bias", "dead_zone"]


@pytest.fixture(scope="module")
def rows():
    return record()


@pytest.mark.parametrize("lab", LABS, ids=lambda lab: lab.name)
def test_columns_are_guessed(tmp_path, rows, lab):
    path = lab.write(lab.frame(rows), tmp_path)
    guess = guess_columns(path)
    assert not guess.problems
    found = {"time": guess.time, "run": guess.run, "u": guess.output[0]}
    found |= {role: header for header, role in guess.channels.items()}
    assert {role: found.get(role) for role in lab.roles} == lab.roles
    assert "\n" not in str(guess)


@pytest.mark.parametrize("lab", LABS, ids=lambda lab: lab.name)
def test_all_labs_have_recorded_the_same(tmp_path, rows, lab, capsys):
    X, y = read_runs(lab.write(lab.frame(rows), tmp_path))
    assert capsys.readouterr().out.startswith("Columns: time ")
    scale = 57.29578 if lab.name == "turned" else 1.0
    assert {"e", "x", "f_t"} == set(X.columns)
    assert y.name == "u"
    for channel in ("e", "x", "f_t"):
        assert scale * X[channel].to_numpy() == pytest.approx(rows[channel].to_numpy(), abs=2e-4)
    assert scale * y.to_numpy() == pytest.approx(rows["u"].to_numpy(), abs=2e-4)
    assert X.index.get_level_values("run").nunique() == 3
    first = X.index.get_level_values("time")[:3]
    assert (first - first[0]).tolist() == pytest.approx([0.0, 0.02, 0.04])


@pytest.mark.parametrize("lab", LABS, ids=lambda lab: lab.name)
def test_diagnose_needs_no_option(tmp_path, rows, lab, capsys):
    path = lab.write(lab.frame(rows), tmp_path)
    assert main(["diagnose", str(path), *FEW, "--no-pictures", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["best_effects"] == ["bias"]
    assert (found["n_runs"], found["inputs"], found["output"]) == (3, ["e"], "u")
    assert found["columns"]["output"] == lab.roles["u"]


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
    assert "Traceback" not in said


def test_several_files_that_number_their_runs_alike(tmp_path, rows):
    lab = BY_NAME["suffixes"]
    for k in (1, 2):
        part = lab.frame(rows[rows["run"] == k]).assign(trial_no=1)
        lab.write(part, tmp_path, f"p{k}")
    X, _ = read_runs(tmp_path / "p*.csv")
    assert X.index.unique("run").tolist() == ["p1", "p2"]


def test_subjects_and_conditions_become_levels_of_the_index(tmp_path, rows):
    frame = rows.assign(subject=(rows["run"] > 1) + 1, trial=rows["run"].replace(3, 2))
    frame["trial"] = frame["trial"].where(frame["subject"] == 1, frame["run"] - 1)
    path = tmp_path / "all.csv"
    frame[["subject", "trial", "t", "e", "u"]].to_csv(path, index=False)
    X, _ = read_runs(path)
    assert list(X.index.names) == ["subject", "run", "time"]
    assert X.index.droplevel("time").unique().tolist() == [(1, 1), (2, 1), (2, 2)]


def test_what_is_named_is_not_guessed(tmp_path, rows, capsys):
    path = tmp_path / "two.csv"
    rows.rename(columns={"u": "stick"}).assign(throttle=np.roll(rows["u"], 9)).to_csv(
        path, index=False
    )
    assert main(["identify", str(path), "--no-pictures"]) == 2
    said = capsys.readouterr().err
    assert "--output stick or --output throttle" in said
    words = ["--output", "stick", "--na", "1", "--nb", "1", "--nk", "15", "--no-pictures"]
    assert main(["identify", str(path), *words]) == 0
    assert 'output u "stick"' in " ".join(capsys.readouterr().out.split())
