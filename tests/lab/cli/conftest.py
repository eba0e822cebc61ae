"""Recordings in files, as users have them."""

import json

import pytest

from skhoid import load_human_tracking, make_tracking_runs, write_runs
from skhoid.effects import Bias
from skhoid.lab.cli import main


@pytest.fixture(autouse=True)
def own_folder(tmp_path, monkeypatch):
    """What a command leaves in the working folder goes with the test."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def run_json(capsys):
    """Run a command, and read its output as JSON."""

    def run(*words):
        assert main([*words, "--json"]) == 0
        return json.loads(capsys.readouterr().out)

    return run


@pytest.fixture
def run_files(tmp_path):
    """Three CSV files of real tracking runs, with units in their headers."""
    X, y = load_human_tracking(["phase-size 2b", "phase-size 2c", "phase-size 2d"])
    paths = []
    for label, part in X.groupby(level="run"):
        table = part.droplevel("run").reset_index()
        table["cursor [px]"] = y.loc[[label]].to_numpy()
        path = tmp_path / f"{label.replace(' ', '-')}.csv"
        table.rename(columns={"time": "t [s]", "f_t": "target [px]"}).to_csv(path, index=False)
        paths.append(str(path))
    return paths


@pytest.fixture
def biased_file(tmp_path):
    """Three short runs with an offset, under names of their own, and the words that say so."""
    X, y = make_tracking_runs(
        "C1",
        n_runs=3,
        duration=20.48,
        sampling_rate=40,
        channels=["e", "x", "f_t"],
        remnant_intensity=0.05,
        random_state=1,
        effects=Bias(level=0.1),
    )
    renamed = X.rename(columns={"e": "e [deg]", "x": "angle", "f_t": "wanted"})
    write_runs(renamed, y.rename("stick"), tmp_path / "runs.csv")
    words = ["--input", "e [deg]", "--x", "angle", "--target", "wanted", "--output", "stick"]
    return ["runs.csv", *words, "--time", "time", "--run", "run"]
