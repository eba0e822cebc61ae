"""The physics as value objects: closed forms, Tables I-III and G.1, and what is refused."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import freqs

from skhoid import (
    CompensatoryTask,
    ControlledElement,
    HumanOperator,
    Mixture,
    Multisine,
    Ramp,
    Remnant,
    Sigmoid,
    Step,
    tracking_condition,
)

OMEGA = np.geomspace(0.05, 40.0, 30)

VALUES = [
    Sigmoid(90.0, 30.0, rate=0.5, time=40.96),
    Step(0.0, 1.0, time=2.0),
    Ramp(0.0, 1.0, start=1.0, end=2.0),
    Mixture(0.1, Step(0.2, 0.3, time=1.0), Ramp(0, 1, 0, 1)),
    ControlledElement(30.0, 0.2),
    ControlledElement(K_c=Sigmoid(90, 30, rate=0.5, time=40.96)),
    HumanOperator(),
    HumanOperator(K_e=Sigmoid(0.09, 0.07, rate=0.5, time=40.96), K_edot=0.05, K_x=-0.1),
    Remnant(order="nm", gain=0.02),
    Remnant(intensity=0.15),
    Multisine(multiples=(1, 4), amplitudes=(1.0, 2.0), phases=(0.0, 0.5), period=30.0),
    tracking_condition("C5"),
    CompensatoryTask.of_condition("C4", remnant=Remnant.from_table("C4", 0.15)),
]


def each(values):
    return pytest.mark.parametrize("value", values, ids=lambda v: type(v).__name__)


# Values


@each(VALUES)
def test_values_compare_hash_and_pickle(value):
    again = pickle.loads(pickle.dumps(value))
    assert again == value
    assert again is not value
    assert hash(again) == hash(value)
    assert len({again, value}) == 1


@each(VALUES[:11])
def test_representation_makes_the_value_again(value):
    assert eval(repr(value)) == value


# What is refused


@pytest.mark.parametrize(
    ("kind", "options"),
    [
        (ControlledElement, {"K_c": -0.1}),
        (HumanOperator, {"tau_e": np.inf}),
        (HumanOperator, {"omega_nm": 0.0}),
        (HumanOperator, {"K_x": "1"}),
        (Remnant, {"gain": 1.0, "time_constant": np.nan}),
        (Sigmoid, {"initial": 0, "final": 1, "rate": None, "time": 0}),
        (Step, {"initial": 0, "final": 1, "time": True}),
        (CompensatoryTask, {"duration": [0.1]}),
    ],
)
def test_senseless_numbers(kind, options):
    with pytest.raises(
        ValueError, match=f"{kind.__name__}: {list(options)[-1]} must be |rate must"
    ):
        kind(**options)


def test_lead_is_given_once():
    with pytest.raises(ValueError, match=r"give T_L or K_edot = K_e T_L, not both; got T_L=0.4"):
        HumanOperator(T_L=0.4, K_edot=0.04)
    with pytest.raises(ValueError, match="tau_e must be constant"):
        HumanOperator(tau_e=lambda t: 0.2)


# Frequency responses


@pytest.mark.parametrize(("K_c", "omega_b"), [(90.0, 6.0), (30.0, 0.2), (5.0, 0.0)])
def test_controlled_element_response(K_c, omega_b):
    _, expected = freqs([K_c], [1.0, omega_b, 0.0], OMEGA)
    found = ControlledElement(K_c, omega_b).frequency_response(OMEGA)
    np.testing.assert_allclose(found, expected, rtol=1e-13)


@pytest.mark.parametrize(("K_e", "T_L", "zeta"), [(0.09, 0.4, 0.35), (0.07, 1.2, 1.4), (0, 1, 1)])
def test_operator_response(K_e, T_L, zeta):
    operator = HumanOperator(K_e=K_e, T_L=T_L, tau_e=0.2, omega_nm=9.0, zeta_nm=zeta)
    _, rational = freqs([81 * K_e * T_L, 81 * K_e], [1.0, 18 * zeta, 81.0], OMEGA)
    expected = rational * np.exp(-0.2j * OMEGA)
    np.testing.assert_allclose(operator.frequency_response(OMEGA), expected, rtol=1e-12)
    rate_gain = replace(operator, T_L=None, K_edot=K_e * T_L)
    np.testing.assert_allclose(rate_gain.frequency_response(OMEGA), expected, rtol=1e-12)


@pytest.mark.parametrize("order", [1, 2, 3, 4, "nm"])
def test_remnant_response_is_that_of_its_state_equations(order):
    remnant = Remnant(order=order, gain=0.3, time_constant=0.1)
    if order == "nm":
        _, expected = freqs([0.3 * 11.25**2], [1.0, 0.7 * 11.25, 11.25**2], OMEGA)
    else:
        _, expected = freqs([0.3], np.poly([-10.0] * order) / 10.0**order, OMEGA)
    np.testing.assert_allclose(remnant.frequency_response(OMEGA), expected, rtol=1e-12)
    q = remnant.filter_coefficients()
    A = np.array([[q[0], q[1], 0, 0], [q[3], q[4], 0, 0], [0, q[5], -q[5], 0], [0, 0, q[5], -q[5]]])
    for omega, H in zip(OMEGA, expected, strict=True):
        states = np.linalg.solve(1j * omega * np.eye(4) - A, [0.3 * q[2], 0, 0, 0])
        assert q[6:] @ states == pytest.approx(H, rel=1e-12)


# Functions of time


def test_sigmoid():
    """Eq. 2; its steepest slope is G (p_f - p_i) / 4."""
    t = np.linspace(0.0, 10.0, 101)
    p = Sigmoid(2.0, 5.0, rate=3.0, time=4.0)
    np.testing.assert_allclose(p(t), 2.0 + 3.0 / (1 + np.exp(-3.0 * (t - 4.0))), rtol=1e-13)
    assert (p(4.001) - p(3.999)) / 0.002 == pytest.approx(3.0 * 3.0 / 4, rel=1e-5)
    assert p(1e6) == 5.0
    assert p(-1e6) == 2.0  # without an overflow
    np.testing.assert_allclose(p(t) + Sigmoid(5.0, 2.0, rate=3.0, time=4.0)(t), 7.0)


def test_step_and_ramp():
    t = np.array([-1.0, 0.0, 1.0, 1.5, 2.0, 9.0])
    np.testing.assert_array_equal(Step(3.0, 4.0, time=1.0)(t), [3, 3, 4, 4, 4, 4])
    np.testing.assert_array_equal(Ramp(3.0, 4.0, start=1.0, end=2.0)(t), [3, 3, 3, 3.5, 4, 4])
    with pytest.raises(ValueError, match=r"end must be later than start; .*use Step"):
        Ramp(0.0, 1.0, start=2.0, end=2.0)


@settings(max_examples=30, deadline=None)
@given(st.floats(-5, 5), st.floats(-5, 5), st.floats(0, 1), st.floats(0, 10))
def test_mixture_is_its_formula(first, second, weight, t):
    p_1, w = Ramp(first, second, 2.0, 4.0), Sigmoid(0.0, weight, rate=1.0, time=5.0)
    expected = (1 - w(t)) * p_1(t) + w(t) * second
    assert Mixture(p_1, second, w)(t) == pytest.approx(float(expected), abs=1e-12)
