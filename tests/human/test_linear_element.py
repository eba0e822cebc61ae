"""Controlled elements of any order: text, closed forms of SciPy, answers, inverses."""

import pickle
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import signal

from skhoid import ControlledElement, FrequencyResponse, HumanOperator, LinearElement, crossover

DT = 0.01
TEXTS = {
    "1/s": ([1.0], [1.0, 0.0]),
    "1/(s(s+1))": ([1.0], [1.0, 1.0, 0.0]),
    "90/(s^2+6s)": ([90.0], [1.0, 6.0, 0.0]),
    "90 / (s**2 + 6*s)": ([90.0], [1.0, 6.0, 0.0]),
    "2(s+3)/(s^2 (s+0.5))": ([2.0, 6.0], [1.0, 0.5, 0.0, 0.0]),
    "-3/(0.2s+1)": ([-15.0], [1.0, 5.0]),
    "(1/s)(1e1/(s + 10))": ([10.0], [1.0, 10.0, 0.0]),
    "1/s + 1/s": ([2.0], [1.0, 0.0]),
    "s/(s(s+1))": ([1.0], [1.0, 1.0]),
}


@pytest.mark.parametrize(("text", "coefficients"), TEXTS.items())
def test_texts(text, coefficients):
    element = ControlledElement(text)
    assert element == LinearElement(*coefficients)
    assert LinearElement.of(str(element)) == element
    assert eval(repr(element)) == element
    assert pickle.loads(pickle.dumps(element)) == element
    assert hash(element) == hash(
        ControlledElement(numerator=coefficients[0], denominator=coefficients[1])
    )


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("1/s(s+1)", r"not clear whether.*1/\(s\(s\+1\)\)"),
        ("K/s", "'K' is unknown"),
        ("1/(s", "never closed"),
        ("1/(s-s)", "divides by zero"),
        ("1/s^99", "up to 20"),
        ("z/s", "both s and z"),
        ("1/(z-1)", "sampling time"),
        ("s+1", "more zeros than poles"),
    ],
)
def test_what_is_wrong_in_a_text_is_said(text, what):
    with pytest.raises(ValueError, match=what):
        ControlledElement(text)


@pytest.mark.parametrize(
    "text", ["1/s", "1/(s(s+1))", "2(s+3)/(s^2 (s+0.5))", "(s+1)/(s+2)", "1/s^3"]
)
@pytest.mark.parametrize("hold", ["zoh", "foh"])
@pytest.mark.parametrize("dt", [0.01, 9.0])
def test_pulse_transfer_functions_are_those_of_scipy(text, hold, dt):
    element = ControlledElement(text)
    b, a, _ = signal.cont2discrete((element.numerator, element.denominator), dt, hold)
    found = element.discrete(dt, hold)
    np.testing.assert_allclose(found[0], b[0], rtol=1e-6, atol=1e-12 * np.abs(b).max())
    np.testing.assert_allclose(found[1], a, atol=1e-12)


def test_a_discrete_element_at_another_rate_is_that_of_the_continuous_one():
    element = ControlledElement("90/(s(s+6))")
    discrete = LinearElement(*(tuple(c) for c in element.discrete(DT)), dt=DT)
    for dt in (DT, 2 * DT, 0.025):
        for one, other in zip(discrete.discrete(dt), element.discrete(dt), strict=True):
            np.testing.assert_allclose(one, other, atol=1e-9)
    with pytest.raises(ValueError, match=r"negative real axis.*resample_runs"):
        ControlledElement("1/(z + 0.5)", dt=DT).discrete(0.02)


@pytest.mark.parametrize("direct", [False, True])
def test_the_sample_that_moves_x_first(direct):
    u = np.zeros((5, 2))
    u[2] = 1.0
    x = LinearElement((1.0,), (1.0, 0.0), direct=direct).answer(u, DT)
    assert np.flatnonzero(x[:, 0])[0] == (2 if direct else 3)
    np.testing.assert_allclose(x[-1], DT)


@pytest.mark.parametrize(
    "text", ["1/s", "1/(s(s+1))", "2(s+3)/(s^2 (s+0.5))", "(s+1)/(s+2)", "0.5", "8/(s^2+2s+8)"]
)
@pytest.mark.parametrize("sampled", [False, True])
def test_the_inverse_makes_x_follow(text, sampled):
    element = LinearElement.of(text)
    if sampled:
        element = LinearElement(*(tuple(c) for c in element.discrete(DT)), dt=DT)
    t = np.arange(0, 20, DT)[:, None] * np.array([1.0, 1.4])
    x = np.sin(0.7 * t) * np.clip(t / 3, 0, 1) ** 3
    # u is held, which is half a sample late, and zeros of sampling are another half.
    np.testing.assert_allclose(
        element.answer(element.inverse(x, DT), DT), x, atol=0.02 if sampled else 0.012
    )
    assert element.inverse(x[:, 0], DT).shape == x[:, 0].shape


@pytest.mark.parametrize("text", ["(s-1)/(s(s+1))", "s/(s+1)^2", "(s^2+1)/(s+1)^3"])
def test_zeros_without_a_stable_inverse_are_refused(text):
    with pytest.raises(ValueError, match="has a zero at"):
        ControlledElement(text).inverse(np.ones(3), DT)


def test_systems_of_scipy_and_of_python_control():
    expected = LinearElement((1.0,), (1.0, 1.0, 0.0))
    state_space = [[0.0, 1.0], [0.0, -1.0]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]]
    control = SimpleNamespace(num=[[np.array([1.0])]], den=[[np.array([1.0, 1.0, 0.0])]], dt=0)
    given = [
        signal.TransferFunction([1], [1, 1, 0]),
        signal.ZerosPolesGain([], [0, -1], 1),
        signal.StateSpace(*state_space),
        control,
        SimpleNamespace(**dict(zip("ABCD", map(np.array, state_space), strict=True)), dt=None),
    ]
    for element in map(LinearElement.of, given):
        np.testing.assert_allclose(element.numerator, expected.numerator)
        np.testing.assert_allclose(element.denominator, expected.denominator)
    discrete = LinearElement.of(signal.dlti([0.01], [1, -1], dt=0.01))
    assert discrete == ControlledElement("0.01/(z-1)", dt=0.01)
    with pytest.raises(ValueError, match="sampling time"):
        LinearElement.of(signal.dlti([0.01], [1, -1]))
    with pytest.raises(ValueError, match="2 inputs"):
        LinearElement.of(signal.StateSpace(np.eye(2), np.eye(2), np.ones((1, 2)), np.zeros((1, 2))))
    with pytest.raises(TypeError, match=r"1/s.*got 3"):
        LinearElement.of(3)


def test_it_goes_where_a_controlled_element_goes():
    omega = np.array([0.5, 2.0])
    same = LinearElement.of(ControlledElement(90.0, 6.0))
    np.testing.assert_allclose(
        same.frequency_response(omega), ControlledElement(90.0, 6.0).frequency_response(omega)
    )
    loop = FrequencyResponse.of(HumanOperator(), omega) * same
    assert loop.output == "x"
    assert crossover(HumanOperator(), same) == crossover(
        HumanOperator(), ControlledElement(90.0, 6.0)
    )
