"""Remnant gains, delays and biases of the thesis's Monte Carlo, in a few cells.

Those of all cells come from the studies themselves: ``pytest -m whole tests/facts``.
"""

from functools import lru_cache

import numpy as np
import pytest
from support.thesis import DT, INTENSITIES, NK, WINDOW
from support.thesis_numbers import BIASES, DELAYS, TABLE_G1

from skhoid import (
    ARXRegressor,
    CompensatoryTask,
    DelaySearchCV,
    Remnant,
    RemnantIntensityError,
    make_tracking_runs,
    tracking_condition,
    tune_remnant,
    zoh_parameters,
)

pytestmark = pytest.mark.slow  # simulates for long

QUICK = {(2, "C2"), ("nm", "C1")}
CELLS = [(2, "C1", 0.10), ("nm", "C2", 0.15)]


@pytest.mark.parametrize(
    ("order", "state"),
    [pytest.param(*key, marks=() if key in QUICK else pytest.mark.whole) for key in TABLE_G1],
)
def test_remnant_gains_of_table_g1(order, state):
    for P_n, (gain, tolerance) in zip(INTENSITIES, TABLE_G1[order, state], strict=False):
        task = CompensatoryTask.of_condition(state, remnant=Remnant(order=order, intensity=P_n))
        found = tune_remnant(task, random_state=11).remnant.gain
        assert found == pytest.approx(gain, abs=tolerance), P_n


@pytest.mark.parametrize("random_state", [0, 1])
def test_unreachable_intensity_is_refused(random_state):
    """H_n^4, C2, 0.30: P_n saturates at 0.302; half of the sets of ten never reach it."""
    task = CompensatoryTask.of_condition("C2", remnant=Remnant(order=4, intensity=0.30))
    with pytest.raises(RemnantIntensityError):
        tune_remnant(task, random_state=random_state)


@lru_cache
def e_and_u(order, state, P_n):
    """The 100 runs of a cell, with the gains of Table G.1, the same noise in each cell."""
    remnant = {"remnant_gain": "table", "remnant_order": order, "remnant_intensity": P_n}
    X, y = make_tracking_runs(state, 100, **remnant, random_state=17)
    e, u = (table.to_numpy().reshape(100, WINDOW) for table in (X, y))
    return [(e[run][:, None], u[run]) for run in range(100)]


@pytest.mark.parametrize(("order", "state", "P_n"), CELLS)
def test_mean_delay(order, state, P_n):
    search = DelaySearchCV(ARXRegressor(dt=DT), nk=range(20, 45))
    found = [search.fit(e, u).best_nk_ for e, u in e_and_u(order, state, P_n)]
    expected, tolerance = DELAYS[order, state][INTENSITIES.index(P_n)]
    assert np.mean(found) == pytest.approx(expected, abs=tolerance)


@pytest.mark.parametrize(("order", "state", "P_n"), CELLS)
def test_mean_bias(order, state, P_n):
    model = ARXRegressor(nk=NK, dt=DT)
    theta = [model.fit(e, u).coef_ for e, u in e_and_u(order, state, P_n)]
    truth = zoh_parameters(tracking_condition(state).operator, DT)
    expected, tolerance = BIASES[order, state][INTENSITIES.index(P_n)]
    difference = np.mean(theta, axis=0) / truth - 1 - expected
    assert (np.abs(difference) <= tolerance).all(), difference
