"""``DelayShift`` against its twin, and with what comes after it."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.pipeline import make_pipeline
from support import closed_loop as cl
from support import naive
from support.synthetic import DT, as_table, kept_rows, run_time, signals, stretches_of

from skhoid import Decimator, DelayShift, RunInTrimmer, ShortRunError


@settings(max_examples=10, deadline=None)
@given(
    shift=st.integers(0, 12),
    lengths=st.lists(st.integers(1, 10), min_size=1, max_size=4),
    seed=st.integers(0, 99),
)
def test_delay_shift_against_its_twin(shift, lengths, seed):
    X = signals(lengths, seed)
    step = DelayShift(shift * DT, inputs=["e"], dt=DT)
    if shift >= min(lengths):
        with pytest.raises(ShortRunError, match="is longer than run"):
            step.fit(X)
        return
    out = step.fit_transform(X)
    twin = naive.delay(X["e"].to_numpy(), shift, stretches_of(X))
    np.testing.assert_array_equal(out["e"], twin)
    np.testing.assert_array_equal(out["x"], X["x"])
    assert step.n_samples_ == shift


@pytest.mark.parametrize(
    ("delay", "dt", "samples"),
    [
        (0.29, 0.01, 29),  # 28.999999999999996 in floating point
        (0.28 + 1 / 60, 1 / 60, 18),
        (0.2949, 0.01, 29),
        (0.2951, 0.01, 30),
    ],
)
def test_seconds_to_samples(delay, dt, samples):
    X = pd.DataFrame({"e": np.arange(80.0)}, index=run_time([80], dt=dt))
    step = DelayShift(delay).fit(X)
    assert step.n_samples_ == samples
    assert step.delay_ == pytest.approx(samples * dt)
    np.testing.assert_array_equal(step.transform(X)["e"].to_numpy()[samples:],
                                  np.arange(80.0 - samples))  # fmt: skip


def test_the_shift_stops_at_gaps_but_not_at_the_end_of_the_run_in():
    X = signals([100])
    gapped = X.drop(X.index[40:50])
    out = DelayShift(0.05).fit_transform(gapped)["e"].to_numpy()
    np.testing.assert_array_equal(out, naive.delay(gapped["e"].to_numpy(), 5, [(0, 40), (40, 90)]))
    trimmed = make_pipeline(RunInTrimmer(0.3), DelayShift(0.05)).fit_transform(X)["e"]
    np.testing.assert_array_equal(trimmed.to_numpy()[5:], X["e"].to_numpy()[:-5])


def test_the_default_channel_is_the_error():
    X = signals([30]).rename(columns={"x": "f_t"})
    out = DelayShift(0.02).fit_transform(X)
    assert out["e"].isna().sum() == 2
    assert out["f_t"].isna().sum() == 0
    by_role = DelayShift(0.02, roles={"f_t": "e", "e": "x"}).fit_transform(X)
    assert by_role["f_t"].isna().sum() == 2
    assert by_role["e"].isna().sum() == 0
    assert DelayShift(0.02).fit_transform(X.rename(columns={"e": "p"})).isna().sum().tolist() == [
        2,
        2,
    ]


@pytest.mark.parametrize("factor", [2, 16])
def test_shift_first_then_thin(factor):
    """Section III-D: the first shifted sample used has the offset ceil(n_k / d) d - n_k."""
    X = as_table(cl.simulate("C1", periods=1))[0]
    for steps in ((DelayShift(0.29), Decimator(factor, method="downsample")),
                  (Decimator(factor, method="downsample"), DelayShift(0.29))):  # fmt: skip
        out = make_pipeline(*steps).fit_transform(X)
        thinned = out["e"].to_numpy()[kept_rows(out)]
        first = int(np.flatnonzero(~np.isnan(thinned))[0])
        offset = int(np.ceil(29 / factor)) * factor - 29
        expected = X["e"].to_numpy()[offset::factor][: len(thinned) - first]
        np.testing.assert_array_equal(thinned[first:], expected)
