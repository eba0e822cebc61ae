"""What all commands share: help, errors, exit codes, notes."""

import os
import re
import shlex
import subprocess
import sys
import warnings
from pathlib import Path

import pytest
from support.places import ROOT

from skhoid import exceptions, make_tracking_runs, write_runs
from skhoid.lab.cli import main, make_parsers

COMMANDS = ["demo", "identify", "compare", "diagnose", "simulate", "study", "report"]
COMMANDS += ["experiment", "completion"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nothing-here.csv", "--time", "t"], "nothing-here.csv"),
        (["run.csv"], "There is no file run.csv"),
        (["run.csv", "--dt", "0.01", "--unit", "deg"], "--unit takes NAME=UNIT"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(capsys, words, message):
    assert main(["identify", *words]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("skhoid: error: ")
    assert message in printed.err


def test_debug_shows_the_traceback(run_files):
    words = ["--input", "target", "--output", "cursor", "--time", "t", "--validate", "monday"]
    with pytest.raises(ValueError, match="monday"):
        main(["identify", *run_files, *words, "--debug"])


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_examples(capsys, command):
    with pytest.raises(SystemExit) as stop:
        main([command, "--help"])
    assert stop.value.code == 0
    printed = capsys.readouterr().out
    assert printed.count(f"  skhoid {command} ") >= 1
    assert "examples:" in printed


def test_examples_are_right():
    """Every example of every help can be parsed."""
    parser, commands = make_parsers()
    pages = [parser, *commands.values()]
    examples = [
        line.split("   ")[0].split(">")[0].split()[1:]
        for page in pages
        for line in page.epilog.replace('"Subject 3"', "Subject-3").splitlines()
        if line.startswith("  skhoid ")
    ]
    assert len(examples) > 30
    for words in examples:
        assert parser.parse_args(words).command == words[0]


def test_commands_of_the_docs_are_right():
    root = ROOT
    if not (root / "docs").is_dir():
        pytest.skip("no docs beside the tests")
    parser = make_parsers()[0]
    pages = [root / "README.md", *(root / "docs").glob("*.md")]
    blocks = [
        block
        for page in pages
        for block in re.findall(r"^```sh\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S)
    ]
    lines = [line.removeprefix(".venv/bin/") for block in blocks for line in block.splitlines()]
    lines = [line for line in lines if line.startswith("skhoid ")]
    assert len(lines) > 20
    for line in lines:
        words = shlex.split(line.split(" > ")[0].split(" | ")[0], comments=True)[1:]
        assert parser.parse_args(words).command == words[0], line


def test_help_says_what_options_are_and_their_defaults(capsys):
    def help_of(command):
        with pytest.raises(SystemExit):
            main([command, "--help"])
        return " ".join(capsys.readouterr().out.split())

    assert "longest delay to try (default: 0.5)" in (said := help_of("identify"))
    assert "for the plots (default: skhoid-identify)" in said
    assert "the operator's physics, or ARX (default: operator)" in help_of("report")


def test_help_lists_the_commands_with_an_example_each(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["--help"])
    assert stop.value.code == 0
    printed = capsys.readouterr().out
    for command in COMMANDS:
        assert f"\n    {command}" in printed
        assert f"\n  skhoid {command}" in printed


def test_no_words_print_the_help(capsys):
    assert main([]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "examples:" in printed.err


def test_unknown_words(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["identfy"])
    assert stop.value.code == 2
    assert "no command 'identfy'. Did you mean 'identify'?" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["identify", "--critrion", "vaf"])
    assert "Did you mean '--criterion'?" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["identify", "--criterion", "vav"])
    assert "Did you mean 'vaf'?" in capsys.readouterr().err
    Path("runs.csv").touch()
    with pytest.raises(SystemExit):
        main(["runs.csv"])
    assert "skhoid diagnose runs.csv" in capsys.readouterr().err


def test_an_unknown_column_names_those_near(capsys, tmp_path):
    X, y = make_tracking_runs("C1", 1, duration=10.0, run_in=10.0)
    write_runs(X.rename(columns={"e": "error [deg]"}), y, tmp_path / "run.csv")
    for command in ("identify", "diagnose", "report"):
        assert main([command, "run.csv", "--time", "time", "--input", "eror"]) == 2
        assert capsys.readouterr().err == (
            "skhoid: error: run.csv: There is no column 'eror'. Did you mean 'error'? It has: "
            "'run', 'time', 'error [deg]', 'u'.\n"
        )


@pytest.mark.parametrize("command", ["identify", "diagnose", "report"])
def test_files_behind_an_option_of_several_words_are_missed(capsys, command):
    """Else the bundled recordings would be taken for the user's."""
    option = "--input" if command == "identify" else "--effects"
    assert main([command, option, "e", "run.csv", "--time", "t"]) == 2
    assert capsys.readouterr().err.endswith("name the files first.\n")


ABOUT_FILES = [
    *(["--input", "e"], ["--output", "u"], ["--run", "run"], ["--unit", "e=deg"], ["--resample"]),
    *(["--dt", "0.01"], ["--time", "t"]),
]
ROLES = [["--x", "x"], ["--target", "f_t"], ["--role", "roll="], ["--display", "compensatory"]]


@pytest.mark.parametrize(
    "words",
    [
        *(["identify", *words] for words in ABOUT_FILES),
        *(["diagnose", *words] for words in [*ABOUT_FILES, *ROLES]),
    ],
    ids=" ".join,
)
def test_options_about_files_need_files(capsys, words):
    assert main(words) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"skhoid: error: {words[1]} is about files, and there are none.")


@pytest.mark.parametrize(
    "words",
    [
        ["demo", "--out"],
        ["diagnose", "--out"],
        ["identify", "--out"],
        ["identify", "--tables"],
        ["report", "--tables"],
        ["study", "fig13", "--out"],
    ],
)
def test_a_file_is_no_folder(capsys, words):
    Path("notes.txt").write_text("precious")
    assert main([*words, "notes.txt"]) == 2
    assert capsys.readouterr().err == "skhoid: error: notes.txt is a file; name a folder.\n"
    assert main([*words, "notes.txt/new/one"]) == 2
    assert "error: notes.txt is a file and no folder; " in capsys.readouterr().err


@pytest.mark.parametrize(
    "words", [["simulate", "--out"], ["report", "--out"], ["diagnose", "--report"]]
)
def test_no_file_is_put_into_a_file(capsys, words):
    Path("notes.txt").write_text("precious")
    assert main([*words, "notes.txt/runs.csv"]) == 2
    assert "error: notes.txt is a file and no folder; " in capsys.readouterr().err


def test_an_unknown_effect_names_those_near(capsys):
    assert main(["report", "--effects", "dedd_zone"]) == 2
    assert "'dedd_zone'" in (said := capsys.readouterr().err)
    assert "dead_zone" in said


def raising(error):
    def command(*given, **named):
        raise error

    return command


@pytest.fixture
def simulate_raises(monkeypatch):
    """Make the command simulate fail."""

    def fail(error):
        monkeypatch.setattr("skhoid.make_tracking_runs", raising(error))
        return main(["simulate", "--out", "runs.csv"])

    return fail


@pytest.mark.parametrize(
    "error",
    [getattr(exceptions, name) for name in exceptions.__all__ if not name.endswith("Warning")],
)
def test_errors_of_the_package_are_bad_input(capsys, simulate_raises, error):
    assert simulate_raises(error("first line\n  second line")) == 2
    assert capsys.readouterr().err == "skhoid: error: first line second line\n"


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (
            KeyError("gain"),
            1,
            "skhoid: unexpected error: KeyError: 'gain' (run again with --debug to see where, and "
            "please report it)\n",
        ),
        (PermissionError(13, "Permission denied", "/out"), 2, "error: /out: Permission denied\n"),
        (KeyboardInterrupt(), 130, ""),
    ],
)
def test_exit_codes(capsys, simulate_raises, error, code, said):
    assert simulate_raises(error) == code
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.endswith(said)


def test_warnings_are_notes_on_one_line(capsys, monkeypatch):
    def command(*given, **named):
        with warnings.catch_warnings():
            warnings.simplefilter("always")
            for _ in range(3):
                warnings.warn("two\n lines", stacklevel=1)
        return make_tracking_runs(*given, **named)

    monkeypatch.setattr("skhoid.make_tracking_runs", command)
    assert main(["simulate", "--runs", "1", "--out", "runs.csv"]) == 0
    assert capsys.readouterr().err == "skhoid: note: two lines\n"


# What rich prints, too.
@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        ["study", "list"],
        pytest.param(["identify", "--nk", "7", "--no-pictures"], marks=pytest.mark.slow),
    ],
)
def test_a_reader_that_leaves_is_no_error(words):
    """As ``skhoid study list | head -1``, with ``python -m skhoid``."""
    reading, writing = os.pipe()
    os.close(reading)
    words = [sys.executable, "-m", "skhoid", *words]
    done = subprocess.run(words, stdout=writing, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writing)
    assert (done.returncode, done.stderr) == (141, "")
