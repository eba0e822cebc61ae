"""Runs the Python blocks of the pages under docs/ as tests; closes figures."""

import os
import sys
from doctest import ELLIPSIS, NORMALIZE_WHITESPACE

import pytest
from hypothesis import settings
from sybil import Sybil
from sybil.evaluators.doctest import NUMBER
from sybil.parsers.myst import PythonCodeBlockParser, SkipParser

# Read when NumPy is loaded. Threads of linear algebra that outnumber the cores, as those of several
# workers do, spend most of their time on waiting for one another.
os.environ.setdefault("OMP_NUM_THREADS", "1")

# No test depends on how fast the machine is, or on luck: --hypothesis-profile=search tries its own.
settings.register_profile("skhoid", deadline=None, derandomize=True)
settings.register_profile("search", deadline=None)
settings.load_profile("skhoid")

collect_ignore_glob = ["docs/*.py"]  # scripts of the documentation are no tests

pytest_collect_file = Sybil(
    parsers=[
        PythonCodeBlockParser(doctest_optionflags=ELLIPSIS | NORMALIZE_WHITESPACE | NUMBER),
        SkipParser(),
    ],
    patterns=["docs/*.md", "docs/**/*.md"],
    excludes=["docs/index.md"],  # whose lines, README.md's too, tests/house/test_start_page.py runs
    fixtures=["close_figures"],
).pytest()


@pytest.fixture(autouse=True)
def close_figures():
    """Close what a test has drawn."""
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")
