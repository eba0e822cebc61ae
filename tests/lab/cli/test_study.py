"""The command ``skhoid study``."""

import json

import pandas as pd
import pytest

from skhoid import make_tracking_runs, write_runs
from skhoid.lab.cli import main
from skhoid.lab.cli import study as arguments
from skhoid.lab.studies.tournament_conditions import SIZES
from skhoid.lab.studies.tournament_scores import QUESTIONS

pytestmark = pytest.mark.slow  # simulates studies

SMALL = ["--conditions", "C1", "--intensities", "0.1", "--replications", "3"]


def test_list(capsys):
    assert main(["study", "list"]) == 0
    out = capsys.readouterr().out
    assert "fig13" in out
    assert "experiment" in out


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


def test_json(capsys):
    words = ["study", "fig13", *SMALL, "--validation", "2", "--json", "--jobs", "2"]
    assert main(words) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["study"] == "fig13"
    assert found["failed"] == 0
    assert found["claims"][0]["holds"] is None


def test_all(capsys, tmp_path):
    words = ["study", "all", "--replications", "2", "--validation", "1", "--json"]
    words += ["--conditions", "C1", "--intensities", "0", "0.1", "--orders", "2", "nm"]
    assert main([*words, "--out", str(tmp_path), "--no-pictures"]) == 0
    found = json.loads(capsys.readouterr().out)["studies"]
    assert [one["study"] for one in found] == ["appG", "fig12", "fig13", "appI", "appK"]
    assert (tmp_path / "appK" / "claims.csv").exists()


def test_recommend(capsys, tmp_path):
    words = ["study", "recommend", "--conditions", "C4", "--intensities", "0.1", "--rate", "50"]
    words += ["--replications", "4", "--validation", "3"]
    assert main([*words, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["memory_horizon"] in (64, 128, 256)
    assert main([*words, "--out", str(tmp_path)]) == 0
    assert "samples" in capsys.readouterr().out
    assert (tmp_path / "recommend" / "trade-off.png").exists()


def test_recommend_a_method(capsys, run_json):
    words = ["study", "recommend", "--question", "follow", "--methods", "rls", "arx"]
    words += ["--conditions", "C4", "--replications", "2", "--validation", "1"]
    found = run_json(*words)
    assert found["method"] == "rls"
    assert found["close"] == ["rls"]
    assert found["estimator"].startswith("RecursiveARX(memory_time=")


def test_recommend_a_method_in_words(capsys, tmp_path):
    words = ["study", "recommend", "--question", "detect", "--causal", "--orders", "nm"]
    words += ["--replications", "2", "--methods", "rls", "rls_smooth", "--out", str(tmp_path)]
    assert main(words) == 0
    assert "To see from K_edot that something changed: rls (" in capsys.readouterr().out
    assert (tmp_path / "recommend" / "ranking.csv").exists()
    assert (tmp_path / "recommend" / "bias.png").stat().st_size > 5000


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


def test_experiment(capsys, tmp_path):
    words = ["study", "experiment", "--subjects", "2", "--runs", "4", "--last", "3"]
    words += ["--conditions", "C4", "--out", str(tmp_path)]
    assert main(words) == 0
    assert "S2" in capsys.readouterr().out
    made = {path.name for path in (tmp_path / "experiment").iterdir()}
    assert {"scores.csv", "verdicts.csv", "C4-lambda-arx.png", "C4-Lambda-operator.png"} <= made


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


def test_choices_are_those_of_the_package():
    assert tuple(QUESTIONS) == arguments.QUESTIONS
    assert arguments.SIZES == SIZES


def test_list_as_json(run_json):
    studies = run_json("study", "list")["studies"]
    assert {"fig13", "experiment", "recommend", "tournament", "all"} <= set(studies)


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
