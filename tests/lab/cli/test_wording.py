"""Messages that say what to do in Python, on the command line."""

import pandas as pd
import pytest

from skhoid import make_tracking_runs, write_runs
from skhoid.exceptions import PYTHON_ONLY
from skhoid.lab.cli import main
from skhoid.lab.cli.parser import make_parsers
from skhoid.lab.cli.wording import reworded


@pytest.mark.parametrize(
    ("words", "text", "said"),
    [
        ("identify", "Give it as dt= (in seconds).", "--dt."),
        ("identify", "Irregular; resample_runs brings it onto a grid.", "--resample."),
        ("identify", "with X, y = skhoid.resample_runs(X, y, dt=0.01).", "--resample, --dt."),
        ("identify", "state it with units={'time': ...}.", "--unit."),
        ("identify", "Leave the run out (skhoid.select_runs), or less", "leave it out of FILES."),
        ("diagnose", "another role, or none, by roles={column: ''}.", "--role."),
        ("diagnose", "Leave one out (inputs=[...]).", "--input."),
        ("study list", "run_in= or measurement_time= does", "--measurement-time."),
        ("simulate --out x.csv", "Give it as dt= (in seconds).", None),
        ("identify", "nk must be at least 0; got -1.", None),
        ("identify", "less than rerun=3, and dt = 0.01", None),
    ],
)
def test_options_for_arguments(words, text, said):
    found = reworded(text, make_parsers()[0].parse_args(words.split()))
    end = "" if text.endswith(".") else "."
    assert found == (text if said is None else f"{text}{end} On the command line: {said}")


@pytest.mark.slow
def test_what_helps_in_python_alone_is_left_out(capsys, monkeypatch, biased_file):
    words = ["diagnose", biased_file[0], "--input", "error", "--output", "stick", "--run", "run"]
    words += ["--time", "time", "--effects", "bias", "--no-pictures"]
    said = []
    monkeypatch.setattr(
        "skhoid.lab.cli.search_output.reworded", lambda line, _: said.append(line) or line
    )
    assert main(words) == 0
    for part in PYTHON_ONLY:
        assert any(part in line for line in said)
    options = make_parsers()[0].parse_args(words)
    shown = [reworded(line, options) for line in said]
    assert not any(part in line for part in PYTHON_ONLY for line in shown)
    assert not any("=" in line for line in shown if line.startswith("  note"))


def test_of_errors_and_of_warnings(capsys):
    X, y = make_tracking_runs("C1", 2, duration=20.0, run_in=0.0, sampling_rate=50, random_state=0)
    write_runs(X, y, "runs.csv")
    table = pd.read_csv("runs.csv")
    table["time"] *= 1000
    table.to_csv("ms.csv", index=False)
    assert main(["identify", "ms.csv", "--time", "time", "--run", "run"]) == 2
    assert capsys.readouterr().err.endswith(
        "The rows are counted as 20 s apart: if the times are not in seconds, state their unit "
        "with units={'time': ...}. On the command line: --unit.\n"
    )
    table = pd.read_csv("runs.csv")
    table["time"] += 1e-3 * (table.index % 2)
    table.to_csv("jitter.csv", index=False)
    words = ["jitter.csv", "--time", "time", "--run", "run", "--nk", "15", "--na", "2"]
    code = main(["identify", *words, "--no-pictures"])
    assert capsys.readouterr().err.endswith("On the command line: --resample.\n"), code
