"""Runs the Python blocks of README.md and of the pages under docs/ as tests; closes figures."""

import os
import sys
from doctest import ELLIPSIS, NORMALIZE_WHITESPACE
from zlib import crc32

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

pytest_collect_file = Sybil(
    parsers=[
        PythonCodeBlockParser(doctest_optionflags=ELLIPSIS | NORMALIZE_WHITESPACE | NUMBER),
        SkipParser(),
    ],
    patterns=["README.md", "docs/*.md", "docs/**/*.md"],
    fixtures=["close_figures"],
).pytest()


SLOW_PAGES = {  # whose examples search, simulate or start processes for many seconds
    "README.md",
    "add-an-effect.md",
    "box_jenkins.py",
    "compare.md",
    "delay_bank.py",
    "document.py",
    "effect-in-depth.md",
    "effect_search.py",
    "effects.md",
    "experiment-data.md",
    "experiment-statistics.md",
    "experiments.md",
    "find-what-is-missing.md",
    "follow.md",
    "from-shape-to-name.md",
    "group-effects.md",
    "hidden-change.md",
    "identify-people.md",
    "index.md",
    "monte-carlo.md",
    "noise-ceiling.md",
    "operator_kalman.py",
    "other-ways-to-follow.md",
    "own-study.md",
    "read-the-ranking.md",
    "recursive_fir.py",
    "recursive_iv.py",
    "report.md",
    "restyle.md",
    "scale-out.md",
    "search.py",
    "shape.py",
    "sigmoid_operator.py",
    "story.py",
    "thesis-studies.md",
    "track-a-change.md",
    "validate.md",
    "which-method.md",
    "windowed_operator.py",
}


def pytest_addoption(parser):
    """Let slow tests be run in parts, each in minutes."""
    parser.addoption("--part", metavar="K/N", help="of N parts of the files, only the Kth (1 to N)")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Mark the examples of slow pages, and keep the part of the files that was asked for."""
    for item in items:
        if item.path.name in SLOW_PAGES:
            item.add_marker(pytest.mark.slow)
    if config.option.part:
        part, parts = map(int, config.option.part.split("/"))
        files = {item.path for item in items}
        kept = {path for path in files if crc32(path.name.encode()) % parts == part - 1}
        config.hook.pytest_deselected(items=[item for item in items if item.path not in kept])
        items[:] = [item for item in items if item.path in kept]


@pytest.fixture(autouse=True)
def close_figures():
    """Close what a test has drawn."""
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")
