"""The commands ``skhoid demo`` and ``skhoid diagnose``."""

import re
from pathlib import Path

import pandas as pd
import pytest
from matplotlib.figure import Figure
from support.shapes import Fechner

from skhoid import make_tracking_runs, write_runs
from skhoid.lab.cli import main
from skhoid.lab.cli.files import save_figures

FEW = ["--effects", "bias", "drift", "saturation"]


def demo(run_json, *words):
    return run_json("demo", *words, "--no-pictures", "--no-report")


def diagnose(run_json, *words):
    return run_json("diagnose", *words, "--no-pictures")


@pytest.mark.slow
def test_demo_finds_what_it_hides(run_json):
    words = ["--runs", "3", "--effect", "bias", "--effects", "bias", "drift"]
    found = demo(run_json, *words)
    assert found["hidden"] == found["best_effects"] == ["bias"]
    vaf = [step["vaf"] for step in found["error_path"]]
    assert vaf[1] - vaf[0] > 5
    assert vaf[1] == pytest.approx(found["truth_vaf"], abs=0.5)


@pytest.mark.slow
def test_the_seed_of_the_demo_has_a_default(run_json):
    words = ["--runs", "2", "--effect", "bias", "--effects", "bias"]
    assert demo(run_json, *words) == demo(run_json, *words)


@pytest.mark.slow
def test_demo_prints_the_story_and_the_truth_and_draws(capsys, tmp_path):
    save_figures({"drift.png": Figure(), "ranking-5.png": Figure()}, tmp_path, "demo")
    words = ["--runs", "2", "--effect", "bias", "--effects", "bias", "--out", str(tmp_path)]
    words.append("--no-report")
    assert main(["demo", *words]) == 0
    printed = capsys.readouterr().out
    for expected in ("Verdict: effects found: bias", "with bias: held-out VAF", "hidden bias"):
        assert expected in printed
    assert re.search(r"bias: level +0\.05 +0\.0", printed)
    assert "What to do next" in printed.split("\n\n")[-1]
    assert max(len(s) for s in printed.splitlines() if str(tmp_path) not in s) <= 80
    names = {path.name for path in tmp_path.iterdir()}
    assert {"comparison.png", "ranking-1.png", "error-path.png", "bias.png"} <= names
    assert not {"drift.png", "ranking-5.png"} & names  # of an earlier demo


@pytest.mark.slow
def test_demo_with_nothing_hidden_says_so(run_json):
    words = ["--runs", "2", "--effect", "none", "--effects", "bias", "saturation"]
    found = demo(run_json, *words)
    assert (found["verdict"], found["best_effects"]) == ("nothing is missing", [])


@pytest.mark.slow
def test_diagnose_own_files(run_json, biased_file):
    found = diagnose(run_json, *biased_file, *FEW)
    assert found["best_effects"] == ["bias"]
    assert (found["inputs"], found["output"], found["n_runs"]) == (["error"], "stick", 3)
    level = next(p for p in found["parameters"] if p["parameter"] == "bias__level")
    assert level["value"] == pytest.approx(0.1, abs=0.01)
    assert found["comparison"]["noise_ceiling"] > 90  # of the target, by its role


@pytest.mark.slow
def test_diagnose_draws_and_tells_what_has_no_name(capsys, tmp_path):
    X, y = make_tracking_runs(
        "C1", n_runs=4, remnant_intensity=0.1, random_state=0, effects=Fechner(knee=0.15)
    )
    write_runs(X, y, "runs.csv")
    words = ["--effects", "bias", "--out", "pictures", "--tables", "tables"]
    assert main(["diagnose", "runs.csv", *words]) == 0
    printed = capsys.readouterr().out
    assert "The shape of what has no name: it acts on the error" in printed
    assert "Curve of what has no name" in printed
    assert "--sketch my_effect.py" in printed.split("What to do next")[1]
    assert Path("pictures/shape.png").is_file()
    curve = pd.read_csv("tables/shape.tsv", sep="\t")
    assert list(curve) == ["e", "value", "low", "high"]


@pytest.mark.slow
def test_diagnose_takes_delay_display_element_and_run_in(run_json, biased_file):
    words = ["--delay", "0.28", "--display", "pursuit", "--controlled-element", "90", "6"]
    found = diagnose(run_json, *biased_file, *FEW, *words, "--run-in", "4")
    delay = next(p for p in found["baseline"] if p["parameter"] == "tau_e")
    assert delay["value"] == 0.28
    assert found["best_effects"] == ["bias"]


@pytest.mark.slow
def test_diagnose_with_an_arx_core(run_json, biased_file):
    words = ["--core", "arx", "--nk", "15"]
    found = diagnose(run_json, *biased_file, *FEW, *words)
    assert [p["parameter"] for p in found["baseline"]] == ["a1", "a2", "b0", "b1"]
    assert found["best_effects"] == ["bias"]
    found = diagnose(run_json, *biased_file, *FEW, *words, "--na", "1", "--nb", "3")
    assert [p["parameter"] for p in found["baseline"]] == ["a1", "b0", "b1", "b2"]


@pytest.mark.slow
def test_diagnose_the_bundled_recordings(run_json):
    found = diagnose(run_json, "--effects", "dead_zone", "bias")
    assert (found["n_runs"], found["inputs"], found["units"]["x"]) == (4, ["f_t"], "px")
    assert found["error_path"][0]["vaf"] > 90
    assert found["comparison"]["noise_ceiling"] > found["error_path"][0]["vaf"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["demo", "--effect", "dedd_zone"], "No effect is called 'dedd_zone'"),
        (["demo", "--effect", "dedd_zone"], "Did you mean 'dead_zone'?"),
        (["demo", "--effect", "none", "bias"], "--effect none hides nothing"),
        (["demo", "--effects", "none"], "leave --effects out to search for all"),
        (["diagnose", "--effects", "none"], "leave --effects out to search for all"),
        (["report", "--effects", "none", "bias"], "--effects none stands alone"),
        (["report", "--effects", "all", "bias"], "--effects all takes no other names"),
        (["diagnose", "nothing-here.csv", "--time", "t"], "nothing-here.csv"),
        (["diagnose", "run.csv", "--time", "t", "--role", "roll"], "--role takes NAME=ROLE"),
        (["diagnose", "--na", "2"], "--na needs --core arx.\n"),
        (["diagnose", "--nb", "2", "--core", "operator"], "--nb needs --core arx.\n"),
        (["report", "--nk", "0"], "--nk needs --core arx.\n"),
        (["report", "--core", "arx", "--delay", "0.2"], "--delay needs --core operator.\n"),
        (["diagnose", "--effects", "dedd_zone"], "No effect is called 'dedd_zone'"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(capsys, words, message):
    assert main(words) == 2
    printed = capsys.readouterr()
    assert printed.err.startswith("skhoid: error: ")
    assert message in printed.err
