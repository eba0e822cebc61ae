"""HeldInputs against a reference that fills a copy value by value."""

import numpy as np
import pytest

from skhoid.preprocessing.grid import HeldInputs

STRETCHES = [(0, 4), (4, 5), (5, 30), (30, 60)]


def filled(values, stretches):
    """Each value as it is, or the last one before it in its stretch, or zero."""
    table = values.astype(float)
    for begin, end in stretches:
        for column in table.T:
            last = 0.0
            for row in range(begin, end):
                last = column[row] = last if np.isnan(column[row]) else column[row]
    return table


def missing_rows(values, stretches):
    """Rows that count as missing: not those before the first value, unless none ever comes."""
    found = set()
    for begin, end in stretches:
        part = values[begin:end]
        known = np.flatnonzero(~np.isnan(part))
        first = known[0] if known.size else 0
        found |= {begin + row for row in range(first, end - begin) if np.isnan(part[row])}
    return found


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 1.0])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("order", ["C", "F"])
def test_gaps_hold_the_last_value(share, dtype, order):
    rng = np.random.default_rng(int(10 * share))
    values = np.array(rng.standard_normal((60, 5)), dtype, order=order)
    values[rng.random(values.shape) < share] = np.nan
    before = values.copy()
    columns = [3, 0, 4]
    held = HeldInputs(values, columns, STRETCHES)
    twin = filled(values[:, columns], STRETCHES)
    assert held.shape == twin.shape
    some = rng.integers(0, 60, 17)
    for rows in (slice(None), slice(7, 41), slice(50, 60), slice(9, 9), some):
        np.testing.assert_array_equal(held[rows], twin[rows])
        assert held[rows].dtype == np.float64
        assert held[rows].flags.c_contiguous
    for i, column in enumerate(columns):
        gaps = held.gaps.get(i)
        counting = set() if gaps is None else set(gaps.rows[gaps.counts].tolist())
        assert counting == missing_rows(values[:, column], STRETCHES)
    np.testing.assert_array_equal(values, before)
