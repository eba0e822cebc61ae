"""The recommendation of a memory horizon."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from skhoid import (
    CompensatoryTask,
    ControlledElement,
    HumanOperator,
    MonteCarloStudy,
    Multisine,
    Ramp,
    Remnant,
    recommend_forgetting,
)
from skhoid.lab.studies.memory_horizons import change_window, crossed_standard_error, forgetting_vaf

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


@pytest.mark.slow
def test_more_remnant_needs_a_longer_memory():
    found = [
        recommend_forgetting("C3", P_n, **FEW, memory_horizons=[16, 64, 256, 1024])
        for P_n in (0.01, 0.3)
    ]
    assert found[0].memory_horizon < found[1].memory_horizon


@pytest.mark.slow
@pytest.mark.parametrize("rate", [50.0, 200.0])
def test_memory_in_seconds_does_not_depend_on_the_rate(rate):
    """Horizons are octaves apart: the same within one."""
    task = CompensatoryTask.of_condition("C4", sampling_rate=rate)
    advice = recommend_forgetting(task, 0.15, **FEW)
    assert 1.28 <= advice.memory_time <= 5.12


def test_units_do_not_matter():
    """The error in other units, the stick in others still."""
    study = MonteCarloStudy(
        forgetting_vaf,
        {"condition": ["C4"], "remnant_intensity": [0.15]},
        2,
        n_validation_runs=2,
        simulation={"keep_run_in": 1.0},
        batched=True,
        random_state=0,
    )
    vaf = []
    for e_unit, u_unit in ((1.0, 1.0), (60.0, 1e-3)):

        def scaled(block, e_unit=e_unit, u_unit=u_unit):
            def in_units(record):
                return replace(record, e=e_unit * record.e, u=u_unit * record.u)

            block = replace(
                block, record=in_units(block.record), validation=in_units(block.validation)
            )
            return forgetting_vaf(block, memory_horizons=(64, 256, np.inf), scaled=True)

        study.function = scaled
        vaf.append(study.run()["vaf_validation"])
    np.testing.assert_allclose(vaf[0], vaf[1], atol=1e-6)


def test_a_task_of_ones_own():
    task = CompensatoryTask(
        controlled_element=ControlledElement(K_c=Ramp(60, 40, 10, 25), omega_b=2.0),
        operator=HumanOperator(K_e=0.08, T_L=Ramp(0.5, 0.8, 10, 25), tau_e=0.2),
        target=Multisine(),
        sampling_rate=50.0,
        duration=40.96,
        remnant=Remnant(gain=0.02),
    )
    assert change_window(task) == pytest.approx((17.5 - 10.1, 17.5 + 10.1), abs=0.2)
    advice = recommend_forgetting(task, **FEW)
    assert len(advice.table["remnant_intensity"].unique()) == 1
    assert advice.table["nk"].between(8, 20).all()
    assert advice.summary.index.get_level_values("memory_horizon").max() == np.inf
    display = advice.plot()
    assert len(display.figure_.axes) == 2


@pytest.mark.slow
def test_several_intensities_and_a_folder(tmp_path):
    options = {**FEW, "memory_horizons": [64, 256], "window": (35.0, 60.0), "init_window": 20.0}
    first = recommend_forgetting("C5", [0.1, 0.2], **options, out=tmp_path)
    again = recommend_forgetting("C5", [0.1, 0.2], **options, out=tmp_path)
    pd.testing.assert_frame_equal(first.table, again.table, check_exact=True)
    assert first.window == (35.0, 60.0)
    assert first.table["remnant_intensity"].unique().tolist() == [0.1, 0.2]


@pytest.mark.slow
def test_standard_error_of_crossed_runs():
    """Runs of both kinds vary; 120 draws of 6 x 4 give the deviation
    within 7 %, and the root of the mean stated variance within 8 %."""
    rng = np.random.default_rng(0)
    index = pd.MultiIndex.from_product(
        [[0.1], range(6), range(4)], names=["remnant_intensity", "replication", "validation"]
    )
    means, stated = [], []
    for _ in range(120):
        x = 2 * rng.standard_normal((6, 1)) + 3 * rng.standard_normal((1, 4))
        means.append(x.mean())
        stated.append(crossed_standard_error(pd.DataFrame({"x": x.ravel()}, index=index))["x"] ** 2)
    assert np.sqrt(np.mean(stated)) == pytest.approx(np.std(means), rel=0.2)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "Give remnant_intensity"),
        ({"remnant_intensity": 0.0}, "above 0"),
        ({"remnant_intensity": 0.1, "window": (50, 40)}, "does not lie in the run"),
        (
            {"remnant_intensity": 0.1, "init_window": 90.0},
            "init_window must be a time within the run",
        ),
        ({"remnant_intensity": 0.1, "memory_horizons": [0.5]}, "above 1"),
    ],
)
def test_errors(options, message):
    with pytest.raises(ValueError, match=message):
        recommend_forgetting("C4", **options)
