"""Candidates judged in the closed loop."""

import numpy as np
import pytest
from support.person_in_loop import pursued

from skhoid import EffectSearchCV, OperatorRegressor, compare
from skhoid.search import Reason, Status

THRESHOLD = 12.5  # nats of an effect that counts
RIVALS = ["feedforward", "preview", "output_feedback"]
SHORT = {"n_runs": 3, "duration": 30.0}
TARGET = {"feedforward", "preview"}


def seeds(first, end):
    """A study."""
    return [pytest.param(seed, marks=pytest.mark.whole) for seed in range(first, end)]


def named(search):
    return [name for name in search.best_effects_ if name != "unknown"]


def searched(text, seed, effects=RIVALS, **options):
    X, y, _ = pursued(text, seed, **options)
    return EffectSearchCV(OperatorRegressor(), effects=effects, controlled_element=text).fit(X, y)


@pytest.mark.slow
def test_nothing_is_named_of_a_person_who_answers_the_error():
    found = searched("1/s", 1, **SHORT)
    assert named(found) == []
    row = found.ranking_.iloc[0]
    assert row["effect"] in TARGET  # which follows the measured error better
    assert row["vaf_gain"] > 0.5
    assert row["status"] == Status.NOT_BETTER
    assert row["evidence"] < THRESHOLD < row["free_run"]
    assert row["reason_code"] == Reason.REFUTED


@pytest.mark.slow
def test_feedforward_is_named_where_it_is():
    found = searched("1/s", 2, feedforward=0.6, early=-0.1, **SHORT)
    assert named(found) == ["feedforward"]
    row = found.ranking_.iloc[0]
    assert row["status"] == Status.ADDED
    assert row["instruments"] > THRESHOLD
    assert found.error_path_["vaf_loop"].is_monotonic_increasing


@pytest.mark.parametrize("text", ["1/s", "1/(s(s+1))"])
@pytest.mark.parametrize("seed", seeds(90, 93))
def test_feedforward_is_named_over_seeds(text, seed):
    """A tenth of a second late: one without delay is a preview of no time."""
    assert named(searched(text, seed, feedforward=0.6, early=-0.1)) == ["feedforward"]


@pytest.mark.parametrize("seed", [pytest.param(120, marks=pytest.mark.slow), *seeds(121, 123)])
def test_a_preview_is_found_and_not_the_inverse_of_the_element(seed):
    """Which x would give, with a VAF near 100 % on these runs and far below 0 on others."""
    text, sees = "1/(s(s+1))", {"feedforward": 0.6, "early": 0.2}
    X, y, person = pursued(text, seed, **sees)
    found = EffectSearchCV(
        OperatorRegressor(),
        effects=[*RIVALS, "higher_order", "saturation"],
        display="preview",
        controlled_element=text,
    ).fit(X, y)
    assert named(found) == ["preview"]
    X, y, _ = pursued(text, seed + 1000, person=person, **sees)
    assert found.score(X, y) > max(75.0, found.baseline_.score(X, y) + 20.0)
    assert compare(found.best_estimator_, X, y).leak.leaks is False
    tau_e = found.best_estimator_.parameters_.loc["tau_e"]
    assert np.isfinite(tau_e["sd"])  # not at its least
    assert tau_e["value"] == pytest.approx(person.tau_e, abs=max(0.06, 2 * tau_e["sd"]))
