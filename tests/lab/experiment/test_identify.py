"""identify_people: separate fits, failures, unequal data, what searches find."""

import warnings

import numpy as np
import pandas as pd
import pytest
from sklearn.base import BaseEstimator, RegressorMixin, clone
from sklearn.model_selection import GridSearchCV, LeaveOneGroupOut
from sklearn.pipeline import make_pipeline
from support.small_experiment import DT, NK, made

from skhoid import (
    ARXRegressor,
    Decimator,
    DelaySearchCV,
    DelayShift,
    EffectSearchCV,
    OperatorRegressor,
    RecursiveARX,
    RunInTrimmer,
    VAFScorer,
    compare,
    make_tracking_runs,
    operator_parameters,
    run_labels,
)
from skhoid.exceptions import RunIndexError
from skhoid.lab.experiment import identify_people
from skhoid.lab.experiment.people import COLUMNS

TRACKING = {"channels": ["e", "x", "f_t"], "sampling_rate": 50}
ARX = ARXRegressor(nk=NK)
SHIFTED = make_pipeline(Decimator(factor=2), DelayShift(delay=NK * DT), ARXRegressor())
GRID = GridSearchCV(
    make_pipeline(DelayShift(), ARXRegressor()),
    {"delayshift__delay": [0.28, 0.3]},
    scoring=VAFScorer(),
    cv=LeaveOneGroupOut(),
)


def part_of(X, y, **labels):
    """The rows of one group or run, without the levels that tell groups apart."""
    keep = np.ones(len(X), dtype=bool)
    for level, label in labels.items():
        keep &= X.index.get_level_values(level) == label
    gone = [name for name in ("subject", "condition") if name in X.index.names]
    return X[keep].droplevel(gone), y[keep].droplevel(gone)


def values(table, **labels):
    for level, label in labels.items():
        table = table[[one == label for one in table[level]]]
    return table.set_index("parameter")


def own_parameters(model):
    while hasattr(model, "best_estimator_") or hasattr(model, "steps"):
        model = model.best_estimator_ if hasattr(model, "best_estimator_") else model[-1]
    return model.parameters_


@pytest.mark.parametrize(
    "estimator",
    [
        pytest.param(OperatorRegressor(delay=0.28), id="operator"),
        pytest.param(SHIFTED, id="pipeline"),
        pytest.param(RecursiveARX(nk=NK, memory_time=5.0), id="recursive", marks=pytest.mark.slow),
    ],
)
def test_the_table_is_that_of_separate_fits_to_the_last_bit(estimator):
    X, y = made(subjects=1, conditions=("A",), runs=2)
    result = identify_people(estimator, X, y, ceiling=False)
    assert tuple(result.table.columns) == tuple(result.groups.columns) == COLUMNS
    assert result.each_run
    assert list(dict.fromkeys(result.table["run"])) == [1, 2]
    for run in (1, 2, "all"):
        labels = {} if run == "all" else {"run": run}
        X_part, y_part = part_of(X, y, subject="P1", **labels)
        model = clone(estimator).fit(X_part, y_part)
        vaf = VAFScorer()(model, X_part, y_part)
        found = values(result.groups if run == "all" else result.table, run=run)
        told = own_parameters(model)
        assert found.loc[told.index, "estimate"].tolist() == told["value"].tolist()
        np.testing.assert_array_equal(found.loc[told.index, "se"], told["sd"])
        assert set(found["vaf"]) == {vaf}
        assert set(found["n_rows"]) == {len(y_part)}


@pytest.mark.parametrize("name", ["delay", "grid"])
def test_searches_are_fitted_to_groups_and_tell_what_they_chose(name):
    X, y = made(subjects=2, conditions=("A",), runs=2)
    estimator = {"delay": DelaySearchCV(ARXRegressor(), nk=range(12, 18)), "grid": GRID}[name]
    result = identify_people(estimator, X, y, ceiling=False)
    assert not result.each_run
    pd.testing.assert_frame_equal(result.table, result.groups)
    for subject in ("P1", "P2"):
        X_part, y_part = part_of(X, y, subject=subject)
        groups = {"groups": run_labels(X_part)} if name == "grid" else {}
        search = clone(estimator).fit(X_part, y_part, **groups)
        found, told = values(result.table, subject=subject), own_parameters(search)
        assert found.loc[told.index, "estimate"].tolist() == told["value"].tolist()
        chosen = "delay" if name == "delay" else "delayshift__delay"
        best = search.best_delay_ if name == "delay" else search.best_params_[chosen]
        assert found.loc[chosen, "estimate"] == best
        assert found.loc["tau_e", "estimate"] == pytest.approx(best - DT)
        assert set(result.models) == {("P1", "A"), ("P2", "A")}


def test_operator_parameters_and_ceiling_are_those_of_the_group():
    X, y = make_tracking_runs("C1", n_runs=3, remnant_intensity=0.1, random_state=0, **TRACKING)
    result = identify_people(ARX, X, y)
    model = result.models["all", "all"]
    told = operator_parameters(model).iloc[0]
    ceiling = compare(model, X, y).noise_ceiling
    found = values(result.groups)
    for name in ("K_e", "T_L", "K_edot", "omega_nm", "zeta_nm"):
        assert found.loc[name, ["estimate", "se"]].tolist() == told[[name, f"sd_{name}"]].tolist()
    assert "tau_e" not in found.index  # which was given
    assert np.isfinite(ceiling)
    assert set(result.groups["ceiling"]) == set(result.table["ceiling"]) == {ceiling}
    assert found.loc["T_L", "unit"] == "s"
    assert "noise ceiling" in result.summary()


class Fussy(RegressorMixin, BaseEstimator):
    """Fails on one run, is interrupted by another, warns of a third; has no parameters."""

    def __init__(self, fails=None, stops=None):
        self.fails = fails
        self.stops = stops

    def fit(self, X, y):
        marks = set(np.round(X["e"].to_numpy()[::500], 9))
        if self.fails in marks:
            raise RuntimeError("did not converge")
        if self.stops in marks:
            raise KeyboardInterrupt
        warnings.warn(f"only {len(X)} rows", UserWarning, stacklevel=2)
        self.mean_ = 0.0
        return self

    def predict(self, X):
        return np.full(len(X), self.mean_)


def test_failures_are_rows_and_warnings_are_counted_notes():
    X, y = made(subjects=2, conditions=("A",), runs=2)
    mark = round(X["e"].iloc[500], 9)  # the first row of the second run
    result = identify_people(Fussy(fails=mark), X, y)
    reason = "RuntimeError: did not converge"
    failed = result.failures
    assert failed[["subject", "run"]].to_numpy().tolist() == [["P1", "all"], ["P1", 2]]
    assert set(failed["failure"]) == {reason}
    assert set(failed["parameter"]) == {""}
    assert failed["estimate"].isna().all()
    assert set(result.models) == {("P2", "A")}
    assert values(result.table, subject="P2")["estimate"].to_numpy() == pytest.approx(0.0)
    assert set(result.table["parameter"]) == {"", "vaf"}
    (note,) = [note for note in result.notes if "only" in note]
    assert "(and 3 more): UserWarning: only 500 rows" in note
    text = result.summary()
    assert "P1 A, run 2: RuntimeError: did not converge" in text
    assert "<table>" in result._repr_html_()
    with pytest.raises(KeyboardInterrupt):
        identify_people(Fussy(stops=mark), X, y)


def test_unequal_runs_missing_conditions_and_short_runs():
    X, y = made(subjects=2, conditions=("A", "B"), runs=2)
    level = X.index.get_level_values
    gone = (level("subject") == "P2") & (level("condition") == "B")
    gone |= (level("subject") == "P1") & (level("run") == 2) & (level("time") > 0.1)
    X, y = X[~gone], y[~gone]
    result = identify_people(ARX, X, y, ceiling=False)
    short = result.failures
    assert short[["condition", "run"]].to_numpy().tolist() == [
        [condition, run] for run in ("all", 2) for condition in ("A", "B")
    ]
    assert short["failure"].str.startswith("ShortRunError: ").all()
    assert "B has no runs of P2" in result.notes
    assert result.runs["n_rows"].tolist() == [500, 6, 500, 6, 500, 500]
    assert "2 people, 2 conditions; 2 runs of each, 6 in all" in result.summary().replace("\n", " ")


def test_groups_whose_runs_are_apart_are_the_same_groups():
    X, y = made(subjects=2, conditions=("A",), runs=2)
    order = np.concatenate([np.arange(k * 500, (k + 1) * 500) for k in (0, 2, 1, 3)])
    one = identify_people(ARX, X, y, ceiling=False)
    two = identify_people(ARX, X.iloc[order], y.iloc[order].to_numpy(), ceiling=False)
    pd.testing.assert_frame_equal(one.table, two.table, check_exact=True)


@pytest.mark.parametrize(
    ("change", "error", "text"),
    [
        (lambda X, y: (X.to_numpy(), y), RunIndexError, "got ndarray"),
        (lambda X, y: (X.reset_index(drop=True), y), RunIndexError, "got DataFrame without them"),
        (lambda X, y: (X.droplevel("run"), y), RunIndexError, "no index level 'run'"),
        (lambda X, y: (X, y.to_numpy()[:-1]), ValueError, "1000 rows but y has 999"),
        (lambda X, y: (X[:0], y[:0]), ValueError, "no rows"),
    ],
)
def test_what_is_refused(change, error, text):
    X, y = change(*made(subjects=1, conditions=("A",), runs=2))
    with pytest.raises(error, match=text):
        identify_people(ARX, X, y)


def test_a_search_for_effects_tells_what_each_person_has():
    X, y = made(subjects=2, conditions=("A",), runs=2, n=1500)
    offset = y.to_numpy() + 2 * y.std() * (X.index.get_level_values("subject") == "P2")
    y = pd.Series(offset, X.index, name="u")
    search = EffectSearchCV(OperatorRegressor(delay=0.28), effects=["bias"])
    result = identify_people(search, X, y, ceiling=False)
    assert not result.each_run
    found = result.found.set_index("subject")
    assert found.loc["P1", "effect"] == ""
    assert found.loc["P1", "verdict"] == "nothing found"
    assert found.loc["P2", "effect"] == "bias"
    assert found.loc["P2", "parameter"] == "level"
    told = result.models["P2", "A"].best_estimator_.parameters_.loc["bias__level"]
    assert found.loc["P2", "estimate"] == told["value"]
    assert values(result.table, subject="P2").loc["bias__level", "se"] == told["sd"]
    assert "bias: 1 of 2" in result.summary()


def test_a_run_in_is_left_out_of_each_run_too():
    X, y = made()
    trimmed = RunInTrimmer(run_in=2.0).fit_transform(X)
    table = identify_people(ARX, trimmed, y).table
    assert (table["failure"] == "").all()
    assert not np.allclose(table["estimate"], identify_people(ARX, X, y).table["estimate"])
