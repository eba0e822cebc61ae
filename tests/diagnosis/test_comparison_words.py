"""Sentences of a comparison say what is so: words, means, delays, what the model has already."""

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from support.comparison import NK, Gives, names, runs
from support.unseen import second_difference, simulate

from skhoid import ARXRegressor, compare


def by_kind(comparison):
    return {finding.name: finding for finding in comparison.findings}


def test_where_the_mean_holds_most_of_the_power_texts_are_about_the_mean():
    X, y, truth = runs(4)
    level = 12 * float(np.std(y))
    prediction = level + 0.6 * truth.u_without_remnant.to_numpy()
    found = compare(Gives(lambda X: prediction), X, y + level, run_in=0)
    scored = found.traces["scored"].to_numpy()
    u, r = (y + level).to_numpy()[scored], (y + level - prediction).to_numpy()[scored]
    about_mean = 100 * (1 - np.sum(r**2) / np.sum((u - u.mean()) ** 2))
    assert found.vaf > 99
    assert_allclose(found.vaf_about_mean, about_mean, rtol=1e-9)
    assert about_mean < 90
    text = " ".join(found.summary().split())
    assert f"VAF (about the mean): {about_mean:.1f} %" in text
    assert "% of the power is the mean" in text
    points = found.point_scale * found.explainable_gap
    assert f"{points:.1f} VAF points (about the mean)" in text
    assert points > 5
    assert "none" not in names(found)
    assert by_kind(found)["gain"].severity > 5
    assert "about the mean" in by_kind(found)["gain"].evidence


def test_a_few_parameters_have_not_learnt_the_noise():
    X_fit, y_fit, _ = runs(3, seed=100, first_run=11)
    X, y, truth = runs(3)
    model = ARXRegressor(nk=NK).fit(X_fit, y_fit)
    other = y + 0.5 * truth.n.to_numpy() + 0.2 * float(np.std(y))
    found = compare(model, X, other, estimation=(X_fit, y_fit))
    assert found.overfit
    finding = by_kind(found)["overfit"]
    assert finding.title.startswith("The error on validation runs")
    assert "4 parameters cannot have learnt that much noise" in finding.meaning
    assert "Fewer parameters" not in finding.next_step


def test_levels_are_those_that_are_listed():
    """The share that is said is that of the levels that are said, and not of both signs of one."""
    X, y, _ = runs(2)
    at_one_end = y.clip(upper=0.1)
    found = compare(Gives(lambda X: 0.8 * y.to_numpy()), X, at_one_end, run_in=0)
    row = found.tests.set_index("test").loc["level"]
    assert row["description"] == "at u = 0.1"
    assert row["size"] == pytest.approx(np.mean(at_one_end >= 0.1), abs=0.005)
    title = by_kind(found)["level"].title
    assert title == f"{100 * row['size']:.1f} % of the samples sit at u = 0.1"


@pytest.mark.slow
def test_compare_says_that_a_model_rebuilds_the_output():
    loop = simulate("1/s", 3, disturbance=1.0)
    n, n_runs = loop.u.shape
    index = pd.MultiIndex.from_product([range(n_runs), np.arange(n) / 60], names=["run", "time"])
    X = pd.DataFrame(
        {"e": loop.e.T.ravel(), "x": loop.x.T.ravel(), "f_t": loop.f.T.ravel()}, index=index
    )
    y = pd.Series(loop.u.T.ravel(), index=index, name="u")
    inverse, answer = second_difference(loop).T.ravel(), loop.answer.T.ravel()
    leaking = compare(Gives(lambda X: inverse), X, y, run_in=5.0)
    assert leaking.leak.leaks
    assert leaking.findings[0].name == "leak"
    assert leaking.tests.set_index("test").loc["leak", "exceeds"]
    assert "rebuilds the output" in leaking.summary()
    honest = compare(Gives(lambda X: answer), X, y, run_in=5.0)
    assert honest.leak.leaks is False
    assert "leak" not in names(honest)
