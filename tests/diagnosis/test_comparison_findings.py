"""What is missing is found, named and sized."""

import numpy as np
import pytest
from support.comparison import names, runs
from support.hidden_effects import Effects, LinearTruth, Oracle
from support.person_in_loop import pursued

from skhoid import (
    ARXRegressor,
    OperatorRegressor,
    compare,
    make_tracking_runs,
)
from skhoid.effects import Bias, DeadZone

pytestmark = pytest.mark.slow  # fits many models

# Findings


def first_three(comparison):
    return {finding.name: finding for finding in comparison.findings[:3]}


def compared(effects, condition="C1", **options):
    X, y, truth = runs(5, condition, effects=effects, **options)
    return compare(LinearTruth(truth.linear_response), X, y)


def test_nothing_is_found_where_nothing_is_missing():
    X, y, truth = runs(5, "C2", seed=3)
    comparison = compare(Oracle(truth.u_without_remnant), X, y)
    assert names(comparison) == ["none", "one target"]


def test_dead_zone_is_found():
    found = first_three(compared(Effects(dead_zone=0.3)))["nonlinearity"]
    assert found.title == "The response is weaker at small e than at large e"
    assert "dead zone" in found.meaning


@pytest.mark.parametrize("level", [-0.06, 0.05])
def test_small_errors_are_small_beside_an_offset_too(level):
    """An offset in the loop moves all errors to one side of the dead zone."""
    hidden = DeadZone(width=0.3) + Bias(level=level)
    task = {"channels": ["e", "x", "f_t"], "sampling_rate": 50, "random_state": 9}
    X, y = make_tracking_runs("C1", 3, effects=hidden, remnant_intensity=0.1, **task)
    found = {f.name: f for f in compare(OperatorRegressor().fit(X, y), X, y).findings}
    title = found["nonlinearity"].title
    assert title == "The response is weaker at small e than at large e"


def test_asymmetry_is_found():
    found = first_three(compared(Effects(asymmetry=-0.3)))["asymmetry"]
    assert "to negative" in found.title


def test_gain_step_is_found_and_placed():
    comparison = compared(Effects(gain_step=(41.0, 0.7)))
    found = first_three(comparison)["gain change"]
    test = comparison.tests.set_index("test").loc["gain change"]
    assert abs(test["where"] - 41.0) < 2.0
    assert abs(test["size"] + 0.3) < 0.12
    assert "falls" in found.title


def test_wrong_delay_is_found_with_its_size(simulated):
    X, y, _ = simulated
    X_fit, y_fit, _ = runs(3, seed=100, first_run=11)
    comparison = compare(ARXRegressor(nk=6).fit(X_fit, y_fit), X, y)
    assert "longer" in first_three(comparison)["delay"].title
    test = comparison.tests.set_index("test").loc["delay"]
    assert abs(test["size"] - 0.08) < 0.02


def test_outlying_run_is_found():
    X, y, truth = runs(5)
    other = y.index.get_level_values("run") == 2
    comparison = compare(Oracle(truth.u_without_remnant), X, y + np.where(other, truth.n, 0.0))
    assert "Run 2" in first_three(comparison)["outlying run"].title
    assert comparison.by_run["exceeds"].tolist() == [False, True, False, False, False]


def test_lost_control_is_found(simulated):
    X, y, truth = simulated
    X = X.copy()
    X.iloc[3000:3150, 0] *= 15  # of run 2, from 38.08 s on
    X["x"] = X["f_t"] - X["e"]
    comparison = compare(Oracle(truth.u_without_remnant), X, y)
    assert "In run 2" in first_three(comparison)["lost control"].title
    where = comparison.tests.set_index("test").loc["lost control", "where"]
    assert abs(where - 38.08) < 4.0


def test_what_answers_the_target_alone_cannot_rebuild_the_output():
    X, y, _ = pursued("1/(s(s+1))", 21, remnant=0.1, n_runs=4)
    model = ARXRegressor(na=2, nb=3, nk=0, inputs=["f_t"]).fit(X, y)
    comparison = compare(model, X, y)
    assert comparison.leak is None
    assert "leak" not in [finding.name for finding in comparison.findings]
    named = X.rename(columns={"f_t": "wanted"})
    model = ARXRegressor(na=2, nb=3, nk=0, inputs=["wanted"], roles={"wanted": "f_t"})
    assert compare(model.fit(named, y), named, y).leak is None


def test_single_event_is_found(simulated):
    X, y, truth = simulated
    y = y.copy()
    y.iloc[2048 + 750 : 2048 + 753] += 2 * y.std()
    comparison = compare(Oracle(truth.u_without_remnant), X, y)
    event = first_three(comparison)["outlier"]
    assert "A single event in run 2 at 30" in event.title
    assert event.meaning == "A spike or a gap of the recording, or a slip of the hand."


def test_where_the_model_lacks_something_an_event_is_no_slip_at_once():
    X, y = make_tracking_runs(
        "C1", 3, effects=DeadZone(width=0.3), channels=["e", "x", "f_t"], random_state=0
    )
    y.iloc[12_000:12_020] += 9 * y.std()
    findings = compare(ARXRegressor(nk=29, inputs=["e"]).fit(X, y), X, y).findings
    (event,) = (finding for finding in findings if finding.name == "outlier")
    assert event.meaning.startswith("Perhaps the place where it costs most")


def test_a_mean_that_flatters_is_noted():
    X, y = make_tracking_runs("C1", n_runs=2, remnant_intensity=0.1, random_state=1)
    model = ARXRegressor(nk=29, fit_intercept=True).fit(X, y)
    assert "mean" not in [note.kind for note in compare(model, X, y).notes]
    far = y + 3 * y.std()
    notes = compare(ARXRegressor(nk=29, fit_intercept=True).fit(X, far), X, far).notes
    assert [note.kind for note in notes].count("mean") == 1
