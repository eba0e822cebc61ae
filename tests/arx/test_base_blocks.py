"""Free runs and predictions that read a block of rows at a time go on where the last one ended."""

import numpy as np
import pytest
from sklearn.pipeline import make_pipeline
from support.synthetic import arx_runs

from skhoid import ARXRegressor, Decimator, MissingDataWarning, RecursiveARX, RunInTrimmer

A = (-1.1, 0.5, -0.2)
MODELS = {
    "from rest": ARXRegressor(3, 2, 3, initial="rest"),
    "begun": ARXRegressor(3, 2, 3, initial="estimate", fit_intercept=True),
    "no past outputs": ARXRegressor(0, 4, 1),
    "two inputs": ARXRegressor(2, [1, 2], [0, 5], inputs=["e", "x"]),
    "over time": RecursiveARX(2, 2, 3, memory_time=1.0),
    "run-in": make_pipeline(RunInTrimmer(0.4), ARXRegressor(3, 2, 3)),
    "decimated": make_pipeline(Decimator(2), ARXRegressor(2, 2, 1)),
}


@pytest.fixture(scope="module")
def data():
    X, y = arx_runs(lengths=[150, 90, 7, 120], a=A, seed=3)
    X.iloc[[20, 21, 160, 161, 162], 0] = np.nan
    y.iloc[[33, 34, 35, 170]] = np.nan
    return X, y


def answers(model, X, y):
    steps, last = (model[:-1], model[-1]) if hasattr(model, "steps") else (None, model)
    passed = X if steps is None else steps.transform(X)
    yield "predict", model.predict(X)
    yield "initial states", last.simulate(passed, y, initial_state="estimate")
    yield "score", np.array([last.score(passed, y)])
    for horizon in (1, 3, 60):
        yield f"{horizon} ahead", last.predict_ahead(passed, y, horizon)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skhoid.MissingDataWarning")
@pytest.mark.parametrize("rows", [1, 7, 64])
@pytest.mark.parametrize("name", MODELS)
def test_blocks_of_any_size_give_the_same_bits(name, rows, data, monkeypatch):
    X, y = data
    long = X.index.get_level_values("run") != 3
    model = MODELS[name].fit(X[long], y[long])
    if name in ("decimated", "run-in"):
        X, y = X[long], y[long]
    whole = dict(answers(model, X, y))
    monkeypatch.setattr("skhoid.arx.base.BLOCK", rows)
    monkeypatch.setattr("skhoid.preprocessing.grid.BLOCK", rows)
    for what, found in answers(model, X, y):
        np.testing.assert_array_equal(found, whole[what], err_msg=what)


def test_what_is_missing_is_counted_once(data, monkeypatch):
    X, y = data
    monkeypatch.setattr("skhoid.preprocessing.grid.BLOCK", 21)
    with pytest.warns(MissingDataWarning):
        model = ARXRegressor(2, 2, 3, inputs=["e"]).fit(X, y)
    with pytest.warns(MissingDataWarning, match=r"5 rows of the inputs \['e'\]") as found:
        model.predict(X)
    assert len(found) == 1
