"""The command ``skhoid experiment``: from files of several people to one page."""

import json
from pathlib import Path

import pandas as pd
import pytest

from skhoid import simulate_experiment
from skhoid.lab.cli import main


@pytest.fixture
def recordings(tmp_path):
    """A folder with a file for each run of three people in two conditions."""
    folder = tmp_path / "recordings"
    folder.mkdir()
    X, y = simulate_experiment(
        3, ["C1", "C2"], runs=2, duration=15.0, run_in=2.0, sampling_rate=50.0, random_state=1
    )
    for key, part in X.groupby(level=["subject", "condition", "run"]):
        table = part.reset_index()[["time", "e", "x", "f_t"]]
        table["stick"] = y.loc[part.index].to_numpy()
        table["time"] -= table["time"].min()
        name = "{}_{}_run{}.csv".format(*key)
        table.round(6).to_csv(folder / name, index=False)
    return folder


@pytest.mark.slow
def test_from_files_to_page_and_tables(capsys, recordings):
    words = ["experiment", str(recordings), "--effects", "none", "--core", "arx", "--nk", "14"]
    assert main([*words, "--reference", "C1", "--tables", "tables", "--title", "Friday"]) == 0
    printed = capsys.readouterr()
    assert "3 people, 2 conditions" in printed.out
    assert "Nothing looks wrong." in printed.out
    assert "Report: experiment.html (one file; open it in a browser)" in printed.out
    page = Path("experiment.html").read_text()
    assert "<title>Friday</title>" in page
    assert "skhoid experiment" in page  # how it was made
    assert "C2 - C1" in page
    written = {path.name for path in Path("tables").iterdir()}
    assert written >= {"parameters.tsv", "parameters_long.csv", "mixed_models.R", "outlying.tsv"}
    wide = pd.read_csv("tables/parameters_wide.csv")
    assert len(wide) == 3
    assert main([*words, "--reference", "C1"]) == 2
    assert "experiment.html exists; choose another name, or --overwrite" in capsys.readouterr().err


@pytest.mark.slow
def test_a_search_in_the_group_as_json(capsys, recordings):
    pattern = str(recordings / "{subject}_{condition}_run{run}.csv")
    words = ["experiment", pattern, "--effects", "bias", "--run-in", "2"]
    assert main([*words, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["report"] == "experiment.html"
    assert {"group_effects", "prevalence", "members", "statistics"} <= found.keys()
    assert len(found["people"]) == 6


def test_packages_are_asked_for_before_anything_is_read(capsys, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    words = ["nothing-here", "--tables", "tables", "--table-format", "parquet"]
    assert main(["experiment", *words]) == 2
    assert 'needs the package pyarrow: pip install "skhoid[io]"' in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--subject", "who"], "--subject is about files, and there are none"),
        (["x.csv", "--effects", "none", "--display", "pursuit"], "--display is for the search"),
        (["x.csv", "--na", "2"], "--na needs --core arx"),
        (["nothing-here"], "nothing-here"),
    ],
)
def test_what_cannot_be_done_is_refused_at_once(capsys, words, said):
    assert main(["experiment", *words]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.slow
def test_one_person_is_no_group(capsys, recordings):
    assert main(["experiment", str(recordings / "S1_*.csv")]) == 2
    assert "a group needs two" in capsys.readouterr().err
    words = ["experiment", str(recordings), "--reference", "C9", "--effects", "none"]
    assert main(words) == 2
    assert "--reference is one of C1, C2; got 'C9'" in capsys.readouterr().err


@pytest.mark.slow
def test_a_stopped_experiment_goes_on_where_it_was(capsys, recordings):
    words = ["experiment", str(recordings), "--effects", "none", "--core", "arx", "--nk", "14"]

    def fitted(*more):
        assert main([*words, "--tables", ".", "--overwrite", *more]) == 0
        said = capsys.readouterr().err
        return said.count(" min left"), said

    n, said = fitted()
    assert n == 6
    assert "parameters: S1 C1, 1 of 6 done, 0 min left\n" in said
    whole = Path("parameters.tsv").read_text()
    for block in list(Path("experiment.kept").rglob("block-*"))[:2]:  # as if stopped before them
        block.unlink()
    assert fitted("--jobs", "2")[0] == 2
    assert Path("parameters.tsv").read_text() == whole
    n, said = fitted("--na", "3")
    assert n == 6
    assert "experiment.kept was kept of other recordings or options (model[1].na: 2" in said
    assert "all begins anew" in said
    assert fitted("--na", "3")[0] == 0
    assert fitted("--na", "3", "--fresh")[0] == 6
