"""Remnant of a known operator is found again: intensity, order, time constant, and their errors."""

import numpy as np
import pandas as pd
import pytest
from sklearn.base import BaseEstimator, RegressorMixin

from skhoid import Multisine, make_tracking_runs
from skhoid.diagnosis.remnant_estimate import remnant_estimate

T_N = 0.06  # s, of the thesis
N_RUNS = 5
ORDERS = (1, 2, 3, 4)


class Oracle(RegressorMixin, BaseEstimator):
    """The exact operator driven by the measured e: its response, row by row."""

    def __init__(self, response=None):
        self.response = response

    def predict(self, X):
        return self.response.loc[X.index].to_numpy()


def simulated(condition, n_runs, order=2, intensity=0.15, *, seed=0, **options):
    options = {"channels": ["e", "f_t"], "remnant_gain": "table"} | options
    X, y, truth = make_tracking_runs(
        condition,
        n_runs,
        remnant_order=order,
        remnant_intensity=intensity,
        random_state=seed,
        return_truth=True,
        **options,
    )
    return X, y, truth


def of_runs(table, first, n_runs=N_RUNS):
    return table.loc[first : first + n_runs - 1]


def intensity_of(y, n):
    """Var(n) / var(u), over all runs."""
    power = [signal.groupby(level="run").var(ddof=0).sum() for signal in (n, y)]
    return power[0] / power[1]


def estimates(condition, order, intensity, n_sets, n_runs=N_RUNS, seed=0):
    """Estimates from sets of runs, and P_n of all runs together."""
    X, y, truth = simulated(condition, n_runs * n_sets, order, intensity, seed=seed)
    oracle = Oracle(truth.u_without_remnant)
    found = [
        remnant_estimate(oracle, of_runs(X, first, n_runs), of_runs(y, first, n_runs))
        for first in range(0, n_runs * n_sets, n_runs)
    ]
    return found, intensity_of(y, truth.remnant)


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, 3])
def test_recovers_the_remnant(order):
    """P_n, m and T_n; 3.5 sigma, of the interval stated."""
    found, truth = estimates("C2", order, 0.3, n_sets=2)
    for remnant in found:
        assert remnant.route == "repeats"
        assert remnant.n_runs == N_RUNS
        sigma = np.log(remnant.interval[1] / remnant.intensity) / 1.96
        assert abs(np.log(remnant.intensity / truth)) < 3.5 * sigma
        assert sigma < 0.08
        assert remnant.order == order
        # The noise is held over the step and the spectrum folded: up to 2 % in T_n.
        sd = remnant.orders["sd_time_constant"][order]
        assert remnant.time_constant == pytest.approx(T_N, abs=3.5 * sd + 0.02 * T_N)


@pytest.mark.whole
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("intensity", [0.05, 0.15])
@pytest.mark.parametrize("condition", ["C2", "C4"])
def test_intervals_hold_what_they_say(condition, intensity, order):
    """92 % (stated: 95 %) of 100 sets of five runs, within 3.3 sigma; the right order in all."""
    found, truth = estimates(condition, order, intensity, n_sets=100, seed=17)
    holds = [remnant.interval[0] < truth < remnant.interval[1] for remnant in found]
    assert 0.83 <= np.mean(holds) <= 1.0
    assert all(remnant.order == order for remnant in found)
    assert np.mean([remnant.p_value < 0.01 for remnant in found]) <= 0.04


def test_first_order_warns():
    for order in (1, 2):
        X, y, truth = simulated("C1", N_RUNS, order)
        remnant = remnant_estimate(Oracle(truth.u_without_remnant), X, y)
        assert bool(remnant.warning) == (order == 1)
        assert ("Warning: " in remnant.summary()) == (order == 1)
        if order == 1:
            assert "(m = 1)" in remnant.warning
            assert "badly biased" in remnant.warning


@pytest.mark.slow
def test_spectrum_is_that_of_the_filter():
    X, y, truth = simulated("C1", 20)
    remnant = remnant_estimate(Oracle(truth.u_without_remnant), X, y)
    table = remnant.spectrum
    spacing = 2 * np.pi / 81.92
    power = truth.remnant.groupby(level="run").var(ddof=0).mean()
    assert table["psd"].sum() * spacing == pytest.approx(power, rel=0.03)
    # One-sided per rad/s: var = (1 / pi) int |H|^2 d omega for white noise of unit intensity.
    gain = truth.task.remnant.gain
    expected = np.abs(truth.task.remnant.frequency_response(table["omega"])) ** 2 / np.pi
    used = table["used"]
    np.testing.assert_allclose(table["fitted"][used], expected[used], rtol=0.1)
    fitted = np.abs(remnant.gain / (remnant.time_constant * 1j * table["omega"] + 1) ** 2) ** 2
    np.testing.assert_allclose(table["fitted"], fitted / np.pi)
    assert remnant.gain_interval[0] < gain < remnant.gain_interval[1]
    assert table["omega"][used].max() <= 60.0


def test_one_run_is_read_between_the_lines():
    X, y, truth = simulated("C1", 1, seed=4)
    remnant = remnant_estimate(Oracle(truth.u_without_remnant), X, y)
    assert remnant.route == "lines"
    assert remnant.n_runs == 1
    assert remnant.interval[0] < intensity_of(y, truth.remnant) < remnant.interval[1]
    omega = Multisine().omega
    assert not np.isclose(remnant.spectrum["omega"].to_numpy()[:, None], omega).any()


def test_without_a_target_the_residual_is_an_upper_bound():
    X, y, truth = simulated("C1", N_RUNS)
    response = 0.8 * truth.u_without_remnant
    remnant = remnant_estimate(Oracle(response), X[["e"]], y)
    assert remnant.route == "none"
    assert remnant.intensity == pytest.approx(intensity_of(y, y - response), rel=1e-9)
    assert remnant.intensity > intensity_of(y, truth.remnant)
    assert "an upper bound" in remnant.summary()
    told = remnant_estimate(Oracle(truth.u_without_remnant), X[["e"]], y, repeats=True)
    assert told.route == "repeats"


def test_without_remnant():
    X, y = make_tracking_runs("C1", 2, channels=["e", "f_t"])
    remnant = remnant_estimate(Oracle(y), X, y)
    assert remnant.intensity == pytest.approx(0, abs=1e-20)
    assert remnant.order is None
    assert np.isnan([remnant.time_constant, remnant.gain, remnant.p_value]).all()
    assert remnant.warning == ""
    assert "too little to fit" in remnant.summary()
    with pytest.raises(ValueError, match="constant in all runs"):
        remnant_estimate(Oracle(0 * y + 1), X, 0 * y + 1)


def same(a, b, factor=1.0):
    assert b.order == a.order
    assert b.intensity == pytest.approx(a.intensity)
    np.testing.assert_allclose(b.interval, a.interval)
    np.testing.assert_allclose(b.time_constant_interval, a.time_constant_interval, rtol=1e-4)
    np.testing.assert_allclose(b.gain_interval, np.multiply(factor, a.gain_interval), rtol=1e-4)


def test_symmetries():
    X, y, truth = simulated("C1", 3)
    oracle = Oracle(truth.u_without_remnant)
    one = remnant_estimate(oracle, X, y)
    order = [2, 0, 1]
    X_other, y_other = (pd.concat({k: t.loc[k] for k in order}, names=["run"]) for t in (X, y))
    same(one, remnant_estimate(oracle, X_other, y_other))
    scaled = remnant_estimate(Oracle(10 * truth.u_without_remnant), X, 10 * y)
    same(one, scaled, factor=10.0)
    renamed = X.rename(columns={"e": "error", "f_t": "target"})
    roles = {"error": "e", "target": "f_t"}
    same(one, remnant_estimate(oracle, renamed, y, roles=roles))
