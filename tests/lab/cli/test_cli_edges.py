"""Numbers without sense, closed streams, full disks, and names that are not UTF-8."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from skhoid.lab.cli import main

HUGE = "99999999999"


@pytest.mark.parametrize(
    "words",
    [
        ["compare", "m", "--false-alarm", "0"],
        ["compare", "m", "--false-alarm", "nan"],
        ["demo", "--max-effects", "-1"],
        ["demo", "--remnant", "-1"],
        ["demo", "--runs", HUGE],
        ["demo", "--seed", "-1"],
        ["diagnose", "--delay", "inf"],
        ["diagnose", "--na", "0"],
        ["diagnose", "--nk", HUGE],
        ["identify", "--decimate", HUGE],
        ["identify", "--longest-delay", "inf"],
        ["identify", "--na", "1000"],
        ["identify", "--nb", "-2"],
        ["identify", "--nk", "-1"],
        ["report", "--nb", "1.5"],
        ["simulate", "--out", "a.csv", "--remnant", "nan"],
        ["simulate", "--out", "a.csv", "--runs", "1" * 5000],
        ["study", "fig9", "--intensities", "0", "-1"],
        ["study", "fig9", "--jobs", "0"],
        ["study", "fig9", "--jobs", HUGE],
        ["study", "fig9", "--replications", HUGE],
        ["study", "fig9", "--seed", "x"],
    ],
    ids=lambda words: " ".join(words)[:50],
)
def test_numbers_without_sense(capsys, words):
    with pytest.raises(SystemExit) as stop:
        main(words)
    assert stop.value.code == 2
    said = capsys.readouterr().err
    assert "error: argument --" in said
    assert "must be" in said


@pytest.mark.parametrize("words", [["--runs", "1000000"], ["--runs", "1", "--rate", "1e10"]])
def test_more_runs_than_memory(capsys, words):
    assert main(["simulate", "--out", "a.csv", *words]) == 2
    assert "GiB of memory, but the machine has" in capsys.readouterr().err
    assert not Path("a.csv").exists()


@pytest.mark.parametrize(
    ("delay", "said"), [("1e9", "more than half of the shortest run"), ("35", "at most 2000")]
)
def test_delays_that_are_too_long(capsys, delay, said):
    assert main(["simulate", "--out", "a.csv", "--runs", "1"]) == 0
    words = ["a.csv", "--time", "time", "--longest-delay", delay, "--no-pictures"]
    assert main(["identify", *words]) == 2
    assert said in capsys.readouterr().err


def test_a_grid_without_end(capsys):
    assert main(["simulate", "--out", "a.csv", "--runs", "1"]) == 0
    assert main(["identify", "a.csv", "--time", "time", "--dt", "1e-12", "--resample"]) == 2
    assert "A grid of dt = 1e-12 s would take" in capsys.readouterr().err


def test_a_run_column_is_found(run_json, capsys):
    assert main(["simulate", "--out", "a.csv", "--runs", "2", "--remnant", "0.1"]) == 0
    capsys.readouterr()
    words = ["a.csv", "--time", "time", "--na", "1", "--nk", "29", "--no-pictures"]
    found = run_json("identify", *words)
    assert (found["columns"]["run"], found["n_runs"]) == ("run", 2)


@pytest.mark.skipif(os.name == "nt", reason="Windows lets not everyone make links")
def test_a_link_that_leads_nowhere_is_not_written_through(capsys):
    Path("link.csv").symlink_to("real.csv")
    words = ["simulate", "--out", "link.csv", "--runs", "1"]
    assert main(words) == 2
    assert "link.csv exists; choose another name, or --overwrite" in capsys.readouterr().err
    assert main([*words, "--overwrite"]) == 0
    assert Path("link.csv").is_symlink()
    assert Path("real.csv").is_file()


@pytest.mark.skipif(os.name == "nt", reason="Windows lets not everyone make links")
@pytest.mark.parametrize("words", [["--out"], ["--no-pictures", "--tables"]])
@pytest.mark.parametrize("folder", ["link", "link/in"])
def test_a_folder_that_is_a_link_to_nothing(capsys, words, folder):
    Path("link").symlink_to("gone")
    assert main(["identify", *words, folder]) == 2
    said = capsys.readouterr().err
    assert said.startswith("skhoid: error: link is a link to gone, which does not exist; make ")


def test_a_device_is_no_recording(capsys):
    assert main(["identify", os.devnull, "--time", "t"]) == 2
    assert f"{os.devnull} is not a regular file" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (
            "diagnose --effects nosuch",
            "No effect is called 'nosuch'. The effects are: wrong_delay, ",
        ),
        ("report --out a.html --effects dead_zon", "Did you mean 'dead_zone'?"),
        ("identify --table-format csv", "--table-format needs --tables FOLDER"),
        ("demo --table-format csv", "--table-format needs --tables FOLDER"),
        ("identify --time t", "--time is about files, and there are none"),
    ],
)
def test_what_is_refused_at_once(capsys, line, said):
    assert main(line.split()) == 2
    assert said in capsys.readouterr().err


def test_a_lack_of_memory_is_said(capsys, monkeypatch):
    def command(*given, **named):
        raise MemoryError("Unable to allocate 9 TiB")

    monkeypatch.setattr("skhoid.make_tracking_runs", command)
    assert main(["simulate", "--out", "a.csv"]) == 2
    assert capsys.readouterr().err.endswith("does not suffice. Unable to allocate 9 TiB\n")


@pytest.mark.slow
def test_names_that_are_not_utf_8(run_files):
    name = b"r\xff.csv"
    try:
        Path(os.fsdecode(name)).write_bytes(Path(run_files[0]).read_bytes())
    except (OSError, UnicodeEncodeError):
        pytest.skip("this file system has no such names")
    words = [name, "--input", "target", "--output", "cursor", "--time", "t", "--nk", "6"]
    words += ["--na", "2", "--nb", "2", "--out", b"p\xff", "--tables", b"t\xff"]
    command = [sys.executable, "-m", "skhoid", "identify", *words]
    done = subprocess.run(command, capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
    assert rb"r\xff.csv" in done.stdout
    assert os.path.isfile(b"p\xff/simulation.png")
    assert os.path.isfile(b"t\xff/models.tsv")


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="POSIX shells close streams")
@pytest.mark.parametrize(
    ("line", "code", "said"),
    [
        ("study list >&-", 0, ""),
        ("simulate --runs 1 --out a.csv >&- 2>&-", 0, ""),
        ("--version >&-", 0, ""),
        ("study list >/dev/full", 2, "skhoid: error: the output: No space left on device\n"),
        ("--help >/dev/full", 2, "skhoid: error: the output: No space left on device\n"),
        ("--version >/dev/full", 2, "skhoid: error: the output: No space left on device\n"),
    ],
)
@pytest.mark.parametrize("buffered", [True, False])
def test_closed_and_full_streams(line, code, said, buffered):
    if "/dev/full" in line and not Path("/dev/full").is_char_device():
        pytest.skip("this machine has no /dev/full")
    env = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    env |= {} if buffered else {"PYTHONUNBUFFERED": "1"}
    command = f"{sys.executable} -m skhoid {line}"
    done = subprocess.run(command, shell=True, stderr=subprocess.PIPE, text=True, env=env)
    assert (done.returncode, done.stderr) == (code, said)
    if "a.csv" in line:
        assert Path("a.csv").read_text().startswith("run,time,e,x,f_t,u\n")
