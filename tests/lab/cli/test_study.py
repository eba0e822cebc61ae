"""The command ``skhoid study``."""

import pandas as pd
import pytest

from skhoid import make_tracking_runs, write_runs
from skhoid.lab.cli import main

SMALL = ["--conditions", "C1", "--intensities", "0.1", "--replications", "2", "--validation", "1"]


def test_list(capsys):
    assert main(["study", "list"]) == 0
    out = capsys.readouterr().out
    assert "fig13" in out
    assert "experiment" in out


@pytest.mark.slow  # simulates studies
def test_a_study_of_the_paper(capsys, run_json):
    words = ["study", "fig12", *SMALL, "--out", "out"]
    assert main(words) == 0
    out = capsys.readouterr().out
    assert "[holds] Fig. 12" in out
    assert "Files in out/fig12: " in " ".join(out.split())
    found = run_json(*words, "--table-format", "parquet")  # goes on: all is there
    assert (found["study"], found["failed"]) == ("fig12", 0)
    names = ["table.parquet", "summary.parquet", "claims.parquet", "fig12.png"]
    assert found["files"] == [f"out/fig12/{name}" for name in names]
    assert set(pd.read_parquet(found["files"][2])) == {"source", "statement", "found", "holds"}
    assert main([*words, "--seed", "1"]) == 2
    assert "belongs to a different study: entropy" in capsys.readouterr().err


@pytest.mark.slow  # simulates studies
def test_all(run_json):
    words = ["study", "all", *SMALL, "--intensities", "0", "0.1"]
    found = run_json(*words, "--out", "out", "--no-pictures")["studies"]
    assert [one["study"] for one in found] == ["appG", "fig12", "fig13", "appI", "appK"]


@pytest.mark.slow  # simulates studies
def test_recommend(capsys, run_json):
    words = ["study", "recommend", "--conditions", "C4", "--rate", "50", "--replications", "2"]
    words += ["--validation", "1", "--out", "out"]
    assert run_json(*words)["memory_horizon"] in (64, 128, 256)
    found = run_json(*words[:-4], "--question", "follow", "--methods", "rls", "arx")
    assert (found["method"], found["close"]) == ("rls", ["rls"])
    assert found["estimator"].startswith("RecursiveARX(memory_time=")
    assert main([*words, "--no-pictures"]) == 0
    assert "samples" in capsys.readouterr().out


@pytest.mark.slow  # simulates studies
def test_tournament(capsys, run_json):
    words = ["study", "tournament", "--size", "small", "--methods", "rls", "arx"]
    words += ["--conditions", "C4", "--replications", "1", "--validation", "1", "--out", "out"]
    found = run_json(*words)
    assert list(found["ranking"]["causal"]) == ["rls"]
    made = {name.rpartition("/")[2] for name in found["files"]}
    assert {"table.csv.gz", "summary.csv", "winners.png", "settling.png"} <= made
    assert main([*words, "--no-pictures"]) == 0
    assert "Causal, to follow K_edot over time: rls" in capsys.readouterr().out


@pytest.mark.slow  # simulates studies
def test_experiment_of_ones_own_files(capsys, run_json):
    X, y = make_tracking_runs("C4", 3, remnant_intensity=0.1, random_state=0)
    write_runs(X.rename(columns={"e": "error"}), y.rename("stick"), "runs.csv")
    words = ["study", "experiment", "runs.csv", "--time", "time", "--run", "run"]
    words += ["--input", "error", "--output", "stick"]
    assert main([*words, "--no-pictures", "--out", "out"]) == 0
    assert "scores.csv" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("fig99", "No study 'fig99'"),
        ("nonsense", "there are list, experiment, recommend, tournament, all, fig9"),
        ("list run.csv", "Only 'experiment' takes files; 'list' does not."),
        ("fig12 --no-pictures", "--no-pictures needs --out FOLDER"),
        ("recommend --conditions C1 C2", "takes one condition"),
        ("fig9 --conditions C7", "Unknown condition 'C7'"),
        ("fig9 --question follow", "--question does not apply to the study 'fig9'"),
        ("appI --validation 2", "--validation does not apply to the study 'appI'"),
        ("recommend --causal", "--causal needs --question"),
        ("recommend --methods rls", "--methods needs --question"),
        ("tournament --methods rsl", "Unknown method 'rsl'"),
        ("experiment --input e", "--input does not apply to the study 'experiment' here"),
        ("experiment run.csv --time t --seed 0", "--seed does not apply"),
        ("recommend --question detect --conditions C1", "Nothing changes"),
        ("fig13 --intensities 0.12", "--gains tuned"),
    ],
)
def test_what_a_study_cannot_take_is_said(line, message, capsys):
    assert main(["study", *line.split()]) == 2
    assert message in capsys.readouterr().err
