"""Options that would have no effect are refused, and numbers that are none."""

from pathlib import Path

import pandas as pd
import pytest

from skhoid import ControlledElement, load_human_tracking, read_runs
from skhoid.lab.cli import main, make_parsers
from skhoid.lab.cli.diagnose import read_recordings
from skhoid.lab.cli.parser import with_one_element
from skhoid.lab.opening import read_element

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


@pytest.mark.parametrize(
    "words",
    [
        ["identify", "--nk", "7", "--longest-delay", "0.5"],
        ["identify", "--nk", "7", "--criterion", "one_step"],
        ["identify", "--nk", "7", "--instruments", "f_t"],
        ["identify", "--method", "iv", "--instruments", "x"],  # without files
        ["identify", "--no-pictures", "--out", "out"],
        ["identify", "run.csv", "--dt", "0.01", "--resample"],
        *([command, "--table-format", "tsv"] for command in ("identify", "demo", "report")),
        ["diagnose", "--overwrite"],
        ["diagnose", "--no-pictures", "--out", "out"],
        ["demo", "--no-pictures", "--no-report", "--out", "out"],
        ["report", "--effects", "none", "--display", "pursuit"],
        ["report", "--effects", "none", "--max-effects", "4"],
        ["report", "--effects", "none", "--controlled-element", "1", "0"],
    ],
    ids=" ".join,
)
def test_options_without_effect_are_refused(capsys, words):
    assert main(words) == 2
    said = capsys.readouterr().err
    last = [word for word in words if word.startswith("--")][-1]
    assert said.startswith(f"skhoid: error: {last} ")
    assert not Path("out").exists()


@pytest.mark.parametrize(
    ("words", "roles"),
    [
        (["--input", "e", "--x", "e"], "'e' by --input and 'x' by --x"),
        (["--x", "x", "--target", "x"], "'x' by --x and 'f_t' by --target"),
        (["--role", "x=motion1", "--x", "x"], "'motion1' by --role and 'x' by --x"),
        (["--input", "e", "--role", "e=motion"], "'motion' by --role and 'e' by --input"),
    ],
)
def test_a_channel_has_one_role(capsys, words, roles):
    for command in ("diagnose", "report"):
        assert main([command, *FILES, *words]) == 2
        assert f"has two roles, {roles}: name different" in capsys.readouterr().err


def test_a_target_seen_is_input_and_target(run_files):
    words = ["--input", "target", "--target", "target", "--output", "cursor", "--time", "t"]
    options = make_parsers()[0].parse_args(["report", *run_files, *words, "--role", "target=f_t"])
    _, _, estimator, _ = read_recordings(options)
    assert (estimator.inputs, estimator.roles) == (["target"], {"target": "f_t"})


def test_a_unit_is_said_once(capsys):
    assert main(["identify", *FILES, "--unit", "e=deg", "--unit", "e=rad"]) == 2
    assert "--unit says twice what 'e' is, 'deg' and 'rad'" in capsys.readouterr().err


@pytest.mark.parametrize("number", ["-1", "0", "nan", "inf", "long"])
@pytest.mark.parametrize(
    "words",
    [
        ["study", "experiment", *FILES, "--measurement-time"],
        ["study", "recommend", "--rate"],
        *(["identify", o] for o in ("--longest-delay", "--memory-time", "--memory-horizon")),
        ["diagnose", "run.csv", "--dt"],
        ["simulate", "--out", "runs.csv", "--rate"],
    ],
    ids=lambda words: words[-1],
)
def test_lengths_are_above_zero(capsys, words, number):
    with pytest.raises(SystemExit) as stop:
        main([*words, number])
    assert stop.value.code == 2
    assert f"{words[-1]}: must be a number above 0; got '{number}'" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words", [["identify", "--run-in"], ["report", "--run-in"], ["diagnose", "--delay"]]
)
def test_some_lengths_may_be_zero(capsys, words):
    with pytest.raises(SystemExit):
        main([*words, "-0.5"])
    assert "must be a number, at least 0; got '-0.5'" in capsys.readouterr().err
    with pytest.raises(SystemExit) as stop:
        main([*words, "0", "--help"])
    assert stop.value.code == 0


def test_files_of_a_study_are_optional(capsys):
    with pytest.raises(SystemExit):
        main(["study"])
    assert capsys.readouterr().err.endswith(
        "arguments are required: NAME (see skhoid study --help)\n"
    )


def test_resampling_takes_the_sampling_time(run_json, run_files):
    words = [*run_files, "--input", "target", "--output", "cursor", "--time", "t", "--nk", "3"]
    words += ["--na", "2", "--no-pictures"]
    found = run_json("identify", *words, "--resample", "--dt", "0.04")
    assert found["dt_s"] == pytest.approx(0.04)


def test_names_are_printed_and_drawn_as_they_are(capsys):
    """Neither emoji nor mathematics, which would also fail."""
    X, y = load_human_tracking("phase-size 2b")
    table = X[:1200].droplevel("run").reset_index().assign(u=y[:1200].to_numpy())
    labels = ["12:100:0", r"c$\frac$"]
    runs = [table.assign(run=label) for label in labels]
    pd.concat(runs).rename(columns={"f_t": "a$x_1$b"}).to_csv("runs.csv", index=False)
    X, _ = read_runs("runs.csv", inputs="a$x_1$b", output="u", time="time", run="run")
    assert list(X.index.levels[0]) == labels
    words = ["runs.csv", "--output", "u", "--time", "time", "--run", "run", "--input", "a$x_1$b"]
    words += ["--na", "2", "--nk", "6", "--memory-time", "5"]
    assert main(["identify", *words]) == 0
    printed = capsys.readouterr().out
    assert "12:100:0" in printed
    assert "input a$x_1$b" in printed
    assert "Pictures in skhoid-identify: simulation.png, parameters.png" in printed


@pytest.mark.parametrize(
    ("words", "element"),
    [
        (["90", "6"], ControlledElement(90.0, 6.0)),
        (["1/(s(s+1))"], ControlledElement("1/(s(s+1))")),
        (["1/s", "other.csv"], ControlledElement("1/s")),
    ],
)
def test_controlled_elements(words, element):
    given = ["diagnose", "--input", "e", "--controlled-element", *words]
    options = make_parsers()[0].parse_args(with_one_element(given))
    assert read_element(options.controlled_element) == element


def test_an_element_that_cannot_be_read():
    with pytest.raises(ValueError, match="'K' is unknown"):
        read_element("K/s")
