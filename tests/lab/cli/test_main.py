"""What all commands share: help, errors, exit codes, notes, and how it is printed."""

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
from skhoid.exceptions import UsageError
from skhoid.lab.cli import main, make_parsers
from skhoid.lab.cli.output import message_for, say_next
from skhoid.text import Note

COMMANDS = ["demo", "identify", "compare", "diagnose", "simulate", "study", "report"]
COMMANDS += ["experiment", "workbench", "completion"]


# Help.


def test_help_lists_the_commands_with_an_example_each(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["--help"])
    assert stop.value.code == 0
    printed = capsys.readouterr().out
    for command in COMMANDS:
        assert f"\n    {command}" in printed
        assert f"\n  skhoid {command}" in printed
    assert main([]) == 2
    assert "examples:" in capsys.readouterr().err


def test_examples_of_help_and_docs_can_be_parsed():
    parser, commands = make_parsers()
    examples = [
        line.split("   ")[0].split(">")[0].split()
        for page in (parser, *commands.values())
        for line in page.epilog.replace('"Subject 3"', "Subject-3").splitlines()
        if line.startswith("  skhoid ")
    ]
    assert {words[1] for words in examples} == set(COMMANDS)
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("*.md")] if (ROOT / "docs").is_dir() else []
    for page in pages:
        text = page.read_text(encoding="utf-8")
        for block in re.findall(r"^```sh\n(.*?)^```", text, re.M | re.S):
            lines = [line.removeprefix(".venv/bin/") for line in block.splitlines()]
            lines = [line.split(" > ")[0].split(" | ")[0] for line in lines]
            examples += [shlex.split(s, comments=True) for s in lines if s.startswith("skhoid ")]
    assert len(examples) > 50
    for _, *words in examples:
        assert parser.parse_args(words).command == words[0], words


# Errors.


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["identfy"], "no command 'identfy'. Did you mean 'identify'?"),
        (["runs.csv"], "skhoid diagnose runs.csv"),
        (["identify", "--memry-time", "2"], "Did you mean '--memory-time'?"),
        (["identify", "--domain", "humn"], "Did you mean 'human'?"),
        (["study"], "arguments are required: NAME (see skhoid study --help)"),
    ],
)
def test_unknown_words(capsys, words, said):
    Path("runs.csv").touch()
    with pytest.raises(SystemExit) as stop:
        main(words)
    assert stop.value.code == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("identify nothing-here.csv --time t", "nothing-here.csv"),
        (f"identify {os.devnull} --time t", "is not a regular file"),
        ("identify run.csv --dt 0.01 --unit deg", "--unit takes NAME=UNIT"),
        ("diagnose run.csv --time t --role roll", "--role takes NAME=ROLE"),
        ("diagnose --na 2", "--na needs --core arx.\n"),
        ("report --core arx --delay 0.2", "--delay needs --core operator.\n"),
        ("demo --effect dedd_zone", "No effect is called 'dedd_zone'"),
        ("demo --effect none bias", "--effect none hides nothing"),
        ("demo --effects none", "leave --effects out to search for all"),
        ("report --effects all bias", "stand alone"),
        ("report --effects dead_zon", "Did you mean 'dead_zone'?"),
        ("identify --table-format csv", "--table-format needs --tables FOLDER"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(capsys, line, said):
    assert main(line.split()) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("skhoid: error: ")
    assert said in printed.err


def test_an_unknown_column_names_those_near(capsys):
    X, y = make_tracking_runs("C1", 1, duration=10.0, run_in=10.0)
    write_runs(X.rename(columns={"e": "error [deg]"}), y, "run.csv")
    words = ["diagnose", "run.csv", "--time", "time", "--input", "eror"]
    assert main(words) == 2
    assert capsys.readouterr().err == (
        "skhoid: error: run.csv: There is no column 'eror'. Did you mean 'error'? It has: "
        "'run', 'time', 'error [deg]', 'u'.\n"
    )
    with pytest.raises(ValueError, match="eror"):
        main([*words, "--debug"])


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (KeyError("gain"), 1, "unexpected error: KeyError: 'gain' (run again with --debug to see"),
        (PermissionError(13, "Permission denied", "/out"), 2, "error: /out: Permission denied\n"),
        (MemoryError("Unable to allocate 9 TiB"), 2, "not suffice. Unable to allocate 9 TiB\n"),
        (KeyboardInterrupt(), 130, ""),
        *(
            (getattr(exceptions, name)("first line\n  second line"), 2, "error: first line second")
            for name in exceptions.__all__
            if not name.endswith("Warning") and name != "Hinted"
        ),
    ],
    ids=lambda value: type(value).__name__,
)
def test_exit_codes(capsys, monkeypatch, error, code, said):
    def fail(*given, **named):
        raise error

    monkeypatch.setattr("skhoid.make_tracking_runs", fail)
    assert main(["simulate", "--out", "runs.csv"]) == code
    printed = capsys.readouterr()
    assert printed.out == ""
    assert said in printed.err
    assert printed.err.count("\n") == bool(said)


def test_warnings_are_notes_on_one_line(capsys, monkeypatch):
    def warn(*given, **named):
        with warnings.catch_warnings():
            warnings.simplefilter("always")
            for _ in range(3):
                warnings.warn("two\n lines", stacklevel=1)
        return make_tracking_runs(*given, **named)

    monkeypatch.setattr("skhoid.make_tracking_runs", warn)
    assert main(["simulate", "--runs", "1", "--out", "runs.csv"]) == 0
    assert capsys.readouterr().err == "skhoid: note: two lines\n"


@pytest.mark.parametrize(
    ("words", "options", "end"),
    [
        ("identify", ["resample", "dt"], " On the command line: --resample, --dt."),
        ("identify", ["files"], " On the command line: leave it out of FILES."),
        ("identify", [("run", "a b")], " On the command line: --run 'a b'."),
        ("simulate --out x.csv", ["dt"], ""),
        ("identify", [], ""),
    ],
)
def test_options_stand_in_place_of_hints(words, options, end):
    parsed = make_parsers()[0].parse_args(words.split())
    error = UsageError("It cannot be used.", hint="Write f(x=1).", options=options)
    note = Note("kind", "It cannot be used.", hint="Write f(x=1).", options=options)
    assert message_for(error, parsed) == message_for(note, parsed) == f"It cannot be used.{end}"


def test_errors_and_warnings_of_the_package_name_options(capsys):
    X, y = make_tracking_runs("C1", 2, duration=20.0, run_in=0.0, sampling_rate=50, random_state=0)
    table = X.assign(u=y).reset_index()
    table["time"] += 1e-3 * (table.index % 2)
    table.to_csv("jitter.csv", index=False)
    words = ["jitter.csv", "--time", "time", "--run", "run", "--nk", "15", "--na", "2"]
    main(["identify", *words, "--no-pictures"])
    assert capsys.readouterr().err.endswith("On the command line: --resample.\n")


# Numbers without sense, and more than the machine has.


@pytest.mark.parametrize(
    "line",
    [
        "demo --max-effects -1",
        "demo --runs 99999999999",
        "diagnose --delay inf",
        "diagnose run.csv --dt 0",
        "identify --longest-delay nan",
        "identify --memory-time long",
        "identify --na 1000",
        "report --nb 1.5",
        f"simulate --out a.csv --runs {'1' * 5000}",
        "study fig9 --jobs 0",
    ],
    ids=lambda line: line[:40],
)
def test_numbers_without_sense(capsys, line):
    with pytest.raises(SystemExit) as stop:
        main(line.split())
    assert stop.value.code == 2
    said = capsys.readouterr().err
    assert "error: argument --" in said
    assert "must be" in said


@pytest.mark.parametrize("words", [["--runs", "1000000"], ["--runs", "1", "--rate", "1e10"]])
def test_more_runs_than_memory(capsys, words):
    assert main(["simulate", "--out", "a.csv", *words]) == 2
    assert "GiB of memory, but the machine has" in capsys.readouterr().err
    assert not Path("a.csv").exists()


def test_delays_and_grids_without_end(capsys):
    assert main(["simulate", "--out", "a.csv", "--runs", "1"]) == 0
    words = ["identify", "a.csv", "--time", "time", "--no-pictures"]
    for more, said in [
        (["--longest-delay", "1e9"], "more than half of the shortest run"),
        (["--dt", "1e-12", "--resample"], "A grid of dt = 1e-12 s would take"),
    ]:
        assert main([*words, *more]) == 2
        assert said in capsys.readouterr().err


# What is printed.


@pytest.mark.slow  # a process for each
@pytest.mark.skipif(os.name == "nt", reason="POSIX shells close streams")
@pytest.mark.parametrize(
    ("line", "code", "said"),
    [
        ("study list >/dev/full", 2, "skhoid: error: the output: No space left on device\n"),
        ("study list | true; exit ${PIPESTATUS[0]}", 141, ""),
    ],
)
def test_full_and_closed_streams(line, code, said):
    if "/dev/full" in line and not Path("/dev/full").is_char_device():
        pytest.skip("this machine has no /dev/full")
    command = ["bash", "-c", f"{sys.executable} -m skhoid {line}"]
    done = subprocess.run(command, stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr) == (code, said)


def test_commands_are_never_broken(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    command = "skhoid diagnose " + "a long name.csv " * 6
    say_next([(command, "why")])
    assert command in capsys.readouterr().out
