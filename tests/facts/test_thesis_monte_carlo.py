"""Remnant gains, delays and biases of the thesis's Monte Carlo, recomputed in a reduced form.

``pytest -m slow tests/facts/test_thesis_monte_carlo.py`` computes all cells.
"""

from functools import lru_cache

import numpy as np
import pytest
from support.thesis import DT, INTENSITIES, NK, WINDOW
from support.thesis_numbers import BIASES, DELAYS, STATES, TABLE_G1, check

from skhoid import (
    ARXRegressor,
    CompensatoryTask,
    DelaySearchCV,
    Remnant,
    RemnantIntensityError,
    make_tracking_runs,
    operator_parameters,
    tracking_condition,
    tune_remnant,
    zoh_parameters,
)

pytestmark = pytest.mark.slow  # simulates for long

# What the fast part computes; all of them together take minutes.
QUICK = {(2, "C2"), ("nm", "C1")}
QUICK_CELLS = {(2, "C1", 0.10), ("nm", "C2", 0.15)}


@pytest.mark.parametrize(
    ("order", "state"),
    [
        pytest.param(order, state, marks=() if (order, state) in QUICK else pytest.mark.slow)
        for order, state in TABLE_G1
    ],
)
def test_remnant_gains_of_table_g1(order, state):
    for P_n, (gain, tolerance) in zip(INTENSITIES, TABLE_G1[order, state], strict=False):
        task = CompensatoryTask.of_condition(state, remnant=Remnant(order=order, intensity=P_n))
        found = tune_remnant(task, random_state=11).remnant.gain
        assert found == pytest.approx(gain, abs=tolerance), P_n


@pytest.mark.parametrize("random_state", [0, *(pytest.param(i) for i in range(1, 6))])
def test_unreachable_intensity_is_refused(random_state):
    """H_n^4, C2, 0.30: P_n saturates at 0.302; half of the sets of ten never reach it."""
    task = CompensatoryTask.of_condition("C2", remnant=Remnant(order=4, intensity=0.30))
    with pytest.raises(RemnantIntensityError):
        tune_remnant(task, random_state=random_state)


@lru_cache(maxsize=8)
def e_and_u(order, state, P_n):
    """The 100 runs of a cell, with the gains of Table G.1, the same noise in each cell."""
    X, y = make_tracking_runs(
        state,
        100,
        remnant_gain="table",
        remnant_order=order,
        remnant_intensity=P_n,
        random_state=17,
    )
    e, u = (table.to_numpy().reshape(100, WINDOW) for table in (X, y))
    return [(e[run][:, None], u[run]) for run in range(100)]


def mean_bias(order, state, P_n):
    model = ARXRegressor(nk=NK, dt=DT)
    theta = [model.fit(e, u).coef_ for e, u in e_and_u(order, state, P_n)]
    return np.mean(theta, axis=0) / zoh_parameters(tracking_condition(state).operator, DT) - 1


def cells(table, quick):
    """Cells of a table, of which all but some are slow."""
    return [
        pytest.param(
            order,
            state,
            P_n,
            *value,
            marks=() if (order, state, P_n) in quick else pytest.mark.slow,
            id=f"{state}-H{order}-P{P_n:.2f}",
        )
        for (order, state), row in table.items()
        for P_n, value in zip(INTENSITIES, row, strict=True)
        if value is not None
    ]


@pytest.mark.parametrize(
    ("order", "state", "P_n", "expected", "tolerance"), cells(DELAYS, QUICK_CELLS)
)
def test_mean_delay(order, state, P_n, expected, tolerance):
    search = DelaySearchCV(ARXRegressor(dt=DT), nk=range(15, 49))
    found = [search.fit(e, u).best_nk_ for e, u in e_and_u(order, state, P_n)]
    assert np.mean(found) == pytest.approx(expected, abs=tolerance)


@pytest.mark.parametrize(
    ("order", "state", "P_n", "expected", "tolerance"), cells(BIASES, QUICK_CELLS)
)
def test_mean_bias(order, state, P_n, expected, tolerance):
    difference = mean_bias(order, state, P_n) - expected
    assert (np.abs(difference) <= tolerance).all(), difference


def test_signs_of_the_bias():
    """fig10.signs: for orders 1 and 2 opposite to 3, 4 and nm, in a as in b (Eq. 30)."""
    for order in (1, 2, 3, 4, "nm"):
        expected = [-1, -1, 1, 1] if order in (1, 2) else [1, 1, -1, -1]
        assert np.sign(mean_bias(order, "C1", 0.15)).tolist() == expected


@pytest.mark.parametrize("state", STATES)
def test_bias_of_order_1_is_the_largest_and_that_of_nm_the_smallest(state):
    """fig10.min_ratio_H1_over_others and fig10.nm_smallest_fraction."""
    for P_n in INTENSITIES:
        bias = {m: np.abs(mean_bias(m, state, P_n)) for m in (1, 2, 3, 4, "nm")}
        others = np.stack([bias[m] for m in (2, 3, 4)])
        assert (bias[1] > 10 * np.maximum(others.max(axis=0), bias["nm"])).all()
        assert (bias["nm"] < others.min(axis=0)).all()


@pytest.mark.parametrize("state", ["C1", pytest.param("C2")])
def test_operator_from_batch_models(state):
    model = ARXRegressor(nk=NK, dt=DT)
    names = ["K_e", "T_L", "K_edot", "omega_nm", "zeta_nm"]
    found = [operator_parameters(model.fit(e, u)).iloc[0] for e, u in e_and_u(2, state, 0.15)]
    check(f"ho_from_batch.{state}.H2.P0.15", np.mean([row[names] for row in found], axis=0))
