"""The detector of changes, against what can be counted by hand."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import mannwhitneyu

from skhoid.lab.studies.tournament_scores import (
    ALARMS,
    LAST,
    THRESHOLDS,
    alarms,
    detection_table,
    roc_area,
    threshold_of,
)

TIME = np.arange(15.0, 80.0, 0.16)


def test_a_step_is_found_when_the_mean_of_the_last_seconds_says_so():
    """A step of size s in the logarithm: n samples of it among m give a difference of s n / m."""
    size = 0.8
    found = alarms(TIME, np.exp(np.where(TIME >= 40.0, size, 0.0)), (15.0, 30.0))
    assert found["peak"] == pytest.approx(size)
    m = round(LAST / 0.16)
    first = TIME[TIME >= 40.0][0]
    for name, threshold in zip(ALARMS, THRESHOLDS, strict=True):
        if threshold > size:
            assert np.isnan(found[name])
        else:
            n = int(np.ceil(threshold * m / size - 1e-9))
            assert found[name] == pytest.approx(first + 0.16 * (n - 1))


def test_scale_does_not_count_and_missing_estimates_give_no_alarm():
    rng = np.random.default_rng(0)
    K = np.exp(0.1 * rng.standard_normal(TIME.size))
    one, other = alarms(TIME, K, (15.0, 30.0)), alarms(TIME, 7 * K, (15.0, 30.0))
    assert one["peak"] == pytest.approx(other["peak"])
    K[TIME > 31.0] = np.nan
    assert alarms(TIME, K, (15.0, 30.0))["peak"] < 0.3
    assert np.isnan(alarms(TIME, -K, (15.0, 30.0))["peak"])
    assert np.isnan(alarms(TIME, np.full(TIME.size, np.nan), (15.0, 30.0))["alarm_00"])


def test_the_area_is_that_of_mann_and_whitney():
    rng = np.random.default_rng(1)
    changed, constant = rng.normal(1, 1, 40).round(1), rng.normal(0, 1, 30).round(1)
    expected = mannwhitneyu(changed, constant).statistic / (40 * 30)
    assert roc_area(changed, constant) == pytest.approx(expected)
    assert roc_area(np.array([np.nan]), np.array([np.nan])) == 0.5
    assert np.isnan(roc_area(np.array([]), constant))


def test_one_in_ten_is_a_false_alarm():
    peaks = np.linspace(0.01, 1.0, 100)
    at = threshold_of(peaks)
    assert (peaks >= THRESHOLDS[at]).mean() <= 0.1 < (peaks >= THRESHOLDS[at - 1]).mean()
    assert threshold_of(np.full(5, 1e9)) is None
    assert threshold_of(np.array([])) is None


def test_alarms_are_counted():
    """Four changed runs: found after 3 s, too early, missed, found after 5 s."""
    at = 5
    rows = pd.DataFrame(
        {
            "method": "m",
            "kind": ["changing"] * 4 + ["constant"] * 10,
            "peak": [9.0] * 4 + [THRESHOLDS[at] * 0.99] * 9 + [9.0],
            "change_begins": 38.0,
            "change_time": 40.0,
        }
    )
    for name in ALARMS:
        rows[name] = np.nan
    rows.loc[:3, ALARMS[at]] = [43.0, 30.0, np.nan, 45.0]
    rows["P"] = 0.15
    (found,) = detection_table(rows, ["P"]).to_dict("records")
    assert found["threshold"] == pytest.approx(THRESHOLDS[at])
    assert (found["found"], found["too_early"], found["missed"]) == (0.5, 0.25, 0.25)
    assert found["delay"] == 4.0
    assert (found["n_changed"], found["n_constant"]) == (4, 10)
    assert detection_table(rows[rows["kind"] == "changing"], ["P"]).empty
