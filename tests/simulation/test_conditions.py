"""The conditions of the thesis, and mixtures of them."""

import numpy as np
import pytest

from skhoid import (
    ControlledElement,
    HumanOperator,
    Remnant,
    Sigmoid,
    Step,
    mixed_condition,
    tracking_condition,
)
from skhoid.simulation import Condition

OMEGA = np.geomspace(0.05, 40.0, 30)
STATES = {"C1": (90.0, 6.0, 0.09, 0.4), "C2": (30.0, 0.2, 0.07, 1.2)}  # Table II
TRANSITIONS = {"C3": ("C1", "C2", 0.5), "C4": ("C1", "C2", 100.0)} | {
    "C5": ("C2", "C1", 0.5),
    "C6": ("C2", "C1", 100.0),
}

# Conditions


@pytest.mark.parametrize("state", ["C1", "C2"])
def test_conditions_without_transition(state):
    condition = tracking_condition(state)
    K_c, omega_b, K_e, T_L = STATES[state]
    assert condition == Condition(
        state, ControlledElement(K_c, omega_b), HumanOperator(K_e=K_e, T_L=T_L)
    )


@pytest.mark.parametrize("name", list(TRANSITIONS))
def test_conditions_with_transition(name):
    begin, end, G = TRANSITIONS[name]
    condition = tracking_condition(name)
    t = np.array([0.0, 40.0, 40.96, 41.0, 45.0, 81.92])
    w = 1 / (1 + np.exp(-G * np.clip(t - 40.96, -5, 5)))
    w[[0, -1]] = 0.0, 1.0
    (K_c, omega_b, K_e, T_L), two = STATES[begin], STATES[end]
    element, operator = condition.controlled_element, condition.operator
    np.testing.assert_allclose(element.K_c(t), K_c + (two[0] - K_c) * w, rtol=1e-6)
    np.testing.assert_allclose(element.omega_b(t), omega_b + (two[1] - omega_b) * w, rtol=1e-6)
    found_e, found_edot = operator.gains(t)
    np.testing.assert_allclose(found_e, K_e + (two[2] - K_e) * w, rtol=1e-6)
    lead, lead_two = K_e * T_L, two[2] * two[3]
    np.testing.assert_allclose(found_edot, lead + (lead_two - lead) * w, rtol=1e-6)
    assert (operator.tau_e, operator.omega_nm, operator.zeta_nm) == (0.28, 11.25, 0.35)


def test_mixed_conditions():
    half = mixed_condition("c1", tracking_condition("C2"), 0.5)
    assert half.name == "C1 to C2"
    assert half.controlled_element == ControlledElement(60.0, 3.1)
    assert half.operator.K_e == pytest.approx(0.08)
    assert half.operator.K_edot == pytest.approx((0.09 * 0.4 + 0.07 * 1.2) / 2)
    there = mixed_condition("C1", "C2", 0)
    np.testing.assert_allclose(
        there.operator.frequency_response(OMEGA),
        tracking_condition("C1").operator.frequency_response(OMEGA),
    )
    nested = mixed_condition("C3", "C1", Step(0, 1, time=60.0))
    np.testing.assert_allclose(
        nested.controlled_element.K_c([0.0, 59.0, 60.0]), [90, 30.01, 90], 1e-3
    )


def test_delays_cannot_be_mixed():
    quick = Condition("quick", ControlledElement(), HumanOperator(tau_e=0.2))
    with pytest.raises(ValueError, match=r"C1 has tau_e = 0.28 s and quick 0.2 s"):
        mixed_condition("C1", quick, 0.5)


@pytest.mark.parametrize(
    ("name", "hint"),
    [("C7", "C6"), ("foo", None), (None, None)],
)
def test_unknown_conditions(name, hint):
    with pytest.raises(ValueError, match=r"Unknown condition .*C1, C2, C3, C4, C5, C6") as caught:
        tracking_condition(name)
    if hint:
        assert str(caught.value).endswith(f"Did you mean {hint!r}?")


def test_a_gain_of_table_g1_follows_the_transition():
    gain = Sigmoid(0.016, 0.039, rate=100.0, time=40.96)
    assert Remnant.from_table("C4", 0.15) == Remnant(order=2, gain=gain)
