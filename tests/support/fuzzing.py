"""For how long a fuzz test draws, and what a refusal has to be."""

from __future__ import annotations

import functools
import itertools
import linecache
import os
import re
import time
import traceback
import warnings
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import HealthCheck, given, seed, settings
from sklearn.exceptions import ConvergenceWarning, DataConversionWarning, NotFittedError
from sklearn.utils._param_validation import InvalidParameterError

import skhoid.exceptions

MINUTES = float(os.environ.get("SKHOID_FUZZ_MINUTES", "1"))
BATCHES = int(os.environ.get("SKHOID_FUZZ_BATCHES", "0"))  # of each test, in place of the time
SEED = int(os.environ.get("SKHOID_FUZZ_SEED", "0"))
OURS = tuple(getattr(skhoid.exceptions, name) for name in skhoid.exceptions.__all__)
WARNINGS = (
    *(cls for cls in OURS if issubclass(cls, Warning)),
    DataConversionWarning,  # scikit-learn's, of a y with one column
    ConvergenceWarning,  # with which we say so of instruments
)
ERRORS = tuple(cls for cls in OURS if not issubclass(cls, Warning))
PLAIN = (
    ValueError,
    TypeError,
    InvalidParameterError,  # scikit-learn's own, of both
    NotFittedError,
    ImportError,
    FileNotFoundError,
    FileExistsError,
)
RAW = re.compile(
    r"broadcast|out of bounds|object of type|object is not|has no attribute|not subscriptable|"
    r"unsupported operand|ufunc|did not converge|SVD|Singular matrix|cannot reindex|"
    r"Length mismatch|truth value|positional argument|codec can't|zero-size array|"
    r"list index|need at least one array|could not convert string|infs or NaNs|"
    r"cannot convert float|array must not contain|Eigenvalues|not positive definite|"
    r"empty sequence|zero-dimensional"
)
QUOTED = re.compile(
    "cannot be read as|is broken, or|failed for the array|it failed for "
)  # what others say

_seconds = 60.0


def share(tests: int, workers: int) -> None:
    """Divide ``MINUTES`` of all workers among the tests that were selected."""
    global _seconds
    _seconds = 60 * MINUTES * workers / max(tests, 1)


def fuzz(batch: int = 25, **strategies: Any) -> Callable:
    """Draw arguments again and again, until the test's share of the time is over.

    Hypothesis has no limit of time, and takes a test that stops by the clock for a flaky one: it is
    called for one small batch after another. Batch k is that of the seed ``SEED`` + k, so that runs
    of one seed draw the same, a longer one more, and runs of so many ``BATCHES`` exactly the same.
    """

    def decorate(test: Callable) -> Callable:
        drawing = settings(
            max_examples=batch,
            database=None,
            deadline=None,
            suppress_health_check=list(HealthCheck),
        )(given(**strategies)(test))

        @pytest.mark.fuzz
        @functools.wraps(drawing)
        def run(**fixtures: Any) -> None:
            end = time.monotonic() + _seconds
            for number in itertools.count():
                seed(SEED + number)(drawing)(**fixtures)
                if number + 1 >= BATCHES if BATCHES else time.monotonic() > end:
                    break

        run.draws = True  # type: ignore[attr-defined]
        return run

    return decorate


def outcome(call: Callable, *args: Any, **kwargs: Any) -> tuple[Any, Exception | None]:
    """What a call returned, and the documented error by which it refused; another one fails.

    Warnings are errors, but for those that users may want to catch.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for category in WARNINGS:
            warnings.simplefilter("ignore", category)
        try:
            return call(*args, **kwargs), None
        except Exception as error:
            problem = undocumented(error)
            if problem is None:
                return None, error
            raise AssertionError(f"{problem}: {type(error).__name__}: {error}") from error


def undocumented(error: Exception) -> str | None:
    """Why an error is none that skhoid, or scikit-learn for it, raised on purpose; or None."""
    if type(error) not in (*ERRORS, *PLAIN):
        return "Not a documented class"
    text = str(error)
    if len(text) < 20:
        return "The message is too short to help"
    if RAW.search(text) and not QUOTED.search(text):
        return "The message is that of another library"
    place = traceback.extract_tb(error.__traceback__)[-1]
    if "joblib" in place.filename and error.__cause__ is not None:  # raised by a worker
        told = re.findall(r'File "(.*)", line (\d+), in .*\n', str(error.__cause__))
        place = traceback.FrameSummary(told[-1][0], int(told[-1][1]), "")
    if not re.search(r"[/\\](skhoid|sklearn|joblib)[/\\]", place.filename):
        return f"Raised in {place.filename}:{place.lineno}"
    if not linecache.getline(place.filename, place.lineno or 0).strip().startswith("raise"):
        return f"Not raised on purpose, in {place.filename}:{place.lineno}"
    return None
