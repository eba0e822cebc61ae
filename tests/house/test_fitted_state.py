"""What a fitted estimator says does not change with parameters that are set after its fit."""

from __future__ import annotations

import pickle
import warnings
from functools import cache

import numpy as np
import pandas as pd
import pytest
from sklearn.base import BaseEstimator, clone
from sklearn.pipeline import make_pipeline

import skhoid
from skhoid import (
    LPVARX,
    ARXRegressor,
    Decimator,
    DelayBankARX,
    DelaySearchCV,
    DelayShift,
    EffectSearchCV,
    GroupEffectSearch,
    OperatorKalman,
    OperatorRegressor,
    OrderSearchCV,
    RecursiveARX,
    RecursiveARXCV,
    RecursiveBoxJenkins,
    RecursiveFIR,
    RecursiveIV,
    RunInTrimmer,
    SigmoidOperator,
    SimulatedARX,
    VAFScorer,
    WaveletOperator,
    WindowedOperator,
    compare,
    make_tracking_runs,
    operator_parameters,
)
from skhoid.effects import DeadZone, Effects

SMALL = ARXRegressor(nk=11)
CASES = {
    "equation": SMALL,
    "constant": ARXRegressor(nk=11, fit_intercept=True, covariance="hac"),
    "instruments": ARXRegressor(nk=11, method="iv", inputs=["e"], instruments=["f_t"]),
    "effects": SimulatedARX(nk=11, inputs=["e"], effects=Effects.of(DeadZone())),
    "operator": OperatorRegressor(delay=0.28, effects=Effects.of(DeadZone())),
    "path": RecursiveARX(nk=11, memory_time=2.0),
    "last": RecursiveARX(nk=11, memory_time=2.0, parameters="last"),
    "horizons": RecursiveARXCV([32.0, 128.0], nk=11),
    "box jenkins": RecursiveBoxJenkins(nk=11, inputs=["e"], memory_time=5.0),
    "recursive instruments": RecursiveIV(nk=11, inputs=["e"], instruments=["f_t"], memory_time=5.0),
    "bank": DelayBankARX([10, 11], inputs=["e"], memory_time=5.0),
    "fir": RecursiveFIR(15, nk=11, inputs=["e"], memory_time=5.0, every=50),
    "lpv": LPVARX(nk=11, inputs=["e"]),
    "kalman": OperatorKalman(inputs=["e"], init_window=8.0),
    "windows": WindowedOperator(inputs=["e"], window=6.0),
    "sigmoid": SigmoidOperator(inputs=["e"]),
    "wavelets": WaveletOperator(inputs=["e"], omega0=4.0),
    "decimated": Decimator(2),
    "shifted": DelayShift(0.2),
    "trimmed": RunInTrimmer(1.0),
    "chain": make_pipeline(RunInTrimmer(1.0), Decimator(2), DelayShift(0.2), ARXRegressor()),
    "delays": DelaySearchCV(SMALL, nk=[10, 11], criterion="vaf"),
    "delays one by one": DelaySearchCV(RecursiveARX(memory_time=5.0), nk=[10, 11]),
    "orders": OrderSearchCV(make_pipeline(Decimator(2), SMALL), na=[2], nb=[1, 2], nk=[5]),
    "missing effects": EffectSearchCV(OperatorRegressor(), effects=["dead_zone"], max_effects=1),
}


class Nonsense:
    """A value that nobody may look at."""

    def _refuse(self, *args):
        raise AssertionError("a parameter was read after the fit")

    __bool__ = __eq__ = __iter__ = __len__ = __float__ = __index__ = __array__ = _refuse
    __getitem__ = __contains__ = __call__ = __lt__ = __gt__ = _refuse
    __hash__ = None


@cache
def runs():
    return make_tracking_runs(
        "C1",
        2,
        duration=10.24,
        sampling_rate=40,
        remnant_intensity=0.1,
        channels=("e", "x", "f_t"),
        random_state=0,
    )


def as_array(X):
    """The same table with its runs in a column and without time."""
    return np.column_stack([X, X.index.get_level_values("run").astype(float)])


def parts(estimator):
    """An estimator and the steps of its pipelines."""
    return [estimator, *(step for _, step in getattr(estimator, "steps", []))]


def told_by_array(estimator):
    """The same for arrays, in which nothing has a name."""
    told = clone(estimator)
    places = {"e": 0, "x": 1, "f_t": 2}
    for name, value in told.get_params(deep=True).items():
        if name.split("__")[-1] == "run":
            told.set_params(**{name: 3})
        elif name.split("__")[-1] == "dt":
            told.set_params(**{name: 0.025})
        elif name.split("__")[-1] == "inputs" and "effect" not in name:
            told.set_params(**{name: [0]})
        elif name.split("__")[-1] == "instruments" and value:
            told.set_params(**{name: [places[v] for v in value]})
    if isinstance(told, WaveletOperator):
        told.set_params(roles={2: "f_t"})
    return told


def set_nonsense(model):
    for part in parts(model):
        if "steps" not in vars(part):
            names = set(part.get_params(deep=False))
            if hasattr(part, "best_estimator_"):
                names.remove("estimator")  # of which scikit-learn's searches take the tags
            part.set_params(**{name: Nonsense() for name in names})


def answers(model, X, y):
    """What a fitted estimator says, to compare bit by bit."""
    found = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if hasattr(model, "transform"):
            found["transform"] = model.transform(X)
        if hasattr(model, "predict"):
            found["predict"], found["score"] = model.predict(X), model.score(X, y)
            found["scorer"] = VAFScorer()(model, X, y)
        if hasattr(model, "predict_ahead"):
            found["ahead"] = model.predict_ahead(X, y, 3)
            found["summary"] = model.summary(X, y)
        if hasattr(model, "simulate"):
            found["simulate"] = model.simulate(X)
            found["from states"] = model.simulate(X, y)
        if hasattr(model, "score_at_model_rate"):
            found["own rate"] = VAFScorer(rate="model")(model, X, y)
        if hasattr(model, "to_transfer_function"):
            found["transfer"] = model.to_transfer_function().num
        if hasattr(model, "predict_ahead") or hasattr(model, "steps"):
            method = "fit" if isinstance(model, RecursiveFIR) else "poles"
            found["physics"] = operator_parameters(model, method=method)
        if hasattr(model, "_found_html"):
            found["page"] = model._found_html()
        if isinstance(model, (OperatorRegressor, EffectSearchCV)):
            found["text"] = model.summary()
    return found


def assert_same(found, expected, what):
    assert found.keys() == expected.keys(), what
    for name, value in expected.items():
        if isinstance(value, (pd.DataFrame, pd.Series)):
            pd.testing.assert_frame_equal(
                found[name], value, check_exact=True, obj=f"{what}, {name}"
            )
        else:
            np.testing.assert_array_equal(found[name], value, err_msg=f"{what}, {name}")


def test_all_estimators_are_here():
    public = {
        value
        for value in (getattr(skhoid, name) for name in skhoid.__all__)
        if isinstance(value, type) and issubclass(value, BaseEstimator) and hasattr(value, "fit")
    }
    public -= {GroupEffectSearch}  # it has tables, and predicts nothing
    assert public == {type(part) for case in CASES.values() for part in parts(case)} & public


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("form", ["frame", "array"])
def test_nothing_is_read_from_parameters_after_the_fit(case, form):
    X, y = runs()
    model = clone(CASES[case])
    if form == "array":
        model, X, y = told_by_array(model), as_array(X), y.to_numpy()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model.fit(X, y)
    expected = answers(model, X, y)
    again = pickle.loads(pickle.dumps(model))
    set_nonsense(again)
    assert_same(answers(again, X, y), expected, case)
    if form == "frame" and hasattr(model, "predict"):
        assert compare(again, X, y).summary() == compare(model, X, y).summary()


@pytest.mark.parametrize("case", ["effects", "operator"])
def test_nothing_changes_with_parameters_of_effects(case):
    X, y = runs()
    model = clone(CASES[case]).fit(X, y)
    expected = answers(model, X, y)
    model.set_params(effects__dead_zone__width=7.0)
    assert_same(answers(model, X, y), expected, "width")


def test_nothing_changes_with_parameters_of_a_searched_model():
    X, y = runs()
    model = clone(CASES["delays"]).fit(X, y)
    expected = answers(model, X, y)
    model.set_params(estimator__na=5, estimator__nk=0, estimator__dt=0.5)
    assert_same(answers(model, X, y), expected, "estimator")


def test_a_clone_and_another_fit_take_the_new_parameters():
    X, y = runs()
    model = ARXRegressor(nk=11).fit(X, y).set_params(na=1, nk=3)
    fresh = ARXRegressor(na=1, nk=3).fit(X, y)
    assert model.get_params()["na"] == 1
    for other in (clone(model).fit(X, y), model.fit(X, y)):
        np.testing.assert_array_equal(other.predict(X), fresh.predict(X))
