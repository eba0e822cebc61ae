"""Parts of the tests, of which CI runs one with each commit."""

import subprocess
import sys

import pytest
from support.places import ROOT


def collected(*part):
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-m", "", *part, "tests/io"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    return [line for line in done.stdout.splitlines() if "::" in line]


@pytest.mark.slow
def test_parts_have_each_file_once():
    parts = [collected("--part", f"{k}/3") for k in (1, 2, 3)]
    files = [{line.split("::")[0] for line in part} for part in parts]
    assert all(files)
    assert sorted(line for part in parts for line in part) == sorted(collected())
    assert sum(map(len, files)) == len(set.union(*files))
