"""The simulator with hidden effects: against the oracle loop, and each effect for what it is."""

import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone
from support import closed_loop
from support.hidden_effects import (
    PERIOD,
    Effects,
    LinearTruth,
    Oracle,
    gap_sampling_error,
    remnant_psd,
    simulate_runs,
)

from skhoid import Remnant, make_tracking_runs

pytestmark = pytest.mark.slow

REPEATED_LAPSES = Effects(lapses=(3, 1.0), lapses_repeat=True)
BEFORE_THE_STICK = [
    Effects(gain_step=(40.0, 0.7)),
    Effects(gain_sigmoid=(40.0, 0.7, 0.5)),
    Effects(gain_of_run=(1.0, 0.8)),
    Effects(delay_change=(40.0, -0.1)),
    Effects(lapses=(3, 1.0)),
    REPEATED_LAPSES,
    Effects(dead_zone=0.3),
    Effects(asymmetry=0.2),
    Effects(cubic=0.1),
    Effects(feedforward=(0.03, 0.1)),
    Effects(bias=0.02),
    Effects(drift=0.04),
]
EVERY = [
    *BEFORE_THE_STICK,
    Effects(saturation=0.15),
    Effects(rate_limit=0.5),
    Effects(quantum=0.05),
]


def by_run(series):
    return series.to_numpy().reshape(series.index.get_level_values("run").nunique(), -1)


@pytest.mark.parametrize(("state", "order"), [("C1", 1), ("C1", 3), ("C2", 2), ("C2", 4)])
def test_without_effects_it_is_the_oracle_loop(state, order):
    X, y, truth = simulate_runs(state, 2, order=order, seed=3)
    gain = Remnant.from_table(state, 0.15, order).gain
    for run in (1, 2):
        noise = np.random.default_rng([3, run - 1])
        expected = closed_loop.simulate(
            state, remnant_gain=gain, remnant_order=order, rng=noise, periods=2
        ).last()
        for found, name in [(X["e"], "e"), (X["x"], "x"), (X["f_t"], "f_t"), (y, "u")]:
            np.testing.assert_allclose(found.loc[run], getattr(expected, name), atol=1e-11)
        np.testing.assert_allclose(truth.n.loc[run], expected.n, atol=1e-11)


@pytest.mark.parametrize("condition", ["C3", "C4", "C5", "C6"])
def test_conditions_that_vary_are_those_of_the_package(condition):
    X, y, truth = simulate_runs(condition, 2, seed=5)
    noise = [np.random.default_rng([5, i]).standard_normal(len(X)) for i in range(2)]
    expected_X, expected_y, expected = make_tracking_runs(
        condition,
        2,
        remnant_intensity=0.15,
        remnant_gain="table",
        channels=["e", "x", "f_t"],
        run_in=PERIOD,
        noise=np.stack(noise),
        return_truth=True,
    )
    np.testing.assert_allclose(X, expected_X, atol=1e-11)
    np.testing.assert_allclose(y, expected_y, atol=1e-11)
    np.testing.assert_allclose(truth.u_without_remnant, expected.u_without_remnant, atol=1e-11)


def test_a_finer_step_is_the_same_loop():
    """Held noise and forcing functions are delayed by half a step, which is all that changes."""
    coarse, fine = (
        simulate_runs("C1", 1, intensity=0.0, oversampling=factor)[1].to_numpy()
        for factor in (1, 5)
    )
    assert np.sum((coarse - fine) ** 2) < 1e-3 * np.sum(fine**2)


@pytest.mark.parametrize("effects", [Effects(), *EVERY], ids=str)
def test_same_seed_same_runs(effects):
    first, again = (simulate_runs("C1", 2, effects=effects, seed=7) for _ in range(2))
    pd.testing.assert_frame_equal(first[0], again[0])
    pd.testing.assert_series_equal(first[1], again[1])
    other = simulate_runs("C1", 2, effects=effects, seed=8)[1]
    assert not np.allclose(first[1], other)


@pytest.mark.parametrize("effects", EVERY, ids=str)
def test_truth(effects):
    X, y, truth = simulate_runs("C1", 2, effects=effects, seed=1)
    np.testing.assert_allclose(truth.n + truth.u_without_remnant, y, atol=1e-15)
    assert truth.ceiling == pytest.approx(100 * (1 - np.sum(truth.n**2) / np.sum(y**2)))
    exact, linear = Oracle(truth.u_without_remnant), LinearTruth(truth.linear_response)
    last = X.loc[[2]]
    np.testing.assert_array_equal(clone(exact).predict(last), truth.u_without_remnant.loc[[2]])
    np.testing.assert_array_equal(linear.predict(last), truth.linear_response.loc[[2]])
    assert np.mean((exact.predict(X) - linear.predict(X)) ** 2) > 1e-3 * np.var(y)


def test_without_effects_the_linear_operator_is_the_exact_one():
    _, _, truth = simulate_runs("C4", 1)
    pd.testing.assert_series_equal(
        truth.linear_response, truth.u_without_remnant, check_names=False, rtol=0, atol=1e-14
    )


@pytest.mark.parametrize("effects", BEFORE_THE_STICK, ids=str)
def test_effects_leave_the_remnant_as_it_is(effects):
    _, _, truth = simulate_runs("C1", 2, effects=effects, seed=2)
    _, _, plain = simulate_runs("C1", 2, seed=2)
    np.testing.assert_allclose(truth.n, plain.n, atol=1e-14)


def ratio_to_linear(effects, **options):
    """Response over that of the operator without effects, where that is not near zero."""
    X, _, truth = simulate_runs("C1", 2, effects=effects, **options)
    linear = truth.linear_response
    ratio = truth.u_without_remnant / linear.where(linear.abs() > 0.02)
    return X, by_run(ratio)


def test_gain_changes_when_it_says():
    time = np.arange(0, PERIOD, 0.01)
    _, ratio = ratio_to_linear(Effects(gain_step=(40.0, 0.7)))
    # The muscle takes half a second more than the delay.
    np.testing.assert_allclose(ratio[:, time < 40.27][np.isfinite(ratio[:, time < 40.27])], 1.0)
    after = ratio[:, time > 42.5]
    np.testing.assert_allclose(after[np.isfinite(after)], 0.7, rtol=2e-3)
    _, ratio = ratio_to_linear(Effects(gain_of_run=(1.0, 0.8)))
    for row, factor in zip(ratio, (1.0, 0.8), strict=True):
        np.testing.assert_allclose(row[np.isfinite(row)], factor)


def test_delay_changes_when_it_says():
    _, _, truth = simulate_runs("C1", 1, effects=Effects(delay_change=(40.0, -0.1)))
    response, linear = truth.u_without_remnant.to_numpy(), truth.linear_response.to_numpy()
    np.testing.assert_array_equal(response[:4000], linear[:4000])
    np.testing.assert_array_equal(response[4000:-10], linear[4010:])


def test_static_effects_on_the_error():
    """Each against the linear operator driven by the error that the effect makes."""
    for effects, perceived in [
        (Effects(dead_zone=0.3), lambda e: np.sign(e) * np.maximum(np.abs(e) - 0.3, 0)),
        (Effects(asymmetry=0.2), lambda e: e * (1 + 0.2 * np.sign(e))),
        (Effects(cubic=0.1), lambda e: e + 0.1 * e**3),
    ]:
        X, _, truth = simulate_runs("C1", 1, effects=effects)
        a1, a2, b0, b1 = closed_loop.ZOH_100HZ["C1"]
        responses = []
        for signal in (perceived(X["e"].to_numpy()), X["e"].to_numpy()):
            u = np.zeros(signal.size)
            for k in range(30, signal.size):
                u[k] = -a1 * u[k - 1] - a2 * u[k - 2] + b0 * signal[k - 29] + b1 * signal[k - 30]
            responses.append(u[200:])  # it began elsewhere
        for found, expected in zip(
            (truth.u_without_remnant, truth.linear_response), responses, strict=True
        ):
            error = found.to_numpy()[200:] - expected
            # F2.vaf_zoh.C1.d1 is 99.91; corners of the dead zone add a little.
            assert np.sum(error**2) < 2e-3 * np.sum(expected**2)


def test_feedforward_bias_and_drift_are_added():
    """The exact operator less its response to e is the effect, in all runs the same."""
    t = np.arange(0, PERIOD, 0.01)
    for effects, expected in [
        (Effects(bias=0.02), np.full(t.size, 0.02)),
        (Effects(drift=0.04), 0.04 * t / PERIOD),
    ]:
        _, _, truth = simulate_runs("C1", 2, effects=effects)
        added = by_run(truth.u_without_remnant - truth.linear_response)
        np.testing.assert_allclose(added, np.broadcast_to(expected, added.shape), atol=1e-14)
    X, _, truth = simulate_runs("C1", 2, effects=Effects(feedforward=(0.03, 0.1)))
    added = by_run(truth.u_without_remnant - truth.linear_response)
    np.testing.assert_allclose(added[0], added[1], atol=1e-14)
    # 0.03 s e^(-0.1 s) H_nm(s) at the lines of the target, whose samples are held.
    bins = closed_loop.MULTIPLES
    s = 2j * np.pi * bins / PERIOD
    muscle = closed_loop.OMEGA_NM**2 / (
        s**2 + 2 * closed_loop.ZETA_NM * closed_loop.OMEGA_NM * s + closed_loop.OMEGA_NM**2
    )
    hold = (1 - np.exp(-0.01 * s)) / (0.01 * s)
    found = np.fft.rfft(added[0])[bins] / np.fft.rfft(by_run(X["f_t"])[0])[bins]
    np.testing.assert_allclose(found, 0.03 * s * np.exp(-0.1 * s) * muscle * hold, rtol=5e-3)


def test_the_stick():
    _, y, _ = simulate_runs("C1", 2, effects=Effects(saturation=0.15))
    assert np.abs(y).max() == 0.15
    assert np.mean(np.abs(y) == 0.15) > 0.01
    _, y, _ = simulate_runs("C1", 2, effects=Effects(rate_limit=0.5))
    assert np.abs(np.diff(by_run(y))).max() == pytest.approx(0.5 * 0.01)
    _, y, _ = simulate_runs("C1", 2, effects=Effects(quantum=0.05))
    np.testing.assert_allclose(y / 0.05, np.round(y / 0.05), atol=1e-12)


def test_lapses():
    for repeat in (True, False):
        effects = Effects(lapses=(3, 2.0), lapses_repeat=repeat)
        _, _, truth = simulate_runs("C1", 2, effects=effects)
        missed = by_run(np.abs(truth.u_without_remnant) < 0.02 * np.abs(truth.linear_response))
        overlap = np.mean(missed[0] & missed[1]) / np.mean(missed[0])
        assert np.mean(missed[0]) > 0.02
        assert (overlap > 0.5) == repeat


def test_targets_and_disturbance():
    X, _, _ = simulate_runs("C1", 3, targets=(0, 4, 4), disturbance=0.02, first_run=11)
    assert X.index.get_level_values("run").unique().tolist() == [11, 12, 13]
    f_t = by_run(X["f_t"])
    np.testing.assert_array_equal(f_t[1], f_t[2])
    assert np.corrcoef(f_t[0], f_t[1])[0, 1] < 0.8
    assert np.std(f_t[1]) == pytest.approx(np.std(f_t[0]), rel=1e-6)
    assert np.sqrt(np.mean(X["dist"] ** 2)) == pytest.approx(0.02, rel=1e-6)
    assert list(simulate_runs("C1", 1)[0]) == ["e", "x", "f_t"]


@pytest.mark.parametrize(
    ("condition", "order"), [("C1", 1), ("C2", 2), ("C3", 2), ("C4", 3), ("C6", 4)]
)
def test_remnant_has_the_spectrum_stated(condition, order):
    _, _, truth = simulate_runs(condition, 20, order=order)
    omega = np.linspace(0, 3000, 300001)
    variance = np.trapezoid(remnant_psd(truth, omega), omega)
    assert np.var(truth.n) == pytest.approx(variance, rel=0.05)


@pytest.mark.slow
def test_sampling_error_of_the_gap():
    """Against the spread of mean products of the remnant itself, known to 7 % by 100 draws."""
    n_runs, z = 3, []
    for draw in range(100):
        _, y, truth = simulate_runs("C3", n_runs, seed=draw, order=2)
        n = by_run(truth.n)
        product = (np.sum(n.sum(axis=0) ** 2) - np.sum(n**2)) / (n_runs * (n_runs - 1))
        gap = 100 * product / n.shape[1] / np.mean(y**2)
        z.append(gap / gap_sampling_error(truth, y, n_runs))
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1.0, abs=4 * 0.07)
    assert np.mean(z) == pytest.approx(0.0, abs=4 / np.sqrt(100))
