"""``compare`` at its edges: short, silent, torn and missing data, and errors in words."""

import re

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from support.comparison import Gives, names, vaf
from support.hidden_effects import Oracle

from skhoid import (
    ARXRegressor,
    compare,
)

pytestmark = pytest.mark.slow

# Edges


def cut(table, *lengths):
    return pd.concat([table.loc[[k]].iloc[:n] for k, n in enumerate(lengths, 1)])


def said(comparison):
    """Numbers are finite, or words say why not."""
    text = comparison.summary()
    assert np.isfinite([comparison.vaf, comparison.rmse]).all()
    assert np.isfinite(comparison.by_time[["rmse", "share", "ratio"]]).all(axis=None)
    if comparison.ceiling_route == "none":
        assert comparison.ceiling.note.text in " ".join(text.split())
    else:
        values = [comparison.noise_ceiling, *comparison.noise_ceiling_interval]
        assert np.isfinite([*values, comparison.explainable_gap]).all()
    rule = comparison.tests["test"] == "lost control"
    tests = comparison.tests[~rule]
    assert tests["p"].between(0, 1).all()
    assert np.isfinite(tests["statistic"].astype(float)).all()
    assert not re.search(r"\bnan\b", " ".join(map(str, comparison.findings)))
    comparison._repr_html_()
    return names(comparison)


def test_perfect_model(simulated):
    X, y, _ = simulated
    comparison = compare(Gives(lambda rows: y.loc[rows.index]), X, y)
    found = said(comparison)
    assert comparison.vaf == 100
    assert_allclose(comparison.noise_ceiling, 100)
    assert not comparison.tests["exceeds"].any()
    assert set(found) <= {"none", "one target"}


@pytest.mark.parametrize(("n_rows", "n_runs"), [(2, 1), (75, 3)])
def test_very_short_runs_are_compared_or_refused_in_words(simulated, n_rows, n_runs):
    X, y, truth = simulated
    X, y = cut(X, *[n_rows] * n_runs), cut(y, *[n_rows] * n_runs)
    try:
        comparison = compare(Oracle(truth.u_without_remnant), X, y)
    except ValueError as error:
        assert "compare" in str(error) or "short" in str(error)  # noqa: PT017
        assert "row" in str(error) or " s" in str(error)  # noqa: PT017
    else:
        said(comparison)


def test_missing_output(simulated):
    X, y, truth = simulated
    y = y.copy()
    y.iloc[100:150] = np.nan
    comparison = compare(Oracle(truth.u_without_remnant), X, y)
    said(comparison)
    assert "50 rows in which the output is missing are left out" in map(str, comparison.notes)
    assert comparison.traces["scored"].sum() == y.size - 50
    known = y.notna()
    assert_allclose(comparison.vaf, vaf(y[known], truth.u_without_remnant[known]))


def test_no_roles(simulated):
    X, y, truth = simulated
    X = X.rename(columns={"e": "a", "x": "b", "f_t": "c"})
    comparison = compare(Oracle(truth.u_without_remnant), X, y)
    said(comparison)
    assert comparison.ceiling.note.kind == "the target is not known"
    assert "say with repeats=" in comparison.ceiling_note
    assert comparison.correlations.empty
    known = compare(Oracle(truth.u_without_remnant), X, y, repeats=True)
    said(known)
    assert known.ceiling_route == "repeats"


# Errors


@pytest.mark.parametrize(
    ("repeats", "message"),
    [
        ({1: "a", 9: "a"}, r"repeats names run 9; the runs are \[1, 2, 3\]"),
        (["a", "a"], "repeats has 2 entries for 3 runs: give one label per run"),
        ("all", "repeats"),
    ],
)
def test_repeats_that_cannot_be(simulated, repeats, message):
    X, y, truth = simulated
    with pytest.raises((ValueError, TypeError), match=message):
        compare(Oracle(truth.u_without_remnant), X, y, repeats=repeats)


@pytest.mark.parametrize(
    ("roles", "message"),
    [
        ({"error": "e"}, "roles names 'error', which is not a column of X; the columns are"),
    ],
)
def test_roles_that_cannot_be(simulated, roles, message):
    X, y, truth = simulated
    with pytest.raises((ValueError, TypeError), match=message):
        compare(Oracle(truth.u_without_remnant), X, y, roles=roles)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda X, y: {"run_in": 100.0}, "a run-in of 100 s leaves nothing of it"),
        (lambda X, y: {"y": y.iloc[::-1]}, "The row indexes of X and y disagree"),
        (lambda X, y: {"y": np.nan * y}, "No row is left to score"),
        (lambda X, y: {"y": 0.0 * y}, "VAF is undefined: the measured output is zero"),
        (lambda X, y: {"X": X.assign(e=X["e"].where(np.arange(y.size) != 5, np.inf))}, "infinity"),
        (lambda X, y: {"estimation": X}, "estimation"),
        (
            lambda X, y: {"model": Gives(lambda rows: np.zeros(3))},
            "returns 3 values for the 6144 rows",
        ),
        (
            lambda X, y: {"model": Gives(lambda rows: np.full(len(rows), np.nan))},
            "The prediction is NaN in run 1, t = 0 s",
        ),
        (lambda X, y: {"model": ARXRegressor()}, "not fitted"),
    ],
)
def test_what_cannot_be_compared_is_said(simulated, change, message):
    X, y, truth = simulated
    arguments = {"model": Oracle(truth.u_without_remnant), "X": X, "y": y} | change(X, y)
    with pytest.raises((ValueError, TypeError), match=message):
        compare(arguments.pop("model"), arguments.pop("X"), arguments.pop("y"), **arguments)
