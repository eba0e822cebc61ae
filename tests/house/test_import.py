"""What importing skhoid, and asking its command line, must not load."""

import subprocess
import sys

import pytest

import skhoid

LATER = {"control", "h5py", "jinja2", "matplotlib", "numba"}  # each where it is used
HEAVY = {"numpy", "pandas", "rich", "scipy", "sklearn"}
COMMANDS = ["demo", "identify", "diagnose", "simulate", "study", "report", "completion"]
WORDS = [
    ["--help"],
    ["--version"],
    ["--no-such-option"],
    ["no-such-command"],
    *([command, "--help"] for command in COMMANDS),
    ["identify", "--na", "none"],
]


def loaded(code: str) -> set[str]:
    """Modules that a fresh Python has when it ends."""
    tell = "import atexit, sys; atexit.register(lambda: print('', *sys.modules, sep='|'))\n"
    done = subprocess.run(
        [sys.executable, "-c", tell + code], capture_output=True, text=True, check=False, cwd="/"
    )
    return set(done.stdout.splitlines()[-1].split("|"))


def test_the_root_loads_nothing():
    found = loaded("import skhoid")
    assert {name for name in found if name.startswith("skhoid")} == {"skhoid", "skhoid._version"}
    assert not found & HEAVY


@pytest.mark.slow
def test_all_names_load_nothing_that_can_wait():
    found = loaded("from skhoid import *")
    assert "skhoid.lab.report" in found
    assert not found & LATER


def test_the_command_line_answers_before_numpy():
    code = f"""
import contextlib, sys
from skhoid.lab.cli import main
for words in {WORDS}:
    with contextlib.suppress(SystemExit):
        main(words)
    assert not {HEAVY} & set(sys.modules), words
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd="/"
    )
    assert done.returncode == 0, done.stderr
    assert "usage" in done.stdout.lower()


def test_names_are_found():
    """That each line of the stub, which type checkers believe, is true."""
    for name in dir(skhoid):
        assert getattr(skhoid, name).__name__ in {name, f"skhoid.{name}"}


def test_a_wrong_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="ARXRegresor"):
        _ = skhoid.ARXRegresor
