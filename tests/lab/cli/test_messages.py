"""Messages that say what to do in Python say it with options on the command line."""

import pandas as pd
import pytest

from skhoid import make_tracking_runs, write_runs
from skhoid.exceptions import UsageError
from skhoid.lab.cli import main, make_parsers
from skhoid.lab.cli.output import message_for
from skhoid.text import Note


@pytest.mark.parametrize(
    ("words", "options", "end"),
    [
        ("identify", ["dt"], " On the command line: --dt."),
        ("identify", ["resample", "dt"], " On the command line: --resample, --dt."),
        ("identify", ["files"], " On the command line: leave it out of FILES."),
        ("identify", [("run", "a b")], " On the command line: --run 'a b'."),
        ("study list", ["measurement_time"], " On the command line: --measurement-time."),
        ("simulate --out x.csv", ["dt"], ""),
        ("identify", [], ""),
    ],
)
def test_options_in_place_of_hints(words, options, end):
    parsed = make_parsers()[0].parse_args(words.split())
    error = UsageError("It cannot be used.", hint="Write f(x=1).", options=options)
    note = Note("kind", "It cannot be used.", hint="Write f(x=1).", options=options)
    assert message_for(error, parsed) == message_for(note, parsed) == f"It cannot be used.{end}"
    assert str(error) == "It cannot be used. Write f(x=1)."


def test_of_errors_and_of_warnings(capsys):
    X, y = make_tracking_runs("C1", 2, duration=20.0, run_in=0.0, sampling_rate=50, random_state=0)
    write_runs(X, y, "runs.csv")
    table = pd.read_csv("runs.csv")
    table["time"] *= 1000
    table.to_csv("ms.csv", index=False)
    assert main(["identify", "ms.csv", "--time", "time", "--run", "run"]) == 2
    assert capsys.readouterr().err.endswith(
        "The rows are counted as 20 s apart: if the times are not in seconds, say so. "
        "On the command line: --unit.\n"
    )
    table = pd.read_csv("runs.csv")
    table["time"] += 1e-3 * (table.index % 2)
    table.to_csv("jitter.csv", index=False)
    words = ["jitter.csv", "--time", "time", "--run", "run", "--nk", "15", "--na", "2"]
    code = main(["identify", *words, "--no-pictures"])
    assert capsys.readouterr().err.endswith("On the command line: --resample.\n"), code
