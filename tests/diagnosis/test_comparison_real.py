"""What compare says of real recordings whose physics is known."""

import numpy as np
import pandas as pd
import pytest
from support.places import RECORDINGS

from skhoid import ARXRegressor, compare, load_bicycle_rider, load_human_tracking, select_runs

SILVERBOX = RECORDINGS / "silverbox" / "SNLS80mV.parquet"


def names(comparison):
    return [finding.name for finding in comparison.findings]


def test_unit_fault_of_the_bicycle_is_the_first_finding():
    X, y = load_bicycle_rider(
        inputs=["RollAngle", "RollRate", "YawRate", "PullForce"], correct_units=False
    )
    model = ARXRegressor(inputs=["RollAngle"]).fit(X, y)
    comparison = compare(model, X, y, roles={"PullForce": "dist"})
    assert comparison.ceiling_route == "none"
    first = comparison.findings[0]
    assert first.name == "rate unit"
    assert "RollRate" in first.title
    assert "pi/180" in str(first)


@pytest.mark.slow
def test_delay_of_a_person_who_tracks_is_found():
    # SOURCE of the recording: 0.10 to 0.13 s at difficulty 80, which raises the VAF by 2 points.
    X, y = load_human_tracking(["difficulty 80"])
    X, y = X - X.mean(), y - y.mean()
    without = compare(ARXRegressor().fit(X, y), X, y)
    delay = without.tests.set_index("test").loc["delay"]
    assert delay["exceeds"]
    assert 0.09 < delay["size"] < 0.15
    assert "delay" in names(without)
    with_delay = compare(ARXRegressor(nk=7).fit(X, y), X, y)
    assert "delay" not in names(with_delay)
    assert with_delay.vaf > without.vaf


def test_repeats_of_a_recorded_target_give_a_ceiling():
    X, y = load_human_tracking([f"phase-size 2{k}" for k in "bcde"])
    X, y = X - X["f_t"].mean(), y - X["f_t"].mean()
    comparison = compare(ARXRegressor().fit(X, y), X, y)
    assert comparison.ceiling_route == "repeats"
    assert set(comparison.by_run["target"]) == {0}
    low, high = comparison.noise_ceiling_interval
    assert comparison.vaf < low < high < 100


@pytest.mark.slow
@pytest.mark.skipif(not SILVERBOX.exists(), reason="needs ../shared/data, which is not bundled")
def test_cubic_stiffness_of_the_silverbox_is_distortion_at_the_odd_lines():
    pytest.importorskip("pyarrow")
    table = pd.read_parquet(SILVERBOX)
    dt, n = 2**14 / 1e7, 8192
    ends = [49127, 57821, 66514, 75206, 83900, 92590]  # of realisations of an odd multisine
    index = pd.MultiIndex.from_product([range(len(ends)), dt * np.arange(n)], names=["run", "time"])
    rows = np.concatenate([np.arange(end - n, end) for end in ends])
    X = pd.DataFrame({"V1": table["V1"].to_numpy()[rows]}, index=index)
    y = pd.Series(table["V2"].to_numpy()[rows], index=index, name="V2")
    model = ARXRegressor(nb=3, fit_intercept=True).fit(*select_runs(X, y, first=3))
    comparison = compare(model, *select_runs(X, y, last=3), roles={"V1": "f_t"})
    assert comparison.ceiling_route == "lines"
    assert comparison.explainable_gap > 1
    found = next(f for f in comparison.findings if f.name == "distortion")
    assert "odd lines" in found.title
    even = comparison.by_frequency.query("kind == 'even'")["share"].sum()
    assert even < 0.05 * (100 - comparison.vaf)
