"""``compare`` against plain twins: scores, ceiling, and the parts that it is made of."""

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.signal import lfilter
from support.comparison import DT, Gives, names, runs, vaf
from support.hidden_effects import Effects, LinearTruth, Oracle

from skhoid import (
    OperatorRegressor,
    RunInTrimmer,
    compare,
    make_tracking_runs,
    vaf_score,
)
from skhoid.diagnosis.ceiling import noise_density
from skhoid.diagnosis.over_amplitude import held_levels
from skhoid.diagnosis.over_time import largest_break
from skhoid.diagnosis.repeats import excited_lines

# Scores


def test_free_run_and_rmse_are_those_of_the_metrics(arx, simulated, of_arx):
    X, y, _ = simulated
    prediction = arx.predict(X)
    assert of_arx.traces["scored"].all()
    assert_allclose(of_arx.vaf, vaf_score(y, prediction), rtol=1e-12)
    assert_allclose(of_arx.rmse, np.sqrt(np.mean((y - prediction) ** 2)), rtol=1e-12)
    assert_allclose(of_arx.by_run["vaf"], vaf_score(y, prediction, average=None), rtol=1e-12)
    of_run = [np.sqrt(np.mean((y - prediction)[run] ** 2)) for run in (1, 2, 3)]
    assert_allclose(of_arx.by_run["rmse"], of_run, rtol=1e-12)
    assert_allclose(of_arx.by_run["duration"], y.size / 3 * DT)
    assert of_arx.by_run["run"].tolist() == ["1", "2", "3"]


def test_one_step(arx, simulated, of_arx):
    X, y, _ = simulated
    ahead = np.asarray(arx.predict_ahead(X, y))
    known = np.isfinite(ahead)
    assert_allclose(of_arx.one_step_vaf, vaf(y[known], ahead[known]), rtol=1e-12)
    first = known & (y.index.get_level_values("run") == 1)
    assert_allclose(of_arx.by_run["one_step_vaf"][0], vaf(y[first], ahead[first]), rtol=1e-12)


def test_overfit_ratio_is_that_of_the_relative_errors(arx, simulated):
    X, y, _ = simulated
    X_fit, y_fit, _ = runs(2, seed=100, first_run=11)
    comparison = compare(arx, X, y, estimation=(X_fit, y_fit), run_in=0)
    on_fit = vaf_score(y_fit, arx.predict(X_fit))
    assert_allclose(comparison.estimation_vaf, on_fit, rtol=1e-12)
    assert_allclose(comparison.overfit_ratio, (100 - comparison.vaf) / (100 - on_fit))
    assert comparison.overfit == (comparison.overfit_ratio > 1.1)
    assert comparison.by_run["data"].tolist() == ["validation"] * 3 + ["estimation"] * 2
    assert comparison.by_run["run"].tolist() == ["1", "2", "3", "11", "12"]


def test_shares_of_the_windows_add_up(of_arx):
    together = of_arx.by_time[of_arx.by_time["run"] == "all"]
    assert_allclose(together["share"].sum(), 100 - of_arx.vaf, rtol=1e-12)
    for number, own in of_arx.by_time[of_arx.by_time["run"] != "all"].groupby("run"):
        row = of_arx.by_run.set_index("run").loc[number]
        assert_allclose(own["share"].sum(), 100 - row["vaf"], rtol=1e-12)
    assert_array_equal(together["start"][1:], together["stop"][:-1])


@pytest.mark.slow
@pytest.mark.parametrize("channels", [["e", "x", "f_t"], []])
def test_shares_of_the_frequencies_add_up_to_the_power_but_for_the_mean(arx, simulated, channels):
    X, y, _ = simulated
    model = Gives(lambda rows: arx.predict(X.loc[rows.index]))
    some = X[channels] if channels else X[["e"]].rename(columns={"e": "other"})
    comparison = compare(model, some, y, run_in=0)
    residual = comparison.traces["residual"].to_numpy().reshape(3, -1)
    of_means = residual.shape[1] * np.sum(residual.mean(axis=1) ** 2)
    expected = 100 * (np.sum(residual**2) - of_means) / np.sum(y**2)
    assert_allclose(comparison.by_frequency["share"].sum(), expected, rtol=1e-9)
    assert comparison.by_frequency["n_bins"].sum() == residual.shape[1] // 2


# Ceiling


@pytest.mark.parametrize("n_runs", [2, 6])
def test_ceiling_of_repeats_against_a_naive_twin(n_runs):
    X, y, _ = runs(n_runs, effects=Effects(gain_step=(41.0, 0.7)))
    rng = np.random.default_rng(0)
    predicted = 0.9 * y + 0.01 * rng.standard_normal(y.size)
    comparison = compare(Gives(lambda rows: predicted.loc[rows.index]), X[["f_t"]], y, run_in=0)
    n_rows = y.size // n_runs
    noise = 0.0
    table = (y - predicted).to_numpy().reshape(n_runs, n_rows)
    for k in range(n_runs):
        mean = sum(table[j] for j in range(n_runs)) / n_runs
        noise += n_runs / (n_runs - 1) * np.sum((table[k] - mean) ** 2)
    power = np.sum(y**2)
    assert comparison.ceiling_route == "repeats"
    assert_allclose(comparison.noise_ceiling, 100 * (1 - noise / power), rtol=1e-10)
    gap = 100 * (np.sum(table**2) - noise) / power
    assert_allclose(comparison.explainable_gap, gap, rtol=1e-8)
    low, high = comparison.noise_ceiling_interval
    assert_allclose((low + high) / 2, comparison.noise_ceiling)
    # The same from products of residuals of different runs.
    products = sum(table[i] @ table[j] for i in range(n_runs) for j in range(n_runs) if i != j)
    assert_allclose(gap, 100 * products / (n_runs - 1) / power, rtol=1e-8)


def test_ceiling_between_the_lines_against_a_naive_twin():
    n, lines = 400, [5, 11, 23, 41]
    t = np.arange(n)
    rng = np.random.default_rng(3)
    target = sum(np.cos(2 * np.pi * k * t / n + k) for k in lines)
    u = target + lfilter([0.3], [1, -0.7], rng.standard_normal(n))
    index = pd.MultiIndex.from_product([[1], 0.02 * t], names=["run", "time"])
    X, y = pd.DataFrame({"f_t": target}, index=index), pd.Series(u, index=index, name="u")
    comparison = compare(Gives(lambda rows: 0.8 * rows["f_t"]), X, y, run_in=0)
    r = u - 0.8 * target
    power = [abs(np.sum(r * np.exp(-2j * np.pi * k * t / n))) ** 2 / n for k in range(n // 2 + 1)]
    noise = power[n // 2]
    for k in range(1, n // 2):
        if k not in lines:
            noise += 2 * power[k]
            continue
        half = max(8, int(0.15 * (k - 1)))
        around = [j for j in range(k - half, k + half + 1) if 1 <= j <= n // 2 and j not in lines]
        noise += 2 * np.mean([power[j] for j in around])
    assert comparison.ceiling_route == "lines"
    assert_allclose(comparison.noise_ceiling, 100 * (1 - noise / np.sum(u**2)), rtol=1e-6)


@pytest.mark.slow
def test_ceiling_is_that_of_the_simulation():
    X, y, truth = runs(6)
    for model in (Oracle(truth.u_without_remnant), LinearTruth(truth.linear_response, 0.85)):
        comparison = compare(model, X, y)
        assert abs(comparison.noise_ceiling - truth.ceiling) < 1.0
        # By chance the estimate is below the VAF; the ceiling never is.
        left = comparison.noise_ceiling - comparison.vaf
        assert_allclose(max(comparison.explainable_gap, 0.0), left, atol=1e-9)
    assert comparison.explainable_gap > 1.0


def test_no_ceiling_without_repeats_or_periods():
    X, y, truth = runs(1, multiples=np.geomspace(2.3, 300.7, 10))
    comparison = compare(Oracle(truth.u_without_remnant), X, y)
    assert comparison.ceiling_route == "none"
    assert np.isnan(comparison.noise_ceiling)
    assert np.isnan(comparison.explainable_gap)
    assert "the only run has a target that is not periodic" in comparison.summary()
    assert "no ceiling" in names(comparison)


# Parts


def test_largest_break_is_the_largest_fall_of_the_squared_error():
    rng = np.random.default_rng(5)
    n_blocks, each, at = 40, 25, 23
    Z = rng.standard_normal((n_blocks * each, 2)) * [1.0, 0.5]
    c = np.where(np.arange(n_blocks)[:, None] <= at, [0.3, -0.2], [0.8, 0.1]).repeat(each, axis=0)
    r = np.sum(Z * c, axis=1) + rng.standard_normal(len(Z))
    blocks = [slice(b * each, (b + 1) * each) for b in range(n_blocks)]
    found = largest_break(
        np.array([Z[b].T @ r[b] for b in blocks]), np.array([Z[b].T @ Z[b] for b in blocks])
    )

    def loss(part):
        fitted = np.linalg.lstsq(Z[part], r[part], rcond=None)[0]
        return np.sum((r[part] - Z[part] @ fitted) ** 2), fitted

    falls = {}
    for k in range(3, n_blocks - 3):
        cut = (k + 1) * each
        falls[k] = loss(slice(None))[0] - loss(slice(cut))[0] - loss(slice(cut, None))[0]
    best = max(falls, key=falls.get)
    assert found.block == best
    assert abs(best - at) <= 2
    assert_allclose(found.statistic, falls[best], rtol=1e-9)
    assert_allclose(found.before, loss(slice((best + 1) * each))[1])
    assert_allclose(found.after, loss(slice((best + 1) * each, None))[1])
    assert found.p < 1e-4


def ornstein(n, seed=0):
    return lfilter([0.1], [1, -0.99], np.random.default_rng(seed).standard_normal(n))


def test_held_levels_are_those_of_the_stops():
    x = ornstein(20000)
    level = np.quantile(x, 0.97)
    clipped = np.clip(x, -np.inf, level)
    levels, shares, p = held_levels(clipped, np.zeros(x.size, int))
    assert_allclose(levels, [level], atol=1e-9)
    assert_allclose(shares, [0.03], atol=0.003)
    assert p < 1e-6


def multisine(n, periods, lines=(3, 7, 11, 19, 31)):
    t = np.arange(n) * periods / n
    return sum(np.cos(2 * np.pi * k * t + k) / k for k in lines)


@pytest.mark.parametrize("periods", [1, 3])
def test_lines_of_whole_periods(periods):
    found = excited_lines(multisine(3000, periods) + 5.0)
    assert_array_equal(found, periods * np.array([3, 7, 11, 19, 31]))


def test_whitened_noise_is_white():
    rng = np.random.default_rng(8)
    n = 8192
    records = [lfilter([1.0], [1, -1.2, 0.5], rng.standard_normal(n + 200))[200:] for _ in range(4)]
    time = 0.02 * np.arange(n)
    known = np.ones(n, dtype=bool)
    noise = noise_density(records, [time] * 4, 0.02, [None] * 4, [known] * 4, 4, 0.0)
    variance = np.mean(np.square(records))
    assert_allclose(np.mean(noise.density), variance, rtol=0.05)
    white = np.column_stack([noise.whitened(r[:, None], time)[:, 0] for r in records])
    assert_allclose(np.mean(white**2), 1.0, rtol=0.05)
    power = np.mean(np.abs(np.fft.rfft(white, axis=0, norm="ortho")) ** 2, axis=1)[1:-1]
    bands = [band.mean() for band in np.array_split(power, 16)]
    assert_allclose(bands, 1.0, atol=0.15)


def test_the_measured_response_stands_where_the_target_has_power():
    """Between two lines of a target there is nothing to measure, though a band may be there."""
    task = {"channels": ["e", "x", "f_t"], "sampling_rate": 50, "random_state": 72}
    X, y, truth = make_tracking_runs("C1", 3, remnant_intensity=0.02, return_truth=True, **task)
    X = RunInTrimmer(run_in=6.0).fit_transform(X)
    table = compare(OperatorRegressor().fit(X, y), X, y).by_frequency
    table = table[table["omega"].between(0.5, 12) & table["measured_gain"].notna()]
    true = np.abs(truth.task.operator.frequency_response(table["omega"].to_numpy()))
    np.testing.assert_allclose(table["measured_gain"], true, rtol=0.08)
