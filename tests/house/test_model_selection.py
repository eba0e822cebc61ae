"""The table of what works of scikit-learn's model selection (docs/validate.md), line by line."""

import re
import warnings
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from sklearn import ensemble, inspection, model_selection
from sklearn.base import clone
from sklearn.experimental import enable_halving_search_cv  # noqa: F401
from sklearn.metrics import r2_score

from skhoid import (
    ARXRegressor,
    OperatorRegressor,
    RecursiveARX,
    RunIndexError,
    make_tracking_runs,
    run_labels,
    vaf_score,
)
from skhoid.exceptions import RunCutWarning

pytestmark = pytest.mark.slow  # each line of the table is a cross-validation

PAGE = Path(__file__).resolve().parents[2] / "docs" / "validate.md"
LINES = re.findall(
    r"^\| `([^`]*(?:model)[^`]*)` \| ([^|]+) \| ([^|]+) \|", PAGE.read_text("utf-8"), re.M
)
CELLS = [
    (code, verdict.strip(), runs)
    for code, one, several in LINES
    for runs, verdict in (("one", one), ("several", several))
    if verdict.strip() != "–"
]
MODELS = {
    "arx": ARXRegressor(2, 2, 15, dt=0.02),
    "recursive": RecursiveARX(2, 2, 15, init_window=5.0, parameters="last", dt=0.02),
    "operator": OperatorRegressor(dt=0.02),
}
NAMES = {
    **{n: getattr(m, n) for m in (model_selection, ensemble, inspection) for n in m.__all__},
    "run_labels": run_labels,
}


@cache
def recorded(runs):
    X, y = make_tracking_runs(
        "C1", 4, remnant_intensity=0.1, sampling_rate=50.0, channels=("e",), random_state=3
    )
    return (X, y) if runs == "several" else (X.loc[[1]], y.loc[[1]])


@cache
def of_own_hand(name, runs, folds):
    """Scores of folds: fitted with all other output unknown, and the runs simulated whole."""
    model, (X, y) = MODELS[name], recorded(runs)
    scores, simulated = [], np.zeros(len(y))
    labels = np.asarray(run_labels(X))
    cv = model_selection.check_cv(eval(folds, NAMES))
    for train, test in cv.split(X, groups=labels if "Group" in folds else None):
        known = y.where(np.isin(np.arange(len(y)), train))
        whole = np.isin(labels, labels[test])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that output is unknown
            fitted = clone(model).fit(X, known)
        simulated[whole] = fitted.predict(X[whole])
        error = (y - simulated).iloc[test]
        scores.append(100 * (1 - np.sum(error**2) / np.sum(y.iloc[test] ** 2)))
    return np.array(scores)


def figures(found, X, y):
    """What a line of the table gives, as scores in percent."""
    if isinstance(found, tuple):
        return found[2][-1]
    if isinstance(found, np.ndarray):
        return found if len(found) < len(y) else np.array([vaf_score(y, found)])
    if hasattr(found, "best_score_"):
        return np.array([found.best_score_])
    if hasattr(found, "importances"):
        return found.importances.ravel()
    if hasattr(found, "estimators_"):
        return 100 * np.array([r2_score(y, found.predict(X))])
    return np.array([found.score(X, y)])


def test_the_table_is_read():
    assert len(LINES) > 20
    verdicts = {verdict.strip() for _, *both in LINES for verdict in both}
    assert verdicts == {"right", "error", "joins runs", "–"}


def check(code, verdict, runs, name):
    X, y = recorded(runs)
    model = clone(MODELS[name])
    given = {**NAMES, "model": model, "X": X, "y": y}
    if verdict == "error":
        with pytest.raises((RunIndexError, ValueError)) as raised:
            eval(
                re.sub(r"\)$", ', error_score="raise")', code) if "_score" in code else code, given
            )
        assert "drawn one by one" in str(raised.value)
        assert "LeaveOneGroupOut" in str(raised.value)
        return
    found = figures(eval(code, given), X, y)
    assert np.isfinite(found).all()
    if name == "recursive" or verdict != "right":
        return  # its path has the parameters of other times: no truth but the fold's own
    if "cv=" not in code:
        assert min(found) > clone(model).fit(X, y).score(X, y) - 5
        return
    truth = of_own_hand(name, runs, re.search(r"cv=(\w+(?:\([^)]*\))?)", code)[1])
    if found.size == truth.size:
        # Fitted without the first piece, an operator cannot know that it began in motion.
        worst = np.median if name == "operator" else np.max
        assert worst(np.abs(found - truth)) < 4
    else:
        assert found[0] == pytest.approx(truth.mean(), abs=4)


@pytest.mark.parametrize(("code", "verdict", "runs"), CELLS)
def test_it_is_as_the_table_says(code, verdict, runs):
    check(code, verdict, runs, "arx")


@pytest.mark.parametrize("name", ["recursive", "operator"])
@pytest.mark.parametrize(
    ("code", "verdict", "runs"), [c for c in CELLS if c[1:] == ("right", "several")]
)
def test_it_is_so_with_other_models(code, verdict, runs, name):
    check(code, verdict, runs, name)


DRAWN = {
    "every other row at random": lambda n, rng: np.flatnonzero(rng.random(n) < 0.5),
    "a tenth of the rows": lambda n, rng: np.sort(rng.choice(n, n // 10, replace=False)),
    "all rows, shuffled": lambda n, rng: rng.permutation(n),
    "drawn with replacement": lambda n, rng: rng.integers(0, n, n),
    "pairs of rows": lambda n, rng: np.repeat(3 * np.arange(n // 3), 2) + np.tile([0, 1], n // 3),
    "blocks of ten, one left out": lambda n, rng: np.flatnonzero(np.arange(n) % 11 < 10),
}


@pytest.mark.parametrize("frame", [True, False])
@pytest.mark.parametrize("kind", DRAWN)
def test_rows_that_were_drawn_are_refused_everywhere(kind, frame):
    X, y = recorded("one")
    if frame:
        X, y = X.reset_index(drop=True), y.reset_index(drop=True)
    rows = DRAWN[kind](len(X), np.random.default_rng(0))
    fitted = clone(MODELS["arx"]).fit(X[:1500], y[:1500])
    torn = X.iloc[rows], y.iloc[rows]
    for act in (clone(fitted).fit, fitted.score, lambda X, y: fitted.predict(X)):
        with pytest.raises(RunIndexError, match=r"drawn one by one.*LeaveOneGroupOut"):
            act(*torn)


@pytest.mark.parametrize("orders", [(1, 1, 0), (1, 2, 3)])
@pytest.mark.parametrize("n_splits", [2, 8])
def test_a_model_of_few_lags_has_no_score_by_rows(orders, n_splits):
    X, y = recorded("one")
    cv = model_selection.KFold(n_splits, shuffle=True, random_state=1)
    with pytest.raises(RunIndexError, match="drawn one by one"):
        model_selection.cross_val_score(ARXRegressor(*orders), X, y, cv=cv, error_score="raise")


def test_recordings_with_gaps_are_fitted_and_scored():
    """Lost packets here and there, half a run, and a table that was thinned evenly."""
    X, y = recorded("one")
    lost = np.isin(np.arange(len(X)) // 7, [40, 120, 121, 300, 301, 302, 510])
    for rows in (~lost, np.arange(len(X)) < 2000, np.arange(len(X)) % 2 == 0):
        part = X[rows], y[rows]
        assert ARXRegressor(2, 2, 8).fit(*part).score(*part) > 50
    thinned = X.reset_index(drop=True)[::3], y.reset_index(drop=True)[::3]
    assert ARXRegressor(2, 2, 5).fit(*thinned).score(*thinned) > 50


def test_arrays_in_no_order_are_warned_of():
    X, y = (data.to_numpy() for data in recorded("one"))
    rows = np.random.default_rng(0).permutation(len(y))
    with pytest.warns(RunCutWarning, match="the row before it"):
        ARXRegressor(2, 2, 15).fit(X[rows], y[rows])
    white = np.random.default_rng(1).standard_normal((3000, 1))
    answer = pd.Series(white[:, 0]).rolling(3, min_periods=1).sum().to_numpy()
    assert ARXRegressor(1, 3, 0).fit(white, answer).score(white, answer) > 99
