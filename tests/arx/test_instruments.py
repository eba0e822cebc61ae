"""Instrumental variables against the bias that remnant causes in a loop (Fig. 10 of the thesis)."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter
from support import closed_loop as cl

from skhoid import ARXRegressor, RankDeficiencyError, ShortRunError

# facts.json G1.Kn.H1.<state>.P0.15: gain of first-order remnant of intensity 0.15.
GAINS = {"C1": 0.010890880817905154, "C2": 0.02563982010171929}
# facts.json fig10.relative_bias.<state>.H1.P0.15.nk0, and its tolerance for 300 runs.
FIG_10_B0 = {"C1": 9.261785296079944, "C2": 9.509112371150605}


def recording(state, gain, seed, label=1, keep=8192):
    run = cl.simulate(state, remnant_gain=gain, rng=seed).last()
    index = pd.MultiIndex.from_product([[label], np.arange(keep) * 0.01], names=["run", "time"])
    X = pd.DataFrame({"e": run.e[:keep], "x": run.x[:keep], "f_t": run.f_t[:keep]}, index=index)
    return X, pd.Series(run.u[:keep], index=index, name="u")


def relative_errors(state, seeds, **options):
    truth = np.array(cl.ZOH_100HZ[state])
    errors, stated = [], []
    for seed in seeds:
        model = ARXRegressor(nk=29, **options).fit(*recording(state, GAINS[state], seed))
        errors.append((model.coef_ - truth) / np.abs(truth))
        stated.append(model.standard_errors_ / np.abs(truth))
    return np.array(errors), np.array(stated)


@pytest.mark.slow
@pytest.mark.parametrize("state", ["C1", "C2"])
def test_bias_of_fig_10_falls(state):
    seeds = range(200, 204)
    ols, _ = relative_errors(state, seeds)
    iv, _ = relative_errors(state, seeds, method="iv")
    # One run scatters by 0.35 (OLS) and 0.06 (IV) of b0: 4 sigma of the mean of four.
    assert abs(ols.mean(axis=0)[2] - FIG_10_B0[state]) < 4 * 0.4 / 2
    assert np.abs(iv.mean(axis=0)[2:]).max() < 0.05 + 4 * 0.065 / 2
    assert np.abs(iv.mean(axis=0)[:2]).max() < 0.01 + 4 * 0.008 / 2


@pytest.mark.slow
def test_bias_and_standard_errors_over_fifteen_runs():
    iv, stated = relative_errors("C1", range(300, 315), method="iv", covariance="hac")
    assert np.all(np.abs(iv.mean(axis=0)) < 0.08)
    assert np.all(np.abs(stated.mean(axis=0) / iv.std(axis=0) - 1) < 0.5)


def test_missing_rows_cut_a_run():
    X, y = recording("C1", GAINS["C1"], 3)
    y = y.copy()
    y.iloc[4000:4005] = np.nan
    with pytest.warns(UserWarning, match="5 rows"):
        holed = ARXRegressor(nk=29, method="iv").fit(X, y)
    whole = ARXRegressor(nk=29, method="iv").fit(*recording("C1", GAINS["C1"], 3))
    assert holed.n_rows_missing_ > 0
    np.testing.assert_allclose(holed.coef_, whole.coef_, rtol=0.05)


def test_errors_say_what_to_do():
    X, y = recording("C1", GAINS["C1"], 5)
    with pytest.raises(ValueError, match="needs external signals"):
        ARXRegressor(method="iv").fit(X[["e", "x"]], y)
    with pytest.raises(RankDeficiencyError, match="excite 1 directions"):
        ARXRegressor(nk=29, method="iv").fit(X.assign(f_t=1.0), y)
    with pytest.raises(ShortRunError, match="reach 189 samples"):
        ARXRegressor(nk=29, method="iv").fit(X[:150], y[:150])


OPEN = {
    "white": (2000, [1, -1.73, 0.835], [[0.05, 0.047]], 0.15, ([1], [1]), 0.1),
    "strong": (3000, [1, -1.73, 0.835], [[0.05, 0.047]], 0.5, ([1], [1]), 0.1),
    "minutes": (800, [1, -0.8], [[0.1, 0.1]], 0.2, ([1], [1, -0.5]), 60.0),
    "two inputs": (1000, [1, -1.2, 0.5], [[0.3, 0.2], [0.5, -0.3]], 0.2, ([1], [1, -0.5]), 0.02),
    "two steps": (400, [1, -0.9], [[0.2, 0.1]], 0.1, ([1], [1]), 1.0),
    "short": (200, [1, -0.8], [[0.4, 0.1]], 0.2, ([1], [1]), 0.01),
}


@pytest.mark.parametrize("name", OPEN)
def test_in_an_open_loop_the_input_and_the_simulated_output_are_instruments(name):
    n, A, B, noise, colour, dt = OPEN[name]
    truth, found, said, least = np.r_[A[1:], np.concatenate(B)], [], [], []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        U = lfilter([0.3], [1, -0.7], rng.standard_normal((n, len(B))), axis=0)
        if name == "two steps":
            U = np.where(np.arange(n) < 200, 1.0, -0.5)[:, None] * (np.arange(n) > 20)[:, None]
        y = sum(lfilter([0, *b], A, U[:, i]) for i, b in enumerate(B))
        y = y + noise * y.std() * lfilter(*colour, rng.standard_normal(n))
        model = ARXRegressor(len(A) - 1, 2, 1, dt=dt, method="iv").fit(U, y)
        assert model.instruments_ == model.inputs_
        found.append(model.coef_)
        said.append(model.standard_errors_)
        least.append(ARXRegressor(len(A) - 1, 2, 1, dt=dt).fit(U, y).coef_)
    off = np.abs(np.mean(found, axis=0) - truth)
    assert np.all(off < 4 * np.mean(said, axis=0) / np.sqrt(10))
    assert np.max(np.abs(np.mean(least, axis=0) - truth) / off) > 3


def test_an_input_that_is_named_is_its_own_instrument():
    """Of e, which loops feed back, only the user knows; others add to it."""
    rng = np.random.default_rng(0)
    e, dist = rng.standard_normal((2, 2000))
    y = lfilter([0, 1.0], [1, -0.8], e + dist) + 0.5 * rng.standard_normal(2000)
    index = pd.MultiIndex.from_product([[1], np.arange(2000) * 0.1], names=["run", "time"])
    X = pd.DataFrame({"e": e, "dist": dist}, index=index)
    alone = ARXRegressor(1, 1, 1, inputs=["e"], method="iv", instruments=["e"]).fit(X, y)
    both = ARXRegressor(1, 1, 1, inputs=["e"], method="iv", instruments=["e", "dist"]).fit(X, y)
    assert alone.instruments_ == ["e"]
    assert both.instruments_ == ["e", "dist"]
    for model in (alone, both):
        assert abs(model.coef_[0] + 0.8) < 4 * model.standard_errors_[0]
        assert abs(model.coef_[1] - 1.0) < 4 * model.standard_errors_[1]
    with pytest.raises(ValueError, match="If 'e' is not fed back"):
        ARXRegressor(1, 1, 1, method="iv").fit(X[["e"]], y)


def test_without_poles_instruments_are_the_inputs_themselves():
    rng = np.random.default_rng(0)
    u = rng.standard_normal((500, 1))
    y = lfilter([0, 1.0, 0.5], [1], u[:, 0]) + 0.1 * rng.standard_normal(500)
    model = ARXRegressor(0, 2, 1, dt=0.1, method="iv").fit(u, y)
    assert "right only where nothing feeds the output" in " ".join(model.summary().split())
    assert np.all(np.abs(model.coef_ - [1.0, 0.5]) < 4 * model.standard_errors_)
