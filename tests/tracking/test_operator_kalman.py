"""OperatorKalman: what it finds, and that it survives what recordings and people do to it."""

import re
import warnings

import numpy as np
import pytest

from skhoid import make_tracking_runs, operator_parameters
from skhoid.exceptions import RankDeficiencyError, ShortRunError
from skhoid.tracking.kalman import Noise, cascade, fitted_noise
from skhoid.tracking.operator_kalman import OperatorKalman

METHODS = ["ukf", "ekf", "dual_ekf"]
NAMES = ["K_e", "K_edot", "omega_nm", "zeta_nm", "tau_e"]
TRUE = {"K_e": 0.09, "K_edot": 0.036, "omega_nm": 11.25, "zeta_nm": 0.35, "tau_e": 0.28}


@pytest.fixture(scope="module")
def quiet():
    """Two runs of a constant operator with little remnant."""
    return make_tracking_runs("C1", n_runs=2, remnant_intensity=0.02, random_state=5)


@pytest.fixture(scope="module")
def changing():
    """Two runs of an operator who changes at half time, and the truth."""
    return make_tracking_runs(
        "C3", n_runs=2, remnant_intensity=0.15, random_state=7, return_truth=True
    )


def one(data, run=0, rows=None):
    """Rows of a run as arrays."""
    X, y = data[0].loc[run], data[1].loc[run]
    return X.to_numpy()[:rows].copy(), y.to_numpy()[:rows].copy()


def last(model):
    return model.parameters_["value"][NAMES].to_numpy()


@pytest.mark.parametrize("method", METHODS)
def test_a_constant_operator_is_found_with_honest_errors(quiet, method):
    model = OperatorKalman(method).fit(*quiet)
    path = model.parameters_path_
    late = path.loc[40.0:]
    for name, value in TRUE.items():
        assert abs(late[name].mean() / value - 1) < 0.06, name
    inside = [(abs(late[n] - v) < 3 * late[f"sd_{n}"]).mean() for n, v in TRUE.items()]
    assert np.mean(inside) > 0.5
    assert list(path.columns[:6]) == ["K_e", "T_L", "K_edot", "tau_e", "omega_nm", "zeta_nm"]
    assert path.index.name == "time"
    assert model.score(*quiet) > 90
    assert "Kalman filter" in model.summary()
    assert operator_parameters(model).equals(path)
    assert model.n_clamped_ == dict.fromkeys(model.n_clamped_, 0)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_smoothing_is_surer_and_ends_where_the_filter_does(changing, method):
    X, y, truth = changing
    data = X.loc[[0]], y.loc[[0]]
    options = {"process_noise": 0.1}
    causal = OperatorKalman(method, **options).fit(*data).parameters_path_
    smooth = OperatorKalman(method, smooth=True, **options).fit(*data).parameters_path_
    np.testing.assert_allclose(smooth.iloc[-1], causal.iloc[-1], rtol=1e-12)
    true = truth.parameters["K_edot"].to_numpy()[: len(causal)]
    middle = slice(1000, -500)
    assert (smooth["sd_K_edot"] / smooth["K_edot"])[middle].mean() < 0.9 * (
        causal["sd_K_edot"] / causal["K_edot"]
    )[middle].mean()
    errors = [np.sqrt(np.mean((p["K_edot"] - true)[middle] ** 2)) for p in (smooth, causal)]
    assert errors[0] < errors[1]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("cut", [1, 1000])
def test_a_stream_gives_the_numbers_of_a_fit(quiet, method, cut):
    X, y = one(quiet, rows=3000 if cut > 1 else 2600)
    y[2560] = np.nan
    whole = OperatorKalman(method, dt=0.01).fit(X, y)
    stream = OperatorKalman(method, dt=0.01)
    first = 2400
    stream.partial_fit(X[:first], y[:first])
    assert not hasattr(stream, "parameters_path_")
    for begin in range(first, len(y), cut):
        stream.partial_fit(X[begin : begin + cut], y[begin : begin + cut])
    np.testing.assert_array_equal(last(stream), last(whole))
    np.testing.assert_array_equal(stream.parameters_["sd"], whole.parameters_["sd"])
    assert stream.n_updates_ == whole.n_updates_
    with pytest.raises(AttributeError, match="parameters_path_"):
        _ = stream.parameters_path_


def test_runs_are_lanes_combined_by_their_certainty(quiet):
    X, y = quiet
    start = OperatorKalman().fit(X, y).initial_parameters_
    both = OperatorKalman(init=start).fit(X, y)
    assert both.run_labels_ == [0, 1]
    assert both.one_step_errors_.shape == y.shape
    alone = [OperatorKalman(init=start).fit(X.loc[[run]], y.loc[[run]]) for run in (0, 1)]
    sd = np.array([m.parameters_["sd"][NAMES] for m in alone])
    together = both.parameters_["sd"][NAMES].to_numpy()
    np.testing.assert_allclose(together, 1 / np.sqrt((1 / sd**2).sum(axis=0)), rtol=0.1)


@pytest.mark.slow
def test_a_constant_part_of_the_output_is_told_or_fitted(quiet):
    method = "ekf"
    X, y = one(quiet, rows=6000)
    plain = OperatorKalman(method, dt=0.01).fit(X, y)
    offset = 2.0 * y.std()
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        OperatorKalman(method, dt=0.01).fit(X, y + offset)
    assert any(
        re.search("constant part of .* fit_intercept=True", str(one.message)) for one in told
    )
    model = OperatorKalman(method, dt=0.01, fit_intercept=True).fit(X, y + offset)
    assert plain.intercept_ == 0.0
    assert abs(model.intercept_ - offset) < 0.05 * y.std()
    np.testing.assert_allclose(last(model), last(plain), rtol=0.02)
    left = y + offset - model.predict(X)
    assert left.std() < 1.05 * (y - plain.predict(X)).std()
    assert abs(left.mean()) < 0.05 * y.std()
    stream = OperatorKalman(method, dt=0.01, fit_intercept=True)
    for begin in range(0, 6000, 1000):
        stream.partial_fit(X[begin : begin + 1000], y[begin : begin + 1000] + offset)
    np.testing.assert_allclose(last(stream), last(model), rtol=1e-9)


@pytest.mark.slow
def test_signs_of_gains_are_those_of_the_data(quiet):
    X, y = one(quiet, rows=4000)
    up, down = (OperatorKalman(dt=0.01).fit(X, s * y) for s in (1, -1))
    np.testing.assert_allclose(last(down)[:2], -last(up)[:2], rtol=1e-3)
    assert (down.parameters_["sd"] > 0).all()


def test_the_remnant_is_found():
    rng = np.random.default_rng(0)
    transition, stationary = cascade(2, 0.06, 0.01)
    drive = np.linalg.cholesky(stationary - transition @ stationary @ transition.T)
    state, noise = np.zeros(2), np.empty(12_000)
    for t in range(noise.size):
        state = transition @ state + drive @ rng.standard_normal(2)
        noise[t] = 0.3 * state[1]
    noise += 0.02 * rng.standard_normal(noise.size)
    found = fitted_noise([noise[:6000], noise[6000:]], 0.01, 2)
    assert 0.045 < found.time_constant < 0.085
    assert abs(np.sqrt(found.variance) / 0.3 - 1) < 0.2
    white = fitted_noise([0.1 * rng.standard_normal(6000)], 0.01, 0)
    assert white == Noise(0, 1.0, 0.0, white.white)
    assert abs(white.white / 0.01 - 1) < 0.1


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"process_noise": -1.0}, "process_noise"),
        ({"init": {"K_e": 1.0}}, "init must be 'batch' or a dict"),
        ({"init": {**TRUE, "K_e": 0.0}}, "not zero"),
        ({"method": "kf"}, "method"),
        ({"remnant_order": 7}, "remnant_order"),
    ],
)
def test_options_without_sense_are_refused(quiet, options, match):
    X, y = one(quiet, rows=3000)
    with pytest.raises(ValueError, match=match):
        OperatorKalman(dt=0.01, **options).fit(X, y)


def test_data_that_do_not_suffice_are_refused(quiet):
    X, y = one(quiet, rows=3000)
    with pytest.raises(ShortRunError, match="init_window"):
        OperatorKalman(dt=0.01).fit(X[:60], y[:60])
    with pytest.raises(ShortRunError, match="too few to estimate the remnant"):
        OperatorKalman(dt=0.01, init=TRUE).fit(X[:60], y[:60])
    with pytest.raises(RankDeficiencyError):
        OperatorKalman(dt=0.01).fit(np.zeros_like(X), y)
    with pytest.raises(ValueError, match="one linear input"):
        OperatorKalman(dt=0.01).fit(np.hstack([X, X]), y)
