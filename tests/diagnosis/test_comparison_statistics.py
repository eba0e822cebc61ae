"""What ``compare`` claims, counted over simulated loops whose truth is known.

Draws vary condition, order and intensity of the remnant and the number of runs. The small form
runs always and holds each figure to what so few draws allow; the whole form, ``pytest -m whole
tests/diagnosis/test_comparison_statistics.py``, takes 500 draws, and 100 for each power.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from scipy.stats import binom
from support.hidden_effects import (
    Oracle,
    gap_sampling_error,
    simulate_runs,
)

from skhoid import compare

pytestmark = pytest.mark.slow

whole = pytest.mark.whole
CONDITIONS = ("C1", "C2", "C1", "C2", "C3", "C4", "C5", "C6")
INTENSITIES = (0.05, 0.10, 0.15, 0.20, 0.30)
FALSE_ALARM = 0.01
FEW, ALL = 4, 500
STICK = {"C1": 1.0, "C2": 2.4}  # how much more it moves


def sizes(few, many):
    return pytest.mark.parametrize("n_draws", [few, pytest.param(many, marks=whole)])


def at_most(n_draws, probability, *, miss):
    """Largest count that is not surprising; ``miss`` is the chance of a larger one."""
    return int(binom.ppf(1 - miss, n_draws, probability))


def at_least(n_draws, probability, *, miss):
    return int(binom.ppf(miss, n_draws, probability))


def true_ceiling(truth, y, comparison):
    """On the rows that count: a model whose free run starts at rest is given time to settle."""
    scored = comparison.traces["scored"].to_numpy()
    return 100 * (1 - np.sum(truth.n[scored] ** 2) / np.sum(y[scored] ** 2))


# Nothing missing


@dataclass
class Draw:
    condition: str
    n_runs: int
    intensity: float
    gap: float
    ceiling_error: float
    covered: bool
    sampling_error: float
    alarms: dict


def alarms_of(comparison, *, steady):
    """By test and by view whether anything in it exceeds chance.

    In C3-C6 the remnant's power does change: that it is seen is no false alarm.
    """
    found = {}
    tests = comparison.tests[comparison.tests["valid"]]
    for row in tests.itertuples():
        # The signal of these is the label of a run.
        label = "" if row.test in ("outlying run", "lost control") else f" ({row.signal})"
        found[row.test + label] = bool(row.exceeds)
    by_run, by_time = comparison.by_run, comparison.by_time
    by_frequency, by_operating_point = comparison.by_frequency, comparison.by_operating_point
    found["by_run"] = by_run.loc[by_run["data"] == "validation", "exceeds"].any()
    together = by_time["run"].astype(str) == "all"
    found["by_time, all"] = by_time.loc[together, "exceeds"].any()
    found["by_time, runs"] = by_time.loc[~together, "exceeds"].any()
    for kind, rows in by_frequency.groupby("kind"):
        found[f"by_frequency, {kind}"] = rows["exceeds"].any()
    for channel, rows in by_operating_point[by_operating_point["valid"]].groupby("channel"):
        found[f"by_operating_point, {channel}"] = rows["exceeds"].any()
    correlations = comparison.correlations[comparison.correlations["valid"]]
    for signal, rows in correlations.groupby("signal"):
        found[f"correlations, {signal}"] = (rows["correlation"].abs() > rows["band"]).any()
    if not steady:
        for name in ("remnant power change (residual)", "by_time, all", "by_time, runs"):
            del found[name]
    return found


@cache
def null_draws(n_draws):
    return [null_draw(seed) for seed in range(n_draws)]


def null_draw(seed):
    rng = np.random.default_rng([seed, 1])
    condition = CONDITIONS[seed % len(CONDITIONS)]
    order, n_runs = int(rng.integers(1, 4)), int(rng.integers(3, 9))
    intensity = float(rng.choice(INTENSITIES))
    X, y, truth = simulate_runs(condition, n_runs, intensity=intensity, order=order, seed=seed)
    comparison = compare(Oracle(truth.u_without_remnant), X, y)
    ceiling = true_ceiling(truth, y, comparison)
    low, high = comparison.noise_ceiling_interval
    return Draw(
        condition=condition,
        n_runs=n_runs,
        intensity=intensity,
        gap=comparison.explainable_gap,
        ceiling_error=comparison.noise_ceiling - ceiling,
        covered=low <= ceiling <= high,
        sampling_error=gap_sampling_error(truth, y, n_runs),
        alarms=alarms_of(comparison, steady=condition in STICK),
    )


@sizes(FEW, ALL)
def test_gap_where_nothing_is_missing(n_draws):
    """Unthresholded: it is as often below zero as above."""
    draws = null_draws(n_draws)
    gap = np.array([draw.gap for draw in draws])
    z = gap / [draw.sampling_error for draw in draws]
    enough = np.array([draw.n_runs >= 5 and draw.intensity <= 0.15 for draw in draws])
    if n_draws == ALL:
        assert abs(gap.mean()) <= 0.1
        assert gap[enough].std() <= 0.4
        assert np.sqrt(np.mean(z[~enough] ** 2)) <= 1.3
    else:
        assert abs(z.mean()) <= 4 * 1.3 / np.sqrt(n_draws)
        # A chi-square of 4 is more than 5 times that once in 2000.
        assert np.mean(z**2) <= 5.0 * 1.3**2
        assert np.abs(gap[enough]).max(initial=0.0) <= 4 * 0.4


@sizes(FEW, ALL)
def test_interval_covers_the_ceiling(n_draws):
    covered = sum(draw.covered for draw in null_draws(n_draws))
    if n_draws == ALL:
        assert 0.91 <= covered / n_draws <= 0.98  # 189 of the first 200
    else:
        assert covered >= at_least(n_draws, 0.9, miss=1e-3)


@sizes(FEW, ALL)
def test_ceiling_is_that_of_the_simulator(n_draws):
    """C1 and C2; with 3 runs at P_n = 0.3 the sampling error alone is about one point."""
    error = np.array(
        [draw.ceiling_error for draw in null_draws(n_draws) if draw.condition in ("C1", "C2")]
    )
    enough = np.array([draw.n_runs >= 5 for draw in null_draws(n_draws)])
    enough = enough[[draw.condition in ("C1", "C2") for draw in null_draws(n_draws)]]
    assert np.sqrt(np.mean(error**2)) <= 1.0
    assert np.mean(np.abs(error[enough]) <= 1.0) >= 0.98


@sizes(FEW, ALL)
def test_false_alarms(n_draws):
    """Each test, and each view taken as a whole, at the stated rate."""
    draws = null_draws(n_draws)
    names = {name for draw in draws for name in draw.alarms}
    counts = {
        name: [draw.alarms[name] for draw in draws if name in draw.alarms] for name in sorted(names)
    }
    too_many = {
        name: f"{sum(found)} of {len(found)}"
        for name, found in counts.items()
        # Some 30 names: one of them passes a bound of 1e-4 once in 300 times.
        if sum(found) > at_most(len(found), FALSE_ALARM, miss=1e-4)
    }
    assert not too_many


# Something missing that repeats with target or time


# Power
