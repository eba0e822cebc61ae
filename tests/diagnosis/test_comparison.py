"""``compare`` against plain twins, under changes that must not matter, and at its edges."""

import re

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.signal import lfilter
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.ensemble import HistGradientBoostingRegressor
from sklearn.linear_model import LinearRegression
from sklearn.model_selection import GridSearchCV, LeaveOneGroupOut
from sklearn.pipeline import make_pipeline
from support.hidden_effects import Effects, LinearTruth, Oracle, simulate_runs
from support.synthetic import with_levels

from skhoid import (
    ARXRegressor,
    Decimator,
    DelayShift,
    RecursiveARX,
    RunInTrimmer,
    VAFScorer,
    compare,
    make_tracking_runs,
    vaf_score,
)
from skhoid.diagnosis.breaks import N_DRAWS, largest_break, tail_probability
from skhoid.diagnosis.ceiling import coherent_part
from skhoid.diagnosis.levels import held_levels
from skhoid.diagnosis.noise_density import noise_density
from skhoid.diagnosis.run_signals import excited_lines, read_signals
from skhoid.diagnosis.tests_table import of_one, of_several

COARSE = {"sampling_rate": 25.0, "oversampling": 4}
DT = 0.04
NK = 8  # tau_e and the ZOH sample
SEED = 1


class Gives(RegressorMixin, BaseEstimator):
    """Predicts what a function makes of X."""

    def __init__(self, function=None):
        self.function = function

    def __repr__(self):
        return "Gives()"

    def __sklearn_is_fitted__(self):
        return True

    def fit(self, X, y=None):
        return self

    def predict(self, X):
        return np.asarray(self.function(X), dtype=float)


def runs(n_runs=3, condition="C1", *, seed=SEED, **options):
    return simulate_runs(condition, n_runs, seed=seed, **COARSE, **options)


@pytest.fixture(scope="module")
def simulated():
    return runs()


@pytest.fixture(scope="module")
def arx():
    X, y, _ = runs(2, seed=100, first_run=11)
    return ARXRegressor(nk=NK).fit(X, y)


@pytest.fixture(scope="module")
def of_arx(arx, simulated):
    X, y, _ = simulated
    return compare(arx, X, y, run_in=0)


def vaf(measured, predicted):
    return 100 * (1 - np.sum((measured - predicted) ** 2) / np.sum(measured**2))


def names(comparison):
    return [finding.name for finding in comparison.findings]


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


def test_a_model_that_predicts_no_step_ahead_has_no_such_score(simulated):
    X, y, truth = simulated
    comparison = compare(Oracle(truth.u_without_remnant), X, y)
    assert np.isnan(comparison.one_step_vaf)
    assert "VAF, one step ahead    not available" in comparison.summary()


def test_run_in_leaves_rows_out(arx, simulated):
    X, y, _ = simulated
    comparison = compare(arx, X, y, run_in=5.0)
    assert_allclose(comparison.vaf, vaf_score(y, arx.predict(X), run_in=5.0), rtol=1e-12)
    late = y.index.get_level_values("time") >= 5.0
    assert_array_equal(comparison.traces["scored"], late)


def test_without_run_in_the_settling_rows_are_left_out_and_said(arx, simulated):
    X, y, _ = simulated
    comparison = compare(arx, X, y)
    scored = comparison.traces["scored"].to_numpy()
    assert 0 < np.sum(~scored) < 3 * 10.0 / DT
    assert_allclose(comparison.vaf, vaf(y[scored], arx.predict(X)[scored]), rtol=1e-12)
    assert "settles" in " ".join(comparison.notes)
    assert comparison.notes[0] in comparison.summary()


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


def test_overfit_is_said(simulated):
    X, y, truth = simulated
    known = pd.concat([truth.linear_response, 0.98 * runs(2, seed=7, first_run=11)[1]])
    X_fit, y_fit, _ = runs(2, seed=7, first_run=11)
    comparison = compare(LinearTruth(known), X, y, estimation=(X_fit, y_fit))
    assert comparison.overfit is True
    assert "overfit" in names(comparison)


def test_without_estimation_runs_overfit_is_not_known(of_arx):
    assert of_arx.overfit is None
    assert np.isnan(of_arx.overfit_ratio)
    assert np.isnan(of_arx.estimation_vaf)


def test_shares_of_the_windows_add_up(of_arx):
    together = of_arx.by_time[of_arx.by_time["run"] == "all"]
    assert_allclose(together["share"].sum(), 100 - of_arx.vaf, rtol=1e-12)
    for number, own in of_arx.by_time[of_arx.by_time["run"] != "all"].groupby("run"):
        row = of_arx.by_run.set_index("run").loc[number]
        assert_allclose(own["share"].sum(), 100 - row["vaf"], rtol=1e-12)
    assert_array_equal(together["start"][1:], together["stop"][:-1])


def test_a_window_is_scored_by_its_own_rows(of_arx, simulated):
    _, y, _ = simulated
    row = of_arx.by_time[of_arx.by_time["run"] == "2"].iloc[3]
    time = y.index.get_level_values("time")
    own = (time >= row["start"]) & (time < row["stop"]) & (y.index.get_level_values("run") == 2)
    residual = of_arx.traces["residual"][own]
    assert_allclose(row["rmse"], np.sqrt(np.mean(residual**2)), rtol=1e-12)
    assert_allclose(row["vaf"], vaf(y[own], of_arx.traces["predicted"][own]), rtol=1e-12)


@pytest.mark.parametrize("channels", [["e", "x", "f_t"], ["e", "x"], ["e"], []])
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


@pytest.mark.parametrize("n_runs", [2, 3, 6])
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


def test_ceiling_is_that_of_the_simulation():
    X, y, truth = runs(6)
    for model in (Oracle(truth.u_without_remnant), LinearTruth(truth.linear_response, 0.85)):
        comparison = compare(model, X, y)
        assert abs(comparison.noise_ceiling - truth.ceiling) < 1.0
        assert_allclose(
            comparison.explainable_gap, comparison.noise_ceiling - comparison.vaf, atol=1e-9
        )
    assert comparison.explainable_gap > 1.0


def test_no_ceiling_without_repeats_or_periods():
    X, y, truth = runs(1, multiples=np.geomspace(2.3, 300.7, 10))
    comparison = compare(Oracle(truth.u_without_remnant), X, y)
    assert comparison.ceiling_route == "none"
    assert np.isnan(comparison.noise_ceiling)
    assert np.isnan(comparison.explainable_gap)
    assert "the only run has a target that is not periodic" in comparison.summary()
    assert "no ceiling" in names(comparison)


def test_targets_of_their_own_are_groups_of_their_own():
    X, y, truth = runs(5, targets=(0, 1, 0, 1, 2))
    comparison = compare(Oracle(truth.u_without_remnant), X, y)
    assert comparison.by_run["target"].tolist() == [0, 1, 0, 1, 2]
    assert "one target" not in names(comparison)


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


def test_p_of_the_largest_break_is_uniform_without_a_break():
    rng = np.random.default_rng(6)
    information = np.ones((30, 1, 1))
    p = [largest_break(rng.standard_normal((30, 1)), information).p for _ in range(40)]
    assert 0.3 < np.mean(p) < 0.7
    assert np.sum(np.array(p) < 0.05) <= 6


def test_tail_goes_on_beyond_the_draws():
    draws = np.random.default_rng(7).exponential(size=N_DRAWS)
    assert_allclose(tail_probability(12.0, draws), np.exp(-12), rtol=2)
    assert_allclose(tail_probability(float(np.median(draws)), draws), 0.5, atol=0.01)


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


@pytest.mark.parametrize("quantum", [0.0, 0.02, 0.3])
def test_free_or_quantised_motion_holds_no_level(quantum):
    x = ornstein(20000)
    x = quantum * np.round(x / quantum) if quantum else x
    assert held_levels(x, np.zeros(x.size, int))[0].size == 0


def test_a_constant_holds_no_level():
    assert held_levels(np.ones(100), np.zeros(100, int))[0].size == 0


def multisine(n, periods, lines=(3, 7, 11, 19, 31)):
    t = np.arange(n) * periods / n
    return sum(np.cos(2 * np.pi * k * t + k) / k for k in lines)


@pytest.mark.parametrize("periods", [1, 2, 3])
def test_lines_of_whole_periods(periods):
    found = excited_lines(multisine(3000, periods) + 5.0)
    assert_array_equal(found, periods * np.array([3, 7, 11, 19, 31]))


@pytest.mark.parametrize("periods", [0.5, 0.9, 1.3, 2.5])
def test_no_lines_in_parts_of_periods(periods):
    assert excited_lines(multisine(3000, periods)) is None


@pytest.mark.parametrize(
    "target", [np.zeros(500), np.full(500, 3.0), ornstein(500), np.linspace(0, 1, 500)]
)
def test_no_lines_in_what_is_not_periodic(target):
    assert excited_lines(target) is None


def test_coherent_part_is_that_of_the_other_runs(simulated):
    X, y, truth = simulated
    signals = read_signals(Oracle(truth.u_without_remnant), X, y)
    (group,) = signals.groups
    e = X["e"].to_numpy().reshape(3, -1)
    assert_allclose(coherent_part(signals, group, e)[1], (e[0] + e[2]) / 2)


def test_coherent_part_of_one_run_is_at_the_lines(simulated):
    X, y, truth = simulated
    X, y = X.loc[[1]], y.loc[[1]]
    signals = read_signals(Oracle(truth.u_without_remnant), X, y)
    (group,) = signals.groups
    e = X[["e"]].to_numpy().T
    spectrum = np.fft.fft(coherent_part(signals, group, e)[0])
    kept = np.union1d(group.lines, y.size - group.lines)
    assert_allclose(spectrum[kept], np.fft.fft(e[0])[kept])
    assert np.abs(np.delete(spectrum, kept)).max() < 1e-9
    without = read_signals(Oracle(truth.u_without_remnant), X[["e"]], y)
    assert coherent_part(without, without.groups[0], e) is None


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


def test_covariance_of_a_pattern_under_noise():
    rng = np.random.default_rng(9)
    n, n_draws = 512, 400
    time = 0.02 * np.arange(n)
    draws = lfilter([1.0], [1, -0.9], rng.standard_normal((n_draws, n + 100)), axis=1)[:, 100:]
    known = [np.ones(n, dtype=bool)] * n_draws
    noise = noise_density(
        list(draws), [time] * n_draws, 0.02, [None] * n_draws, known, n_draws, 0.0
    )
    Z = np.column_stack([np.sin(time * 9), np.sin(time * 9 + 0.4)])
    sampled = np.cov((draws @ Z).T)
    assert_allclose(noise.covariance(Z, time), sampled, rtol=0.25)


def test_p_of_several_and_rate_of_one():
    p = np.array([0.001, 0.02, np.nan, 0.5])
    assert_allclose(of_several(p), 1 - (1 - p) ** 3, rtol=1e-12)
    assert_allclose(of_several(np.array([of_one(0.01, 7)] * 7)), 0.01, rtol=1e-12)
    assert_allclose(of_several(np.array([1e-30, 1e-30])), 2e-30, rtol=1e-12)
    assert of_several(np.array([0.0, 1.0]))[0] == 0
    assert of_several(np.array([])).size == 0


# What must not matter


def points(comparison):
    return [
        comparison.vaf,
        comparison.noise_ceiling,
        *comparison.noise_ceiling_interval,
        comparison.explainable_gap,
    ]


def p_of_tests(comparison, without=()):
    tests = comparison.tests[~comparison.tests["test"].isin(without)]
    return tests.set_index(["test", "signal"])["p"].sort_index()


@pytest.fixture(scope="module")
def of_truth(simulated):
    X, y, truth = simulated
    return compare(LinearTruth(truth.linear_response, 0.9), X, y)


def assert_same(found, expected, without=()):
    assert_allclose(points(found), points(expected), rtol=1e-7, atol=1e-7)
    a, b = p_of_tests(found, without), p_of_tests(expected, without)
    pd.testing.assert_series_equal(a, b, rtol=1e-5, atol=1e-12)


def test_twice_the_same(of_truth, simulated):
    X, y, truth = simulated
    again = compare(LinearTruth(truth.linear_response, 0.9), X, y)
    assert again.summary() == of_truth.summary()
    assert again._repr_html_() == of_truth._repr_html_()
    for table in ("by_run", "by_time", "by_frequency", "by_operating_point", "tests"):
        pd.testing.assert_frame_equal(getattr(again, table), getattr(of_truth, table))


def test_arguments_are_not_changed(simulated):
    X, y, truth = simulated
    X_before, y_before = X.copy(), y.copy()
    compare(Oracle(truth.u_without_remnant), X, y)
    pd.testing.assert_frame_equal(X, X_before)
    pd.testing.assert_series_equal(y, y_before)


def test_order_of_runs(of_truth, simulated):
    X, y, truth = simulated
    order = [3, 1, 2]
    found = compare(
        LinearTruth(truth.linear_response, 0.9),
        pd.concat([X.loc[[k]] for k in order]),
        pd.concat([y.loc[[k]] for k in order]),
    )
    assert_same(found, of_truth, without=("learning",))
    a = found.by_run.set_index("run").sort_index()
    b = of_truth.by_run.set_index("run").sort_index()
    pd.testing.assert_frame_equal(a, b, rtol=1e-7)


@pytest.mark.parametrize("factor", [1e-6, -3.0, 1e6])
def test_unit_of_the_output(of_truth, simulated, factor):
    X, y, truth = simulated
    found = compare(LinearTruth(factor * truth.linear_response, 0.9), X, factor * y)
    assert_same(found, of_truth)
    assert_allclose(found.rmse, abs(factor) * of_truth.rmse)
    columns = ["share", "p", "measured_phase"] if factor > 0 else ["share", "p"]
    for column in columns:
        assert_allclose(found.by_frequency[column], of_truth.by_frequency[column], rtol=1e-6)


@pytest.mark.parametrize("factor", [1e-6, 1e6])
def test_unit_of_the_inputs(of_truth, simulated, factor):
    X, y, truth = simulated
    assert_same(compare(LinearTruth(truth.linear_response, 0.9), factor * X, y), of_truth)


def test_origin_of_time(of_truth, simulated):
    X, y, truth = simulated

    def later(table):
        frame = table.index.to_frame(index=False)
        frame["time"] += 500.0
        return table.set_axis(pd.MultiIndex.from_frame(frame))

    model = LinearTruth(later(truth.linear_response), 0.9)
    found = compare(model, later(X), later(y))
    assert_same(found, of_truth)
    assert_allclose(found.by_time["start"], of_truth.by_time["start"] + 500.0)
    assert_allclose(found.time_frequency.index, of_truth.time_frequency.index + 500.0)
    of_time = ["gain change", "remnant power change", "mean change", "outlier"]
    where = [c.tests.set_index("test").loc[of_time, "where"] for c in (found, of_truth)]
    assert_allclose(where[0], where[1] + 500.0)


def test_arrays(simulated):
    X, y, _ = simulated
    X = X.reset_index(level="run")[["run", "e", "x", "f_t"]].set_axis(X.index)
    table = compare(Gives(lambda rows: 0.3 * rows["e"]), X.drop(columns="run"), y)
    array = compare(
        Gives(lambda rows: 0.3 * rows[:, 1]),
        X.to_numpy(),
        y.to_numpy(),
        run=0,
        dt=DT,
        roles={1: "e", 2: "x", 3: "f_t"},
    )
    # Labels of runs are those of an array of floats there.
    assert_same(array, table, without=("outlying run", "outlier", "lost control"))
    assert_allclose(array.by_time["start"], table.by_time["start"], atol=1e-9)


def test_outer_levels_of_the_index(of_truth, simulated):
    X, y, truth = simulated
    X, y, u = (
        with_levels(table, subject="S1", condition="C1") for table in (X, y, truth.linear_response)
    )
    found = compare(LinearTruth(u, 0.9), X, y)
    assert_allclose(points(found), points(of_truth), rtol=1e-9)
    assert found.by_run["run"].tolist() == ["S1/C1/1", "S1/C1/2", "S1/C1/3"]
    assert found.traces.index.names == ["subject", "condition", "run", "time"]


def test_roles_rename_columns(of_truth, simulated):
    X, y, truth = simulated
    other = X.rename(columns={"e": "error", "x": "plant", "f_t": "target"})
    roles = {"error": "e", "plant": "x", "target": "f_t"}
    model = LinearTruth(truth.linear_response, 0.9)
    assert_same(compare(model, other, y, roles=roles), of_truth)


def test_a_role_may_be_taken_away(arx, simulated):
    X, y, _ = simulated
    assert "x" not in compare(arx, X, y, roles={"x": ""}).traces


def test_target_that_was_not_recorded(of_truth, simulated):
    X, y, truth = simulated
    found = compare(LinearTruth(truth.linear_response, 0.9), X[["e", "x"]], y)
    assert_allclose(points(found), points(of_truth), rtol=1e-6)


@pytest.mark.parametrize(
    "repeats", [None, True, {1: "a", 2: "a", 3: "a"}, ["b", "b", "b"], np.zeros(3, int), (0, 0, 0)]
)
def test_repeats_said_in_other_ways(of_truth, simulated, repeats):
    X, y, truth = simulated
    model = LinearTruth(truth.linear_response, 0.9)
    assert_same(compare(model, X, y, repeats=repeats), of_truth)


@pytest.mark.parametrize(
    ("repeats", "target", "route"),
    [
        (False, [0, 1, 2], "lines"),
        ({1: "a", 2: "a"}, [0, 0, 1], "repeats"),
        (["a", "b", "a"], [0, 1, 0], "repeats"),
    ],
)
def test_repeats_that_split_the_runs(simulated, repeats, target, route):
    X, y, truth = simulated
    comparison = compare(Oracle(truth.u_without_remnant), X, y, repeats=repeats)
    assert comparison.by_run["target"].tolist() == target
    assert comparison.ceiling_route == route


# Models


def lags(X):
    """The error at a few earlier instants of the same run."""
    return np.column_stack(
        [X.groupby(level="run")["e"].shift(k).fillna(0.0) for k in range(6, 20, 2)]
    )


class OnLags(Gives):
    def fit(self, X, y=None):
        self.function.fit(lags(X), y)
        return self

    def predict(self, X):
        return self.function.predict(lags(X))


@pytest.mark.parametrize(
    "model",
    [
        make_pipeline(Decimator(2), ARXRegressor(nk=4)),
        make_pipeline(DelayShift(0.2), ARXRegressor(nk=3)),
        make_pipeline(RunInTrimmer(4.0), ARXRegressor(nk=NK)),
        RecursiveARX(nk=NK),
        LinearRegression(),
        OnLags(LinearRegression()),
        OnLags(HistGradientBoostingRegressor(max_iter=30)),
        GridSearchCV(
            ARXRegressor(), {"nk": [7, 8]}, cv=LeaveOneGroupOut(), scoring=VAFScorer(), refit=True
        ),
    ],
    ids=lambda model: type(model).__name__,
)
def test_models(model, simulated):
    X, y, _ = simulated
    X_fit, y_fit, _ = runs(2, seed=100, first_run=11)
    options = {"groups": X_fit.index.get_level_values("run")} if "cv" in vars(model) else {}
    model.fit(X_fit, y_fit, **options)
    comparison = compare(model, X, y, estimation=(X_fit, y_fit))
    traces = comparison.traces[comparison.traces["scored"]]
    assert_allclose(comparison.vaf, vaf(traces["measured"], traces["predicted"]), rtol=1e-12)
    assert_allclose(comparison.traces["predicted"], model.predict(X))
    assert comparison.vaf < comparison.noise_ceiling + 1
    assert comparison.findings
    assert not re.search(r"\bnan\b", " ".join(map(str, comparison.findings)))
    if isinstance(model, RunInTrimmer):
        late = traces.index.get_level_values("time") >= 4.0
        assert late.all()


# Edges


def cut(table, *lengths):
    return pd.concat([table.loc[[k]].iloc[:n] for k, n in enumerate(lengths, 1)])


def said(comparison):
    """Numbers are finite, or words say why not."""
    text = comparison.summary()
    assert np.isfinite([comparison.vaf, comparison.rmse]).all()
    assert np.isfinite(comparison.by_time[["rmse", "share", "ratio"]]).all(axis=None)
    if comparison.ceiling_route == "none":
        assert comparison.ceiling_note.startswith("none: ")
        assert comparison.ceiling_note in text
    else:
        values = [comparison.noise_ceiling, *comparison.noise_ceiling_interval]
        assert np.isfinite([*values, comparison.explainable_gap]).all()
    rule = comparison.tests["test"] == "lost control"
    tests = comparison.tests[~rule]
    assert tests["p"].between(0, 1).all()
    assert np.isfinite(tests["statistic"].astype(float)).all()
    assert not re.search(r"\bnan\b", " ".join(map(str, comparison.findings)))
    comparison._repr_html_()
    return names(comparison)


@pytest.mark.parametrize("n_runs", [1, 3])
def test_perfect_model(simulated, n_runs):
    X, y, _ = simulated
    X, y = X.loc[[*range(1, n_runs + 1)]], y.loc[[*range(1, n_runs + 1)]]
    comparison = compare(Gives(lambda rows: y.loc[rows.index]), X, y)
    found = said(comparison)
    assert comparison.vaf == 100
    assert_allclose(comparison.noise_ceiling, 100)
    assert not comparison.tests["exceeds"].any()
    assert set(found) <= {"none", "one target"}


@pytest.mark.parametrize("n_runs", [1, 3])
def test_model_that_predicts_nothing(simulated, n_runs):
    X, y, _ = simulated
    X, y = X.loc[[*range(1, n_runs + 1)]], y.loc[[*range(1, n_runs + 1)]]
    comparison = compare(Gives(lambda rows: np.zeros(len(rows))), X, y)
    said(comparison)
    assert comparison.vaf == 0
    assert comparison.explainable_gap > 50


@pytest.fixture(scope="module")
def silent():
    return runs(intensity=0.0)


def test_no_remnant_and_nothing_missing(silent):
    X, y, truth = silent
    comparison = compare(Oracle(truth.u_without_remnant), X, y)
    said(comparison)
    assert_allclose(comparison.noise_ceiling, 100)
    assert not comparison.tests["exceeds"].any()


def test_no_remnant_and_a_wrong_gain(silent):
    X, y, truth = silent
    comparison = compare(LinearTruth(truth.linear_response, 0.9), X, y)
    said(comparison)
    assert_allclose(comparison.noise_ceiling, 100, atol=1e-6)
    assert_allclose(comparison.explainable_gap, 1.0, rtol=0.01)


def test_no_remnant_and_a_dead_zone():
    X, y, truth = runs(intensity=0.0, effects=Effects(dead_zone=0.3))
    comparison = compare(LinearTruth(truth.linear_response), X, y)
    said(comparison)
    assert_allclose(comparison.noise_ceiling, 100, atol=1e-6)


def test_no_remnant_and_a_fitted_model(silent, arx):
    X, y, _ = silent
    said(compare(arx, X, y))


@pytest.mark.parametrize(
    "lengths",
    [(2048,), (2048, 2048), (2048, 1500, 700), (250,), (250, 250, 250), (1000, 75, 1000)],
    ids=str,
)
def test_lengths(simulated, lengths):
    X, y, truth = simulated
    comparison = compare(Oracle(truth.u_without_remnant), cut(X, *lengths), cut(y, *lengths))
    said(comparison)
    assert_allclose(comparison.by_run["duration"], np.array(lengths) * DT)
    assert comparison.by_time["run"].iloc[0] == "all"


@pytest.mark.parametrize("n_runs", [1, 3])
@pytest.mark.parametrize("n_rows", [2, 20, 75])
def test_very_short_runs_are_compared_or_refused_in_words(simulated, n_rows, n_runs):
    X, y, truth = simulated
    X, y = cut(X, *[n_rows] * n_runs), cut(y, *[n_rows] * n_runs)
    try:
        comparison = compare(Oracle(truth.u_without_remnant), X, y)
    except ValueError as error:
        assert "compare" in str(error) or "short" in str(error)  # noqa: PT017
        assert "row" in str(error) or " s" in str(error)  # noqa: PT017
    else:
        said(comparison)


def test_runs_that_overlap_in_part(simulated):
    X, y, truth = simulated
    X, y = (
        pd.concat([t.loc[[1]].iloc[:1300], t.loc[[2]].iloc[600:], t.loc[[3]].iloc[1200:]])
        for t in (X, y)
    )
    said(compare(Oracle(truth.u_without_remnant), X, y))


def test_runs_that_do_not_overlap(simulated):
    X, y, truth = simulated
    X, y = (pd.concat([t.loc[[1]].iloc[:900], t.loc[[2]].iloc[1000:]]) for t in (X, y))
    comparison = compare(Oracle(truth.u_without_remnant), X, y)
    said(comparison)
    assert comparison.ceiling_route == "none"


def test_missing_output(simulated):
    X, y, truth = simulated
    y = y.copy()
    y.iloc[100:150] = np.nan
    comparison = compare(Oracle(truth.u_without_remnant), X, y)
    said(comparison)
    assert "50 rows in which the output is missing are left out" in comparison.notes
    assert comparison.traces["scored"].sum() == y.size - 50
    known = y.notna()
    assert_allclose(comparison.vaf, vaf(y[known], truth.u_without_remnant[known]))


def test_missing_error(simulated):
    X, y, truth = simulated
    X = X.copy()
    X.iloc[1000:1020, 0] = np.nan
    comparison = compare(Oracle(truth.u_without_remnant), X, y)
    assert "missing samples" in said(comparison)
    assert "gapless" in " ".join(comparison.notes)
    assert_allclose(comparison.vaf, vaf(y, truth.u_without_remnant))


def test_gaps_in_time(simulated):
    X, y, truth = simulated
    kept = np.ones(y.size, dtype=bool)
    kept[500:530] = kept[3000:3010] = False
    comparison = compare(Oracle(truth.u_without_remnant), X[kept], y[kept])
    assert "gaps" in said(comparison)


def test_all_runs_but_one_missing(simulated):
    X, y, truth = simulated
    y = y.copy()
    y.loc[[1, 3]] = np.nan
    comparison = compare(Oracle(truth.u_without_remnant), X, y)
    said(comparison)
    assert comparison.by_run["vaf"].notna().tolist() == [False, True, False]
    assert comparison.by_run["target"].tolist() == [-1, 0, -1]
    assert comparison.ceiling_route == "lines"


def test_every_other_row_missing(simulated):
    X, y, truth = simulated
    try:
        comparison = compare(Oracle(truth.u_without_remnant), X, y.where(np.arange(y.size) % 2 > 0))
    except ValueError as error:
        assert "No run has 64 successive rows" in str(error)  # noqa: PT017
    else:
        said(comparison)


@pytest.mark.parametrize("channel", ["e", "f_t"])
def test_a_channel_without_values(simulated, channel):
    X, y, truth = simulated
    try:
        comparison = compare(Oracle(truth.u_without_remnant), X.assign(**{channel: np.nan}), y)
    except ValueError as error:
        assert channel in str(error)  # noqa: PT017
    else:
        said(comparison)


@pytest.mark.parametrize(
    "constant",
    [
        {"f_t": 0.0},
        {"f_t": 3.0},
        {"e": 0.0},
        {"e": 0.0, "x": 0.0, "f_t": 0.0},
    ],
    ids=str,
)
def test_constant_channels(simulated, constant):
    X, y, truth = simulated
    comparison = compare(Oracle(truth.u_without_remnant), X.assign(**constant), y)
    assert "constant channel" in said(comparison)


def test_constant_output(simulated):
    X, y, truth = simulated
    comparison = compare(Oracle(truth.u_without_remnant), X, 0.0 * y + 1.0)
    assert "bias" in said(comparison)


def test_no_roles(simulated):
    X, y, truth = simulated
    X = X.rename(columns={"e": "a", "x": "b", "f_t": "c"})
    comparison = compare(Oracle(truth.u_without_remnant), X, y)
    said(comparison)
    assert "Add a channel f_t (or e and x), or say with repeats=" in comparison.ceiling_note
    assert comparison.correlations.empty
    known = compare(Oracle(truth.u_without_remnant), X, y, repeats=True)
    said(known)
    assert known.ceiling_route == "repeats"


@pytest.mark.parametrize("channels", [["e"], ["x"], ["f_t"], ["e", "x"]], ids=str)
def test_some_roles(simulated, channels):
    X, y, truth = simulated
    said(compare(Oracle(truth.u_without_remnant), X[channels], y))


def test_estimation_by_a_perfect_model(simulated):
    X, y, truth = simulated
    u = truth.u_without_remnant
    comparison = compare(Oracle(u), X, y, estimation=(X, u))
    said(comparison)
    assert comparison.estimation_vaf == 100


# Errors


@pytest.mark.parametrize("value", [2, 0, 0.5, -0.1, np.nan])
def test_false_alarm_is_a_rate(simulated, value):
    X, y, truth = simulated
    with pytest.raises(ValueError, match=r"false_alarm is a rate between 0 and 0\.5; got"):
        compare(Oracle(truth.u_without_remnant), X, y, false_alarm=value)


@pytest.mark.parametrize(
    ("repeats", "message"),
    [
        ({1: "a", 9: "a"}, r"repeats names run 9; the runs are \[1, 2, 3\]"),
        (["a", "a"], "repeats has 2 entries for 3 runs: give one label a run"),
        (3, "repeats"),
        ("all", "repeats"),
    ],
)
def test_repeats_that_cannot_be(simulated, repeats, message):
    X, y, truth = simulated
    with pytest.raises((ValueError, TypeError), match=message):
        compare(Oracle(truth.u_without_remnant), X, y, repeats=repeats)


@pytest.mark.parametrize(
    ("roles", "message"),
    [
        ({"error": "e"}, "roles names 'error', which is not a column of X; the columns are"),
        ({"e": "banana"}, "banana"),
        ({"x": "e"}, "role"),
        (["e", "x"], "roles"),
    ],
)
def test_roles_that_cannot_be(simulated, roles, message):
    X, y, truth = simulated
    with pytest.raises((ValueError, TypeError), match=message):
        compare(Oracle(truth.u_without_remnant), X, y, roles=roles)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda X, y: {"run_in": 100.0}, "a run-in of 100 s leaves nothing of it"),
        (lambda X, y: {"run_in": -1.0}, "run_in"),
        (lambda X, y: {"y": y.iloc[::-1]}, "The row indexes of X and y disagree"),
        (lambda X, y: {"y": y.iloc[:-5]}, "inconsistent numbers of samples"),
        (lambda X, y: {"y": np.nan * y}, "No row is left to score"),
        (lambda X, y: {"y": 0.0 * y}, "VAF is undefined: the measured output is zero"),
        (
            lambda X, y: {"y": y.where(np.arange(y.size) != 5, np.inf)},
            "contains infinity, first in run 1, t = 0.2 s",
        ),
        (lambda X, y: {"X": X.assign(e=X["e"].where(np.arange(y.size) != 5, np.inf))}, "infinity"),
        (lambda X, y: {"X": X.assign(x="a")}, "'x'"),
        (lambda X, y: {"estimation": X}, "estimation"),
        (
            lambda X, y: {"model": Gives(lambda rows: np.zeros(3))},
            "returns 3 values for the 6144 rows",
        ),
        (
            lambda X, y: {"model": Gives(lambda rows: np.full(len(rows), np.nan))},
            "The prediction is NaN in run 1, t = 0 s",
        ),
        (lambda X, y: {"model": ARXRegressor()}, "not fitted"),
    ],
)
def test_what_cannot_be_compared_is_said(simulated, change, message):
    X, y, truth = simulated
    arguments = {"model": Oracle(truth.u_without_remnant), "X": X, "y": y} | change(X, y)
    with pytest.raises((ValueError, TypeError), match=message):
        compare(arguments.pop("model"), arguments.pop("X"), arguments.pop("y"), **arguments)


def test_one_silent_run_of_several(simulated):
    X, y, truth = simulated
    y = y.where(y.index.get_level_values("run") != 2, 0.0)
    try:
        comparison = compare(Oracle(truth.u_without_remnant), X, y)
    except ValueError as error:
        assert "run 2" in str(error)  # noqa: PT017
    else:
        assert np.isnan(comparison.by_run["vaf"][1])


# Findings


def first_three(comparison):
    return {finding.name: finding for finding in comparison.findings[:3]}


def compared(effects, condition="C1", **options):
    X, y, truth = runs(5, condition, effects=effects, **options)
    return compare(LinearTruth(truth.linear_response), X, y)


@pytest.mark.parametrize("condition", ["C1", "C2"])
def test_nothing_is_found_where_nothing_is_missing(condition):
    X, y, truth = runs(5, condition, seed=3)
    comparison = compare(Oracle(truth.u_without_remnant), X, y)
    assert names(comparison) == ["none", "one target"]


def test_dead_zone_is_found():
    found = first_three(compared(Effects(dead_zone=0.3)))["nonlinearity"]
    assert found.title == "The response is weaker at small e than at large"
    assert "dead zone" in found.meaning


@pytest.mark.parametrize(("condition", "level"), [("C1", 0.15), ("C2", 0.35)])
def test_saturation_is_found(condition, level):
    comparison = compared(Effects(saturation=level), condition)
    found = first_three(comparison)
    assert f"-{level:g} and" in found["level"].title
    assert "weaker at large" in found["nonlinearity"].title


@pytest.mark.parametrize(("asymmetry", "side"), [(0.3, "positive"), (-0.3, "negative")])
def test_asymmetry_is_found(asymmetry, side):
    found = first_three(compared(Effects(asymmetry=asymmetry)))["asymmetry"]
    assert f"to {side}" in found.title


def test_bias_is_found():
    comparison = compared(Effects(bias=0.05))
    assert names(comparison)[0] == "bias"
    size = comparison.tests.set_index("test").loc["bias", "size"]
    assert abs(size - 0.05) < 0.005


@pytest.mark.parametrize("factor", [0.7, 1.3])
def test_gain_step_is_found_and_placed(factor):
    comparison = compared(Effects(gain_step=(41.0, factor)))
    found = first_three(comparison)["gain change"]
    test = comparison.tests.set_index("test").loc["gain change"]
    assert abs(test["where"] - 41.0) < 2.0
    assert abs(test["size"] - (factor - 1)) < 0.12
    assert ("grows" if factor > 1 else "falls") in found.title


@pytest.mark.parametrize(("nk", "missing"), [(3, 0.20), (5, 0.12), (6, 0.08)])
def test_wrong_delay_is_found_with_its_size(simulated, nk, missing):
    X, y, _ = simulated
    X_fit, y_fit, _ = runs(3, seed=100, first_run=11)
    comparison = compare(ARXRegressor(nk=nk).fit(X_fit, y_fit), X, y)
    assert "later" in first_three(comparison)["delay"].title
    test = comparison.tests.set_index("test").loc["delay"]
    assert abs(test["size"] - missing) < 0.02


@pytest.mark.parametrize("shift", [-3, -2, 3])
def test_shifted_response_is_found_with_its_size(simulated, shift):
    X, y, truth = simulated
    u = truth.linear_response.groupby(level="run").shift(-shift).fillna(0.0)
    comparison = compare(LinearTruth(u), X, y)
    assert ("later" if shift > 0 else "earlier") in first_three(comparison)["delay"].title
    test = comparison.tests.set_index("test").loc["delay"]
    assert abs(test["size"] - shift * DT) < 0.02


def test_feedforward_is_found():
    found = first_three(compared(Effects(feedforward=(0.05, 0.1))))["cross-correlation"]
    assert "follows f_t" in found.title
    assert "pursuit" in found.meaning


def test_outlying_run_is_found():
    X, y, truth = runs(5)
    other = y.index.get_level_values("run") == 2
    comparison = compare(Oracle(truth.u_without_remnant), X, y + np.where(other, truth.n, 0.0))
    assert "Run 2" in first_three(comparison)["outlying run"].title
    assert comparison.by_run["exceeds"].tolist() == [False, True, False, False, False]


def test_lost_control_is_found(simulated):
    X, y, truth = simulated
    X = X.copy()
    X.iloc[3000:3150, 0] *= 8  # of run 2, from 38.08 s on
    X["x"] = X["f_t"] - X["e"]
    comparison = compare(Oracle(truth.u_without_remnant), X, y)
    assert "In run 2" in first_three(comparison)["lost control"].title
    where = comparison.tests.set_index("test").loc["lost control", "where"]
    assert abs(where - 38.08) < 4.0


def test_single_event_is_found(simulated):
    X, y, truth = simulated
    y = y.copy()
    y.iloc[2048 + 750 : 2048 + 753] += 2 * y.std()
    comparison = compare(Oracle(truth.u_without_remnant), X, y)
    assert "A single event in run 2 at 30" in first_three(comparison)["outlier"].title


def test_a_finding_says_all_there_is_to_say():
    comparison = compared(Effects(gain_step=(41.0, 0.6), dead_zone=0.3, bias=0.05))
    assert len(comparison.findings) >= 3
    text = comparison.summary()
    for finding in comparison.findings:
        for part in (finding.title, finding.evidence, finding.meaning, finding.next_step):
            assert part
            assert part in text
    assert repr(comparison).startswith("<Comparison of LinearTruth(): VAF ")


def test_a_mean_that_flatters_is_noted():
    X, y = make_tracking_runs("C1", n_runs=2, remnant_intensity=0.1, random_state=1)
    model = ARXRegressor(nk=29, fit_intercept=True).fit(X, y)
    assert not any("spread" in note for note in compare(model, X, y).notes)
    far = y + 3 * y.std()
    notes = compare(ARXRegressor(nk=29, fit_intercept=True).fit(X, far), X, far).notes
    assert sum("larger than its spread" in note for note in notes) == 1
