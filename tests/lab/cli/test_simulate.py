"""The command ``skhoid simulate``."""

import json
import shlex
from pathlib import Path

import numpy as np
import pytest

from skhoid import make_tracking_runs, read_runs
from skhoid.lab.cli import main


@pytest.mark.parametrize("extension", ["csv", "mat"])
def test_simulated_runs_can_be_identified(capsys, tmp_path, extension):
    path = str(tmp_path / f"some runs.{extension}")
    words = ["--condition", "c1", "--runs", "2", "--remnant", "0.05"]
    assert main(["simulate", *words, "--seed", "3", "--out", path]) == 0
    printed = capsys.readouterr().out
    assert "2 runs of C1, 16384 rows at 100 Hz" in " ".join(printed.split())
    assert "wanted 0.05" in printed
    next_words = shlex.split(printed.split("next: skhoid ")[1])
    assert next_words == ["diagnose", path]
    words = ["--na", "2", "--nb", "2", "--nk", "29", "--no-pictures"]
    assert main(["identify", path, *words, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["n_rows"] == 16384
    assert found["models"][0]["vaf_validation"] > 90
    X, _ = make_tracking_runs("C1", n_runs=2, remnant_intensity=0.05, random_state=3)
    again, _ = read_runs(
        path, inputs="e", output="u", time="time", run=None if extension == "mat" else "run"
    )
    np.testing.assert_array_equal(again["e"], X["e"])


@pytest.mark.parametrize(
    ("picture", "message"),
    [
        ("precious.png", "precious.png exists; choose another name, or --overwrite."),
        ("runs.csv", "runs.csv is no image file; its name ends in one of "),
    ],
)
def test_a_picture_is_checked_before_anything_is_written(capsys, picture, message):
    Path("precious.png").write_text("precious")
    words = ["simulate", "--runs", "1", "--out", "runs.csv", "--picture"]
    assert main([*words, picture]) == 2
    assert message in capsys.readouterr().err
    assert not Path("runs.csv").exists()
    assert Path("precious.png").read_text() == "precious"
    if picture == "precious.png":
        assert main([*words, picture, "--overwrite"]) == 0
        assert Path(picture).stat().st_size > 10_000


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--condition", "C9"], "known are C1, C2, C3, C4, C5, C6"),
        (["--remnant", "15"], "15 percent is 0.15"),
        (["--condition", "C2", "--remnant", "0.9"], "No gain gives P_n = 0.9"),
        (["--rate", "10"], "too slow for the neuromuscular mode"),
    ],
)
def test_simulate_says_what_is_wrong(capsys, tmp_path, words, message):
    out = tmp_path / "runs.csv"
    assert main(["simulate", *words, "--out", str(out)]) == 2
    assert message in capsys.readouterr().err
    assert not out.exists()


def test_json_says_what_is_in_the_file(run_json):
    words = ["--runs", "2", "--remnant", "0.1", "--rate", "50", "--seed", "4", "--out", "a b.tsv"]
    found = run_json("simulate", *words)
    assert (found["file"], found["n_runs"], found["seed"]) == ("a b.tsv", 2, 4)
    assert found["channels"] == ["e", "x", "f_t", "u"]
    assert all(0.05 < share < 0.2 for share in found["remnant"].values())
    X, _ = read_runs("a b.tsv", inputs="e", output="u", time="time", run="run")
    assert found["n_rows"] == len(X)
    assert found["next"] == "skhoid diagnose 'a b.tsv'"
