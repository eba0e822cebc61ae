"""The recommendation of a memory horizon."""

import numpy as np
import pandas as pd
import pytest

from skhoid import (
    CompensatoryTask,
    ControlledElement,
    HumanOperator,
    Multisine,
    Ramp,
    Remnant,
    recommend_forgetting,
)

FEW = {"n_replications": 6, "n_validation": 4}


def test_of_the_thesis():
    advice = recommend_forgetting("C4", 0.15, n_replications=12)
    assert advice.memory_horizon == 256
    assert advice.memory_time == 2.56
    assert advice.forgetting == 1 - 1 / 256
    assert 5 < advice.gain < 15
    assert advice.window == pytest.approx((30.72, 51.2), abs=0.02)
    assert "N0 = 256 samples (2.56 s" in str(advice)


def test_nothing_changes():
    advice = recommend_forgetting("C2", 0.2, **FEW)
    assert np.isinf(advice.memory_horizon)
    assert advice.forgetting == 1
    assert str(advice).startswith("Do not forget")


def test_a_task_of_ones_own():
    task = CompensatoryTask(
        controlled_element=ControlledElement(K_c=Ramp(60, 40, 10, 25), omega_b=2.0),
        operator=HumanOperator(K_e=0.08, T_L=Ramp(0.5, 0.8, 10, 25), tau_e=0.2),
        target=Multisine(),
        sampling_rate=50.0,
        duration=40.96,
        remnant=Remnant(gain=0.02),
    )
    advice = recommend_forgetting(task, **FEW)
    assert advice.window == pytest.approx((17.5 - 10.1, 17.5 + 10.1), abs=0.2)
    assert len(advice.table["remnant_intensity"].unique()) == 1
    assert advice.table["nk"].between(8, 20).all()
    assert advice.summary.index.get_level_values("memory_horizon").max() == np.inf
    display = advice.plot()
    assert len(display.figure_.axes) == 2


@pytest.mark.slow
def test_several_intensities_and_a_folder(tmp_path):
    options = {"n_replications": 2, "n_validation": 2, "window": (35.0, 60.0)}
    first = recommend_forgetting("C5", [0.1, 0.2], **options, out=tmp_path)
    again = recommend_forgetting("C5", [0.1, 0.2], **options, out=tmp_path)
    pd.testing.assert_frame_equal(first.table, again.table, check_exact=True)
    assert first.window == (35.0, 60.0)
    assert first.table["remnant_intensity"].unique().tolist() == [0.1, 0.2]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "Give remnant_intensity"),
        ({"remnant_intensity": 0.0}, "above 0"),
        ({"remnant_intensity": 0.1, "window": (50, 40)}, "does not lie in the run"),
    ],
)
def test_errors(options, message):
    with pytest.raises(ValueError, match=message):
        recommend_forgetting("C4", **options)
