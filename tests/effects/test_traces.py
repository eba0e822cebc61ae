"""Stops and levels that the output itself shows."""

from dataclasses import replace

import numpy as np
import pytest

from skhoid.effects.record import find_stop
from skhoid.search.judges import find_traces
from skhoid.testing import synthetic_record


def make_record(y):
    known = np.ones((y.size, 1), dtype=bool)
    return replace(synthetic_record(), y=y[:, None], known=known, remembered={})


def smooth(seed, n=4000):
    return np.convolve(np.random.default_rng(seed).standard_normal(n), np.ones(30), "same")


@pytest.mark.parametrize("seed", range(2))
def test_stops_to_either_side(seed):
    y = smooth(seed)
    y = np.clip(y / y.std(), -1.2, 1.2)
    stop = find_stop(make_record(y))
    assert stop.share == pytest.approx(np.mean(np.abs(y) == 1.2), abs=0.002)
    assert stop.where == "±1.2"


@pytest.mark.parametrize("seed", range(2))
def test_samples_beyond_on_the_other_side_are_not_at_the_stop(seed):
    """A stop at 144 that 3 % of the samples reach, of an output that goes down to -1000."""
    y = smooth(seed)
    y = 300 * y / y.std() - 600
    y = np.minimum(y, np.quantile(y, 0.97))
    y = y - y.max() + 144.0
    stop = find_stop(make_record(y))
    assert stop.share == pytest.approx(0.03, abs=0.002)
    assert stop.where == "144"
    assert find_traces(make_record(y))["saturation"][0] == "3 % of the samples lie at 144"


def test_a_stop_that_is_hardly_reached_is_none():
    y = smooth(0)
    y = np.minimum(y, np.quantile(y, 0.989))
    assert find_stop(make_record(y - y.max() + 1e-3 * y.std())) is None


def test_the_top_of_a_wave_is_no_stop():
    """A sine spends 1.2 % of its time within a thousandth of either end, and more nearby."""
    t = np.arange(6000) * 0.01
    assert find_stop(make_record(np.sin(t))) is None
    assert find_stop(make_record(np.round(np.sin(t), 3))) is None
    assert find_stop(make_record(3 + np.sin(t))) is None
