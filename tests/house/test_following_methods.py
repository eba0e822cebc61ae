"""What every method that follows an operator has to bear: runs, gaps, NaN, pauses, streams."""

import pickle
import warnings
from functools import cache

import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone
from sklearn.pipeline import make_pipeline

from skhoid import (
    LPVARX,
    Decimator,
    DelayBankARX,
    OperatorKalman,
    RecursiveARX,
    RecursiveBoxJenkins,
    RecursiveFIR,
    RecursiveIV,
    SigmoidOperator,
    WaveletOperator,
    WindowedOperator,
    compare,
    make_tracking_runs,
    operator_parameters,
    select_runs,
)

pytestmark = [
    pytest.mark.slow,  # compiles for many seconds, and fits
    pytest.mark.filterwarnings("ignore::skhoid.MissingDataWarning"),
    pytest.mark.filterwarnings("ignore:.*ARX models have:UserWarning"),
]

RATE = 50
ONE = {"inputs": ["e"]}
ARX = {**ONE, "nk": 15}
CAUSAL = {
    "least squares": RecursiveARX(**ARX, memory_time=5.0, init_window=15.0),
    "box jenkins": RecursiveBoxJenkins(**ARX, memory_time=5.0, init_window=15.0),
    "instruments": RecursiveIV(**ARX, memory_time=5.0, init_window=15.0),
    "bank": DelayBankARX([13, 15, 17], **ONE, memory_time=5.0, init_window=15.0),
    "fir": RecursiveFIR(25, **ARX, memory_time=5.0),
    "ukf": OperatorKalman(**ONE, init_window=15.0),
    "ekf": OperatorKalman(**ONE, method="ekf", init_window=15.0),
    "dual ekf": OperatorKalman(**ONE, method="dual_ekf", init_window=15.0),
}
OFFLINE = {
    "lpv": LPVARX(**ARX, scheduling="time"),
    "windows": WindowedOperator(**ONE, window=10.0, step=5.0),
    "sigmoid": SigmoidOperator(**ONE),
    "wavelets": WaveletOperator(**ONE),
}
METHODS = CAUSAL | OFFLINE
every = pytest.mark.parametrize("name", METHODS)
causal = pytest.mark.parametrize("name", CAUSAL)


@pytest.fixture(autouse=True)
def needs_wavelets(request):
    if "wavelets" in str(request.node.callspec.params.get("name")):
        pytest.importorskip("pywt")


@cache
def recorded():
    return make_tracking_runs(
        "C1",
        n_runs=3,
        remnant_intensity=0.1,
        sampling_rate=RATE,
        duration=40.96,
        channels=["e", "f_t"],
        run_in=20.0,
        random_state=11,
    )


@pytest.fixture
def runs():
    return recorded()


@cache
def fitted(name, run=None):
    """A method on all runs, or on one."""
    X, y = recorded()
    return clone(METHODS[name]).fit(*((X, y) if run is None else (X.loc[[run]], y.loc[[run]])))


def found(model):
    """The estimates, whatever their form."""
    if hasattr(model, "coef_path_"):
        return model.coef_path_
    return operator_parameters(model)[["K_e", "K_edot", "tau_e", "omega_nm", "zeta_nm"]].to_numpy()


@every
def test_rows_pictures_and_copies(name, runs):
    X, y = runs
    model = fitted(name)
    simulated = model.predict(X)
    assert simulated.shape == y.shape
    assert np.isfinite(simulated).all()
    assert model.score(X, y) > 60
    assert "VAF" in str(compare(model, X, y))
    assert str(model.summary(X, y))
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(model)).predict(X), simulated)


@every
def test_the_order_of_runs_does_not_matter(name, runs):
    X, y = runs
    X, y = select_runs(X, y, first=2)
    order = [1, 0]
    swapped = X.loc[order], y.loc[order]
    one, other = (clone(METHODS[name]).fit(*data) for data in ((X, y), swapped))
    a, b = found(one), found(other)
    known = np.isfinite(a).all(axis=1)
    assert (known == np.isfinite(b).all(axis=1)).all()
    # Updates of one instant are taken in turn, and starts are added up in the order of runs.
    np.testing.assert_allclose(b[known], a[known], rtol=2e-3, atol=2e-3 * np.abs(a[known]).max())


@every
def test_a_run_alone_is_predicted_as_among_others(name, runs):
    X, _ = runs
    model = fitted(name)
    together = pd.Series(model.predict(X), index=X.index)
    np.testing.assert_allclose(model.predict(X.loc[[1]]), together.loc[[1]], rtol=1e-9, atol=1e-12)


@every
def test_arrays_are_taken_as_tables_are(name, runs):
    X, y = runs
    channels = {"inputs": [0], "dt": 1 / RATE}
    model = METHODS[name]
    if name == "instruments":
        channels["instruments"] = [1]
    if name == "wavelets":
        channels["roles"] = {1: "f_t"}
    one = fitted(name, run=0)
    other = clone(model).set_params(**channels).fit(X.loc[0].to_numpy(), y.loc[0].to_numpy())
    np.testing.assert_allclose(found(other), found(one), rtol=1e-9, atol=1e-12)


@every
def test_missing_rows_and_gaps_hardly_matter(name, runs):
    X, y = runs[0].copy(), runs[1].copy()
    whole = fitted(name)
    y.iloc[900:920] = np.nan
    X.iloc[1400:1405, 0] = np.nan
    kept = np.ones(len(y), dtype=bool)
    kept[2900:2960] = False  # a gap in the second run
    holed = clone(METHODS[name]).fit(X[kept], y[kept])
    estimates = found(holed)
    assert np.isfinite(estimates).mean() > 0.8
    assert np.isfinite(holed.predict(X[kept])).all()
    assert holed.score(X, y) == pytest.approx(whole.score(X, y), abs=6)


@causal
def test_a_pause_is_survived(name, runs):
    X, y = runs
    rest = np.zeros((16_000, 2))
    A = np.concatenate([X.loc[0].to_numpy(), rest, X.loc[1].to_numpy()])
    u = np.concatenate([y.loc[0].to_numpy(), rest[:, 0], y.loc[1].to_numpy()])
    channels = {"inputs": [0], "dt": 1 / RATE}
    if name == "instruments":
        channels["instruments"] = [1]
    model = clone(METHODS[name]).set_params(**channels)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        model.fit(A, u)
    estimates = found(model)
    assert np.isfinite(estimates[: len(X.loc[0])]).mean() > 0.8
    assert np.isfinite(estimates[-500:]).all()
    before, after = estimates[len(X.loc[0]) - 1], estimates[-1]
    assert np.abs(after).max() < 10 * np.abs(before).max()


@causal
def test_streams_do_not_depend_on_how_they_are_cut(name, runs):
    X, y = runs
    A, u = X.loc[0].to_numpy(), y.loc[0].to_numpy()
    channels = {"inputs": [0], "dt": 1 / RATE}
    if name == "instruments":
        channels["instruments"] = [1]
    model = METHODS[name]
    ends = []
    for cuts in ([], [1, 2, 800, 801, 1500], list(range(100, 2000, 37))):
        stream = clone(model).set_params(**channels)
        for part in np.split(np.arange(u.size), cuts):
            stream.partial_fit(A[part], u[part])
        last = stream.coef_ if hasattr(stream, "coef_") else stream.parameters_["value"].to_numpy()
        ends.append(last)
    for end in ends[1:]:
        np.testing.assert_array_equal(end, ends[0])


@causal
def test_a_stream_goes_on_after_a_fit(name, runs):
    X, y = runs
    first, second = X.index.get_level_values("time") < 30, X.index.get_level_values("run") == 0
    early, late = first & second, ~first & second
    model = clone(METHODS[name]).fit(X[early], y[early])
    model.partial_fit(X[late], y[late])
    whole = fitted(name, run=0)
    last = whole.coef_ if hasattr(whole, "coef_") else whole.parameters_["value"].to_numpy()
    now = model.coef_ if hasattr(model, "coef_") else model.parameters_["value"].to_numpy()
    np.testing.assert_array_equal(now, last)


@every
def test_what_is_decimated_is_followed(name, runs):
    X, y = runs
    model = clone(METHODS[name])
    if "nk" in model.get_params() and name != "bank":
        model.set_params(nk=8)
    if name == "bank":
        model.set_params(nk=[7, 8, 9])
    chain = make_pipeline(Decimator(2), model).fit(X, y)
    assert chain.predict(X).shape == y.shape
    assert chain.score(X, y) > 60


@pytest.mark.parametrize("name", OFFLINE)
def test_offline_methods_do_not_stream(name):
    assert not hasattr(METHODS[name], "partial_fit")
