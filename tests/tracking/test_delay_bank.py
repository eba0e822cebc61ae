"""DelayBankARX: its recursions are those of RecursiveARX, its probabilities those of a twin."""

from itertools import pairwise

import numpy as np
import pytest
from sklearn.exceptions import NotFittedError
from support import delay_bank_twin as twin
from support.delay_bank_twin import jumping_run
from support.synthetic import DT, arx_runs

from skhoid import RecursiveARX, ShortRunError, make_tracking_runs
from skhoid._kernels import delay_bank as kernels
from skhoid.effects import TimeVaryingDelay
from skhoid.tracking.delay_bank import (
    AHEAD,
    STAY_TIME,
    TEMPER,
    VARIANCE_MEMORY,
    DelayBankARX,
)

# Each number of parameters compiles a bank of its own, for long.
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::skhoid.MissingDataWarning")]

THETA0 = [-1.7, 0.75, 0.03, -0.02]
GIVEN = {"dt": DT, "memory_time": 1.0}
DELAYS = [3, 5, 8, 12]
RECURSION = (
    "coef_path_",
    "one_step_errors_",
    "covariance_path_",
    "coef_",
    "covariance_",
    "noise_variance_",
    "n_updates_",
    "n_held_",
    "n_rows_missing_",
    "initial_coef_",
    "initial_covariance_",
)


class Bank(DelayBankARX):
    """Begins from given parameters."""

    init, p0 = THETA0, 10.0


def bank(nk=DELAYS, kind=Bank, **params):
    return kind(nk, **{**GIVEN, **params})


def recursion(nk):
    return RecursiveARX(nk=nk, init=THETA0, p0=10.0, **GIVEN)


def with_gaps(n_runs=3, seed=0):
    """Runs of different length, with NaN in both channels, and a gap."""
    X, y = arx_runs(lengths=[400, 300, 350][:n_runs], nk=5, seed=seed, smooth=2)
    X, y = X[["e"]].copy(), y.copy()
    y.iloc[50:53] = np.nan
    X.iloc[120:122] = np.nan
    keep = np.ones(len(y), dtype=bool)
    keep[200:230] = False
    return X[keep], y[keep]


# One delay: the recursion, to the bit


@pytest.mark.parametrize(
    "params",
    [
        {},
        {"memory_time": 0.6},
    ],
)
@pytest.mark.parametrize("n_runs", [1, 3])
def test_one_delay_is_the_recursion(params, n_runs):
    X, y = with_gaps(n_runs)
    params = {"store_covariance": True, "init_window": 2.0, **params}
    one = DelayBankARX(5, **params).fit(X, y)
    other = RecursiveARX(nk=5, **params).fit(X, y)
    for name in RECURSION:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    np.testing.assert_array_equal(one.predict(X), other.predict(X))
    np.testing.assert_array_equal(one.predict_ahead(X, y, 7), other.predict_ahead(X, y, 7))
    assert one.score(X, y) == other.score(X, y)
    assert (one.probabilities_ == 1).all()
    assert (one.nk_path_ == 5).all()


def test_one_delay_in_a_stream():
    X, y = with_gaps(1)
    one, other = bank(5), recursion(5)
    for begin, end in pairwise([0, 1, 130, 131, 300, len(y)]):
        one.partial_fit(X[begin:end], y[begin:end])
        other.partial_fit(X[begin:end], y[begin:end])
        for name in ("coef_", "covariance_", "noise_variance_", "n_updates_"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def candidate_paths(X, y):
    """RecursiveARX of each candidate, begun so late that all have the same first update."""
    first = max(DELAYS) + 1
    models = []
    for nk in DELAYS:
        lags = recursion(nk)
        skip = first - (nk + 1)
        models.append(lags.fit(X[skip:], y[skip:]))
    paths = [
        np.vstack([np.tile(m.initial_coef_, (len(y) - len(m.coef_path_), 1)), m.coef_path_])
        for m in models
    ]
    return models, paths


# Probabilities and paths


def test_probabilities_are_those_of_the_twin():
    X, y = arx_runs(1, 400, nk=5, smooth=2, noise=0.5)
    model = bank().fit(X[["e"]], y)
    _, paths = candidate_paths(X[["e"]], y)
    steps = round(AHEAD / DT)
    expected = twin.probabilities(
        paths,
        [(X["e"].to_numpy(), y.to_numpy())],
        DELAYS,
        steps=steps,
        leave=DT / STAY_TIME,
        power=min(1.0, TEMPER / steps),
        memory=VARIANCE_MEMORY / DT,
        settled=kernels.SETTLED,
    )
    np.testing.assert_allclose(model.probabilities_, expected, rtol=1e-7, atol=1e-12)
    assert expected[-1].max() > 0.5  # not what it began with
    delays = np.array(DELAYS) * DT
    np.testing.assert_allclose(model.delay_path_, expected @ delays, rtol=1e-7)
    sd = np.sqrt(expected @ delays**2 - (expected @ delays) ** 2)
    np.testing.assert_allclose(model.delay_sd_path_, sd, rtol=1e-5, atol=1e-9)
    np.testing.assert_array_equal(model.nk_path_, np.array(DELAYS)[expected.argmax(axis=1)])


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("leave", [0.02, 0.4])
def test_viterbi_is_the_best_of_all_paths(seed, leave):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 5))
    fits = -rng.exponential(2.0, (6, n))
    value, path = twin.best_path(fits, leave)
    found = kernels.most_probable(fits, leave)
    assert twin.value_of(found, fits, leave) == pytest.approx(value, abs=1e-12)
    np.testing.assert_array_equal(found[1:], path[1:])


# What it finds


@pytest.mark.parametrize("path", ["filtered", "viterbi"])
def test_a_jump_of_the_delay_is_found(path):
    settled = []
    for seed in range(2):
        e, u, nk = jumping_run(seed)
        model = DelayBankARX(range(10, 46), memory_time=2.56, init_window=15, dt=DT, path=path).fit(
            e, u
        )
        right = np.abs(model.nk_path_ - nk) <= 1
        assert right[500:1900].all()
        settled.append(np.flatnonzero(~right[2000:])[-1] if (~right[2000:]).any() else 0)
    assert max(settled) < 1200  # errors 0.2 s ahead tell neighbouring delays apart slowly


def test_predictions_follow_delay_and_coefficients():
    e, u, _ = jumping_run(noise=0.0)
    model = DelayBankARX([20, 35], memory_time=0.64, init_window=15, dt=DT, path="viterbi").fit(
        e, u
    )
    simulated = np.zeros(u.size)
    for t in range(u.size):
        a1, a2, b0, b1 = model.coef_path_[t]
        lag = model.nk_path_[t]
        e0, e1 = (e[t - k, 0] if t >= k else 0.0 for k in (lag, lag + 1))
        y1, y2 = (simulated[t - k] if t >= k else 0.0 for k in (1, 2))
        simulated[t] = b0 * e0 + b1 * e1 - a1 * y1 - a2 * y2
    np.testing.assert_allclose(model.predict(e), simulated, atol=1e-9 * np.abs(u).max())
    assert model.score(e, u) > 95
    fixed = RecursiveARX(nk=20, memory_horizon=64, init_window=15, dt=DT).fit(e, u)
    assert model.score(e, u) > fixed.score(e, u)
    ahead = model.predict_ahead(e, u, 1)
    known = model.one_step_errors_[3000:]
    np.testing.assert_allclose((u - ahead)[3000:], known, atol=1e-9 * np.abs(u).max())


def test_in_the_loop_a_change_of_the_delay_is_followed_roughly():
    effect = TimeVaryingDelay(change=0.12, rate=2.0, time=40.0)
    X, y = make_tracking_runs(
        "C2", n_runs=2, remnant_intensity=0.05, effects=[effect], random_state=11
    )
    model = DelayBankARX(range(13, 56, 2), memory_time=10.24).fit(X, y)
    truth = 0.29 + 0.12 / (1 + np.exp(-2 * (model.time_path_ - 40)))
    wrong = (model.delay_path_ - truth)[1000:]
    assert np.sqrt(np.mean(wrong**2)) < 0.025  # measured: 0.013 on average


# Streams


# scikit-learn, and errors


@pytest.mark.parametrize(
    ("params", "message"),
    [
        ({"nk": []}, "nk is empty"),
        ({"nk": [3, 3]}, "twice"),
        ({"nk": "often"}, "Each delay in nk must be a whole number; got 'often'"),
        ({"path": "smoothed"}, "path"),
        ({"memory_time": 0.001}, "longer than one sample"),
    ],
)
def test_options_without_sense(params, message):
    X, y = arx_runs(1, 100, nk=5)
    with pytest.raises(ValueError, match=message):
        bank(**params).fit(X[["e"]], y)


def test_short_runs_and_streams_that_cannot_be():
    X, y = arx_runs(1, 100, nk=5)
    X = X[["e"]]
    with pytest.raises(ShortRunError):
        bank([3, 200]).fit(X, y)
    with pytest.raises(ValueError, match="needs whole runs"):
        bank(path="viterbi").partial_fit(X, y)
    with pytest.raises(NotFittedError, match="no estimate yet"):
        bank(kind=DelayBankARX, init_window=5.0).partial_fit(X, y).predict(X)
