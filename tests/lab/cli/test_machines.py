"""Recordings of machines through whole commands: pages, time limits, words."""

import json
import shlex

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from skhoid.lab.cli import main

N = 900
FEW = 300
RNG = np.random.default_rng(0)
MOVING = np.convolve(RNG.standard_normal(N), np.ones(15) / 4, "same")
WITH_FINDINGS = {  # what the check of a recording speaks of
    "held input": np.repeat(RNG.uniform(-1, 1, N // 25), 25),
    "saturated": np.clip(MOVING, -0.3, 0.3),
    "square": np.sign(np.sin(np.arange(N) / 30)),
    "one step": np.where(np.arange(N) > N // 2, 2.0, 0.0),
    "spikes": np.where(np.arange(N) % 100 == 7, 50.0, MOVING),
}


def written(e, name="r.csv"):
    """A file of a machine of first order."""
    y = lfilter([0, 0.2], [1, -0.8], e) + 0.02 * np.random.default_rng(1).standard_normal(len(e))
    table = pd.DataFrame({"time": np.arange(len(e)) * 0.1, "u": e, "y": y})
    table.to_csv(name, index=False)
    return [name, "--input", "u", "--output", "y"]


@pytest.mark.slow
@pytest.mark.parametrize("kind", WITH_FINDINGS)
def test_a_page_is_written_where_the_check_finds_something(tmp_path, kind):
    words = ["diagnose", *written(WITH_FINDINGS[kind]), "--core", "arx", "--nk", "1"]
    assert main([*words, "--effects", "bias", "--no-pictures", "--report", "p.html"]) == 0
    if kind == "held input":
        assert "What to check in the recording" in (tmp_path / "p.html").read_text()


def test_a_time_limit_is_kept_and_what_was_not_tried_is_listed(capsys):
    given = written(MOVING)
    core = ["--core", "arx", "--nk", "1", "--no-pictures", "--time-limit", "0.001"]
    assert main(["diagnose", *given, *core, "--effects", "bias", "saturation"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "Nothing found before the time limit" in out
    assert "Not tried: bias and saturation" in out
    assert "--time-limit SECONDS" in out


def next_commands(text):
    """Commands that are printed in the end, as words."""
    lines = text[text.index("What to do next") :].splitlines()[1:]
    commands = [line.split("  ")[1] for line in lines if line.startswith("  skhoid ")]
    return [shlex.split(command)[1:] for command in commands]


SAME = ["parameters", "error_path", "ranking", "verdict", "n_rows", "inputs", "output", "dt_s"]


def test_the_page_that_is_offered_has_the_same_figures(capsys):
    options = "--core arx --na 1 --nb 1 --nk 2 --remove-means --run-in 5 --effects bias"
    given = ["diagnose", *written(MOVING[:FEW]), *options.split(), "--no-pictures"]
    assert main(given) == 0
    page = next_commands(capsys.readouterr().out)[0]
    assert page[0] == "report"
    figures = []
    for command in (given, page):
        assert main([*command, "--json"]) == 0
        found = json.loads(capsys.readouterr().out)
        figures.append({name: found[name] for name in SAME})
    assert figures[0] == figures[1]


ANALYSES = [
    "--domain machine --core arx --nk 1 --lost-control keep",
    "--core arx --nk 2 --display pursuit",
]


@pytest.mark.parametrize("said", ANALYSES)
def test_the_page_that_is_offered_keeps_what_was_said(capsys, said):
    options = [*said.split(), "--effects", "bias", "--max-effects", "0"]
    assert main(["diagnose", *written(MOVING[:FEW]), *options, "--no-pictures"]) == 0
    assert {*options} <= {*next_commands(capsys.readouterr().out)[0]}


IDENTIFIED = [
    ("--nk 1 --na 1 --nb 1 --unit y=deg", "--core arx --na 1 --nb 1 --unit y=deg"),
    ("--domain machine --nk 1", "--core arx --nk 1 --domain machine"),
    (
        "--run-in 3 --nk 2 --time time --dt 0.1 --resample",
        "--run-in 3 --nk 2 --dt 0.1 --resample",
    ),
]


@pytest.mark.parametrize(("words", "kept"), IDENTIFIED)
def test_the_search_that_is_offered_keeps_what_was_said(capsys, words, kept):
    assert main(["identify", *written(MOVING[:FEW]), *words.split(), "--no-pictures"]) == 0
    (command,) = next_commands(capsys.readouterr().out)
    assert command[0] == "diagnose"
    assert {*kept.split(), "--input", "--output"} <= {*command}
    assert main([*command, "--effects", "bias", "--max-effects", "0", "--no-pictures"]) == 0


def test_of_several_inputs_the_first_is_searched_and_the_others_stay_channels(capsys):
    e = RNG.standard_normal((2, N))
    y = lfilter([0, 0.2], [1, -0.8], e[0]) + lfilter([0, 0.1], [1, -0.5], e[1])
    pd.DataFrame({"time": np.arange(N) * 0.1, "a": e[0], "b": e[1], "y": y}).to_csv("r.csv")
    words = ["identify", "r.csv", "--input", "a", "b", "--output", "y", "--nk", "1", "--na", "1"]
    assert main([*words, "--no-pictures"]) == 0
    out = capsys.readouterr().out
    (command,) = next_commands(out)
    assert command[command.index("--input") + 1] == "a"
    assert "b=" in command
    assert "of 'a' alone" in out
    assert main([*command, "--effects", "bias", "--no-pictures"]) == 0


@pytest.mark.parametrize("rate", [100, 1e5])
def test_short_records_at_high_rates_are_searched(capsys, rate):
    given = written(MOVING[:150])
    table = pd.read_csv("r.csv")
    table.assign(time=np.arange(150) / rate).to_csv("r.csv", index=False)
    core = ["--core", "arx", "--nk", "1", "--effects", "bias", "--no-pictures"]
    assert main(["diagnose", *given, *core]) == 0
    out = capsys.readouterr().out
    assert f"{150 / rate:.3g} s in all" in out
    assert main(["identify", *given, "--domain", "machine", "--no-pictures", "--json"]) == 0
    delay = json.loads(capsys.readouterr().out)["delay"]["one_step"]
    assert delay["seconds"] == pytest.approx(delay["nk"] / rate)
    assert delay["nk"] == 1


def test_the_halves_are_of_what_the_run_in_leaves(capsys):
    given = written(MOVING)  # 90 s
    assert main(["identify", *given, "--run-in", "40", "--no-pictures"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "Fitted on run 'r', 40 to 65 s; held out run 'r', after 65 s" in out


@pytest.mark.parametrize("words", [["identify", "--no-pictures"], ["diagnose", "--no-pictures"]])
def test_numbers_are_whole_in_narrow_terminals(capsys, monkeypatch, words):
    monkeypatch.setenv("COLUMNS", "44")
    given = written(MOVING)
    pd.read_csv("r.csv").rename(columns={"u": "a_long_name_of_an_input"}).to_csv("r.csv")
    given[2] = "a_long_name_of_an_input"
    effects = ["--core", "arx", "--effects", "bias"] if words[0] == "diagnose" else []
    assert main([words[0], *given, *effects, "--nk", "1", *words[1:]]) == 0
    out = capsys.readouterr().out
    assert "…" not in out
    b0 = next(line for line in out.splitlines() if line.startswith("b0 "))
    assert float(b0.split()[1]) == pytest.approx(0.2, abs=0.01)
    assert float(b0.split()[2]) < 0.01


SQUARE_ROOT = [(4.0, 1.2, 3), (3.0, 1.0, 8), (2.0, 0.5, 13)]


@pytest.mark.parametrize(("first", "second", "seed"), SQUARE_ROOT)
def test_three_parameters_on_thousands_of_rows_are_no_overfit(capsys, first, second, seed):
    """A square root in the plant: the halves differ, and the model is too simple."""
    rng, n = np.random.default_rng(seed), 4000
    level = np.where(np.arange(n) < n // 2, first, second)
    steps = np.repeat(rng.standard_normal(n // 20), 20)
    e = level * (1 + 0.8 * lfilter([0.3], [1, -0.7], steps).clip(-1, 1))
    u = lfilter([0, 0, 0.1], [1, -0.9], np.sqrt(e)) + 0.002 * rng.standard_normal(n)
    pd.DataFrame({"time": np.arange(n) * 0.05, "e": e, "u": u}).to_csv("r.csv", index=False)
    words = ["identify", "r.csv", "--no-pictures", "--na", "1", "--nb", "1", "--nk", "2", "--json"]
    assert main(words) == 0
    found = json.loads(capsys.readouterr().out)
    (model,) = found["models"]
    assert model["verdict"] in ("worse held out", "fails on validation data")
    if model["verdict"] == "worse held out":
        assert any("too simple" in note for note in found["notes"])


@pytest.mark.parametrize("seed", range(2))
def test_many_parameters_on_few_rows_can_have_learnt_the_noise(capsys, seed):
    rng, n = np.random.default_rng(seed), 240
    e = rng.standard_normal(n)
    u = lfilter([0, 0.2], [1, -0.6], e) + 0.3 * rng.standard_normal(n)
    pd.DataFrame({"time": np.arange(n) * 0.1, "e": e, "u": u}).to_csv("r.csv", index=False)
    words = ["identify", "r.csv", "--no-pictures", "--na", "12", "--nb", "12", "--nk", "1"]
    assert main([*words, "--domain", "machine", "--json"]) == 0
    (model,) = json.loads(capsys.readouterr().out)["models"]
    assert model["verdict"] != "worse held out"


def test_pages_of_runs_shorter_than_a_person_settles():
    """Spikes, of a person by default: limits that have no power to compare with, a short run."""
    n = 40
    spikes = np.where(np.arange(n) % 13 == 5, 5.0, 0.0)
    given = written(spikes + 0.01 * RNG.standard_normal(n))
    table = pd.read_csv("r.csv")
    table.assign(time=np.arange(n) / 50, y=5 * table["y"]).to_csv("r.csv", index=False)
    assert main(["report", *given, "--effects", "lapses", "--domain", "machine"]) == 0
