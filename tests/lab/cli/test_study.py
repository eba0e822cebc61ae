"""The command ``skhoid study``."""

import json

import pandas as pd
import pytest

from skhoid import make_tracking_runs, write_runs
from skhoid.lab.cli import main

SMALL = ["--conditions", "C1", "--intensities", "0.1", "--replications", "3"]


def test_list(capsys):
    assert main(["study", "list"]) == 0
    out = capsys.readouterr().out
    assert "fig13" in out
    assert "experiment" in out


@pytest.mark.slow  # simulates studies
def test_words_and_files(capsys, tmp_path):
    words = ["study", "fig12", *SMALL, "--validation", "2", "--out", str(tmp_path)]
    assert main(words) == 0
    out = capsys.readouterr().out
    assert "[holds] Fig. 12" in out
    assert f"Files in {tmp_path / 'fig12'}: " in " ".join(out.split())
    assert "claims.csv" in out
    assert (tmp_path / "fig12" / "fig12.png").stat().st_size > 5000
    assert main(words) == 0  # goes on: all is there
    assert main([*words, "--seed", "1"]) == 2
    assert "belongs to a different study: entropy" in capsys.readouterr().err


@pytest.mark.slow  # simulates studies
def test_json(capsys):
    words = ["study", "fig13", *SMALL, "--validation", "2", "--json", "--jobs", "2"]
    assert main(words) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["study"] == "fig13"
    assert found["failed"] == 0
    assert found["claims"][0]["holds"] is None


@pytest.mark.slow  # simulates studies
def test_all(capsys, tmp_path):
    words = ["study", "all", "--replications", "2", "--validation", "1", "--json"]
    words += ["--conditions", "C1", "--intensities", "0", "0.1", "--orders", "2", "nm"]
    assert main([*words, "--out", str(tmp_path), "--no-pictures"]) == 0
    found = json.loads(capsys.readouterr().out)["studies"]
    assert [one["study"] for one in found] == ["appG", "fig12", "fig13", "appI", "appK"]
    assert (tmp_path / "appK" / "claims.csv").exists()


@pytest.mark.slow  # simulates studies
def test_recommend(capsys, tmp_path):
    words = ["study", "recommend", "--conditions", "C4", "--intensities", "0.1", "--rate", "50"]
    words += ["--replications", "4", "--validation", "3"]
    assert main([*words, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["memory_horizon"] in (64, 128, 256)
    assert main([*words, "--out", str(tmp_path)]) == 0
    assert "samples" in capsys.readouterr().out
    assert (tmp_path / "recommend" / "trade-off.png").exists()


@pytest.mark.slow  # simulates studies
def test_recommend_a_method(capsys, run_json):
    words = ["study", "recommend", "--question", "follow", "--methods", "rls", "arx"]
    words += ["--conditions", "C4", "--replications", "2", "--validation", "1"]
    found = run_json(*words)
    assert found["method"] == "rls"
    assert found["close"] == ["rls"]
    assert found["estimator"].startswith("RecursiveARX(memory_time=")


@pytest.mark.slow  # simulates studies
def test_tournament(capsys, tmp_path, run_json):
    words = ["study", "tournament", "--size", "small", "--methods", "rls", "arx"]
    words += ["--conditions", "C1", "C4", "--replications", "2", "--validation", "1"]
    assert main([*words, "--out", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "- Causal, to follow K_edot over time: rls" in out
    folder = tmp_path / "tournament"
    made = {path.name for path in folder.iterdir()}
    assert {"blocks", "table.csv.gz", "summary.csv", "winners.png", "settling.png"} <= made
    found = run_json(*words, "--out", str(tmp_path), "--no-pictures", "--table-format", "parquet")
    assert list(found["ranking"]["causal"]) == ["rls"]
    assert f"{folder}/by_cell.parquet" in found["files"]


@pytest.mark.slow  # simulates studies
def test_experiment(capsys, tmp_path):
    words = ["study", "experiment", "--subjects", "2", "--runs", "4", "--last", "3"]
    words += ["--conditions", "C4", "--out", str(tmp_path)]
    assert main(words) == 0
    assert "S2" in capsys.readouterr().out
    made = {path.name for path in (tmp_path / "experiment").iterdir()}
    assert {"scores.csv", "verdicts.csv", "C4-lambda-arx.png", "C4-Lambda-operator.png"} <= made


@pytest.mark.slow  # simulates studies
def test_experiment_of_ones_own_files(capsys, tmp_path):
    X, y = make_tracking_runs("C4", 3, remnant_intensity=0.1, random_state=0)
    write_runs(X.rename(columns={"e": "error"}), y.rename("stick"), tmp_path / "runs.csv")
    words = ["study", "experiment", str(tmp_path / "runs.csv"), "--time", "time", "--run", "run"]
    words += ["--input", "error", "--output", "stick", "--json"]
    assert main(words) == 0
    assert "all" in json.loads(capsys.readouterr().out)["summary"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["fig99"], "No study 'fig99'"),
        (["nonsense"], "there are list, experiment, recommend, tournament, all, fig9"),
        (["list", "run.csv"], "Only 'experiment' takes files; 'list' does not."),
        (["fig12", "--no-pictures"], "--no-pictures needs --out FOLDER"),
        (["recommend", "--table-format", "tsv"], "--table-format needs --out FOLDER"),
        (["appI", "--orders", "2"], "--orders does not apply to the study 'appI'"),
        (["fig13", "run.csv"], "Only 'experiment' takes files"),
        (["recommend", "--conditions", "C1", "C2"], "takes one condition"),
        (["fig9", "--conditions", "C7"], "Unknown condition 'C7'"),
        (["fig9", "--question", "follow"], "--question does not apply to the study 'fig9'"),
        (["recommend", "--causal"], "--causal does not apply to 'recommend'"),
        (["tournament", "--rate", "50"], "--rate does not apply to 'tournament'"),
        (["tournament", "--conditions", "C9"], "Unknown condition 'C9'"),
        (["tournament", "--methods", "rsl"], "Unknown method 'rsl'"),
        (["recommend", "--question", "detect", "--conditions", "C1"], "Nothing changes"),
        (["fig13", "--intensities", "0.12"], "--gains tuned"),
    ],
)
def test_errors(words, message, capsys):
    assert main(["study", *words]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("form", ["tsv", "parquet"])
def test_table_formats(run_json, form):
    words = ["fig12", *SMALL, "--validation", "2", "--out", "out", "--no-pictures"]
    files = run_json("study", *words, "--table-format", form)["files"]
    packed = "" if form == "parquet" else ".gz"
    assert files == [
        f"out/fig12/{n}" for n in (f"table.{form}{packed}", f"summary.{form}", f"claims.{form}")
    ]
    read = pd.read_parquet if form == "parquet" else lambda path: pd.read_csv(path, sep="\t")
    assert len(read(files[0])) >= 3
    assert set(read(files[2])) == {"source", "statement", "found", "holds"}


# Options that a study has not.

FILES = ["run.csv", "--time", "t"]
WORDS = {
    "output": ["--output", "u"],
    "time": ["--time", "t"],
    "dt": ["--dt", "0.01"],
    "run": ["--run", "run"],
    "unit": ["--unit", "e=deg"],
    "resample": ["--resample"],
    "input": ["--input", "e"],
    "rate": ["--rate", "50"],
    "last": ["--last", "1"],
    "measurement-time": ["--measurement-time", "80"],
    "replications": ["--replications", "2"],
    "validation": ["--validation", "2"],
    "conditions": ["--conditions", "C1"],
    "intensities": ["--intensities", "0"],
    "orders": ["--orders", "2"],
    "gains": ["--gains", "table"],
    "subjects": ["--subjects", "1"],
    "runs": ["--runs", "2"],
    "seed": ["--seed", "0"],
    "jobs": ["--jobs", "1"],
    "out": ["--out", "out"],
    "no-pictures": ["--no-pictures"],
    "table-format": ["--table-format", "csv"],
}
OF_FILES = ["output", "time", "dt", "run", "unit", "resample", "input", "measurement-time"]
SIMULATED = ["subjects", "runs", "last"]
STRAY = {
    ("list",): [*WORDS],
    ("all",): [*OF_FILES, *SIMULATED, "rate"],
    ("fig9",): [*OF_FILES, *SIMULATED, "rate"],
    ("appI",): [*OF_FILES, *SIMULATED, "rate", "orders", "validation"],
    ("recommend",): [*OF_FILES, *SIMULATED, "orders", "gains"],
    ("experiment",): [
        *OF_FILES,
        *("replications", "validation", "intensities", "orders", "rate", "gains"),
    ],
    ("experiment", *FILES): [
        *("replications", "validation", "conditions", "intensities", "orders", "rate", "gains"),
        *("subjects", "runs", "seed"),
    ],
}


@pytest.mark.parametrize(("words", "options"), STRAY.items(), ids=lambda part: part[0])
def test_options_that_a_study_has_not(capsys, words, options):
    for option in options:
        assert main(["study", *words, *WORDS[option]]) == 2
        said = capsys.readouterr().err
        assert said.startswith(f"skhoid: error: --{option} does not apply to "), said
