"""The advice for one's own experiment."""

import pytest

from skhoid import CompensatoryTask, HumanOperator, Ramp, Remnant, make_tracking_runs
from skhoid.lab.studies import recommend_method
from skhoid.lab.studies.tournament import _paired_error

pytestmark = pytest.mark.slow  # compiles for many seconds

METHODS = ["rls", "rls_smooth", "arx"]
FEW = {"methods": METHODS, "n_replications": 3, "n_validation": 1}


def test_follow():
    advice = recommend_method("C4", 0.15, **FEW)
    assert advice.method in ("rls", "rls_smooth")
    assert "arx" not in advice.close
    assert advice.ranking["difference"].iloc[0] == 0
    assert (advice.ranking["loss"].diff().dropna() >= 0).all()
    text = str(advice)
    assert text.startswith(f"To follow K_edot over time: {advice.method} (recursive least squares")
    assert repr(advice.estimator) in text
    assert "arx: +" in text
    assert "<pre" in advice._repr_html_()


@pytest.mark.slow
def test_the_estimator_can_be_fitted():
    advice = recommend_method("C3", 0.15, question="predict", causal=True, **FEW)
    X, y = make_tracking_runs("C3", 1, remnant_intensity=0.15, random_state=5)
    assert advice.estimator.fit(X, y).score(X, y) > 50
    assert advice.estimator.nk == 29


@pytest.mark.slow
def test_detect_simulates_runs_without_a_change_too():
    advice = recommend_method("C4", 0.15, question="detect", **FEW)
    assert set(advice.result.cells["kind"]) == {"constant", "changing"}
    assert advice.method != "arx"
    assert advice.ranking.loc["arx", "loss"] > 30
    assert advice.ranking["n"].eq(3).all()


@pytest.mark.slow
def test_a_task_of_ones_own():
    task = CompensatoryTask(
        operator=HumanOperator(T_L=Ramp(0.4, 0.9, 15, 22)),
        duration=40.96,
        sampling_rate=50.0,
        run_in=20.0,
        remnant=Remnant(gain=0.01),
    )
    advice = recommend_method(task, question="final", **FEW)
    assert advice.result.cells["group"].tolist() == ["changing, own remnant"]
    assert advice.estimator.nk == 15 or not hasattr(advice.estimator, "memory_time")
    several = recommend_method("C4", [0.05, 0.25], **FEW)
    assert len(several.result.cells) == 2
    assert several.ranking["n"].eq(6).all()


def test_paired_errors():
    """Of one cell: the standard error of the mean difference."""
    import numpy as np
    import pandas as pd

    index = pd.MultiIndex.from_product([["a"], range(5)], names=["cell", "replication"])
    apart = pd.DataFrame({"x": 0.0, "y": [1.0, 2, 3, 4, 5]}, index=index)
    assert _paired_error(apart).to_dict() == pytest.approx({"x": 0.0, "y": np.sqrt(2.5 / 5)})
    both = pd.concat([apart, apart.rename(index={"a": "b"})])
    assert _paired_error(both)["y"] == pytest.approx(np.sqrt(2.5 / 10))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "Give remnant_intensity"),
        ({"remnant_intensity": [0.1, 0.0]}, "above 0"),
        ({"remnant_intensity": 0.1, "question": "detect", "task": "C1"}, "Nothing changes"),
        ({"remnant_intensity": 0.1, "question": "why"}, "The 'question' parameter"),
        (
            {"remnant_intensity": 0.1, "question": "delay", "methods": ["rls"]},
            "estimates the delay",
        ),
        ({"remnant_intensity": 0.1, "methods": ["rsl"]}, "Unknown method 'rsl'"),
        (
            {"remnant_intensity": 0.1, "parameter": "K_x", "methods": ["arx"]},
            "parameter must be one",
        ),
    ],
)
def test_errors(options, message):
    options = {"task": "C4"} | options
    with pytest.raises(ValueError, match=message):
        recommend_method(options.pop("task"), options.pop("remnant_intensity", None), **options)
