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
TABLE_G1 = {  # K_n for P_n = 0.05, 0.10 ... 0.30: C1, C2
    1: (
        (0.006, 0.009, 0.011, 0.013, 0.015, 0.018),
        (0.013, 0.020, 0.026, 0.032, 0.039, 0.046),
    ),
    2: (
        (0.008, 0.012, 0.016, 0.019, 0.023, 0.026),
        (0.019, 0.029, 0.039, 0.051, 0.066, 0.091),
    ),
    3: (
        (0.010, 0.014, 0.018, 0.022, 0.026, 0.031),
        (0.022, 0.034, 0.047, 0.063, 0.088, 0.150),
    ),
    4: (
        (0.010, 0.015, 0.020, 0.024, 0.029, 0.034),
        (0.024, 0.038, 0.053, 0.073, 0.110, 0.339),
    ),
    "nm": (
        (0.006, 0.009, 0.011, 0.013, 0.016, 0.018),
        (0.013, 0.020, 0.026, 0.033, 0.040, 0.050),
    ),
}

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
    assert value != replace(value, **different(value))


def different(value):
    name = next(iter(value.__dataclass_fields__))
    if isinstance(value, Remnant):
        return {"order": 3}
    if isinstance(value, Multisine):
        return {"phases": (0.0, 0.6)}
    if isinstance(value, CompensatoryTask):
        return {"duration": 10.0}
    return {name: "another" if name == "name" else ControlledElement(1.0).K_c}


@each(VALUES)
def test_values_are_frozen(value):
    name = next(iter(value.__dataclass_fields__))
    with pytest.raises(AttributeError):
        setattr(value, name, 1.0)


@each(VALUES[:11])
def test_representation_makes_the_value_again(value):
    assert eval(repr(value)) == value


def test_representations_are_without_noise():
    assert repr(ControlledElement()) == "ControlledElement(K_c=90.0, omega_b=6.0)"
    assert repr(HumanOperator(K_edot=0.05, K_t=0.1)) == (
        "HumanOperator(K_e=0.09, K_edot=0.05, tau_e=0.28, omega_nm=11.25, zeta_nm=0.35, K_t=0.1)"
    )
    assert repr(Remnant(gain=0.02)) == "Remnant(order=2, gain=0.02, time_constant=0.06)"
    assert repr(Remnant(order="nm", intensity=0.1)) == (
        "Remnant(order='nm', intensity=0.1, omega_nm=11.25, zeta_nm=0.35)"
    )
    assert repr(Sigmoid(0, 1, rate=2, time=3)) == "Sigmoid(initial=0, final=1, rate=2, time=3)"


def test_lists_make_the_same_multisine_as_tuples():
    listed = Multisine([1, 4], np.array([1.0, 2.0]), [0.0, 0.5], 30.0)
    assert listed == VALUES[10]
    assert hash(listed) == hash(VALUES[10])


# What is refused

SENSELESS = [-0.1, np.nan, np.inf, -np.inf, True, "0.1", None, [0.1], np.array([0.1])]


@pytest.mark.parametrize("number", SENSELESS, ids=repr)
@pytest.mark.parametrize(
    ("kind", "name", "options"),
    [
        (ControlledElement, "K_c", {}),
        (ControlledElement, "omega_b", {}),
        *[(HumanOperator, name, {}) for name in ("K_e", "tau_e", "omega_nm", "zeta_nm")],
        (Remnant, "gain", {}),
        (Remnant, "intensity", {}),
        *[(Remnant, name, {"gain": 1.0}) for name in ("time_constant", "omega_nm", "zeta_nm")],
        (Sigmoid, "rate", {"initial": 0, "final": 1, "time": 0}),
        *[(CompensatoryTask, name, {}) for name in ("duration", "sampling_rate", "run_in")],
    ],
)
def test_senseless_numbers(kind, name, options, number):
    if number is None and (kind is Remnant or name == "run_in"):
        number = "none"
    with pytest.raises(ValueError, match=f"{kind.__name__}: {name} must be "):
        kind(**options, **{name: number})


@pytest.mark.parametrize("number", [np.nan, np.inf, True, "1", None], ids=repr)
@pytest.mark.parametrize(
    ("kind", "name", "options"),
    [
        *[(HumanOperator, name, {}) for name in ("K_t", "K_tdot", "K_x", "K_xdot")],
        *[
            (Sigmoid, n, {"initial": 0, "final": 1, "rate": 1, "time": 0})
            for n in ("initial", "final", "time")
        ],
        (Step, "time", {"initial": 0, "final": 1}),
        (Ramp, "end", {"initial": 0, "final": 1, "start": 0}),
    ],
)
def test_numbers_that_may_be_negative(kind, name, options, number):
    with pytest.raises(ValueError, match=f"{kind.__name__}: {name} must be a finite number"):
        kind(**(options | {name: number}))


@pytest.mark.parametrize("name", ["omega_nm", "zeta_nm"])
def test_muscle_is_positive(name):
    with pytest.raises(ValueError, match=f"HumanOperator: {name} must be positive; got 0"):
        HumanOperator(**{name: 0.0})


def test_zero_is_allowed_where_it_makes_sense():
    HumanOperator(K_e=0.0, T_L=0.0, tau_e=0.0)
    ControlledElement(K_c=0, omega_b=0)
    Remnant(gain=0.0)
    Remnant(intensity=0)


def test_lead_is_given_once():
    with pytest.raises(ValueError, match=r"give T_L or K_edot = K_e T_L, not both; got T_L=0.4"):
        HumanOperator(T_L=0.4, K_edot=0.04)
    with pytest.raises(ValueError, match=r"HumanOperator: T_L must be zero or positive"):
        HumanOperator(T_L=-1.0)
    with pytest.raises(ValueError, match=r"HumanOperator: K_edot must be zero or positive"):
        HumanOperator(K_edot=-1.0)
    with pytest.raises(ValueError, match="tau_e is a constant"):
        HumanOperator(tau_e=lambda t: 0.2)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "give either intensity .* or gain"),
        ({"intensity": 0.1, "gain": 0.1}, "got intensity=0.1 and gain=0.1"),
        ({"intensity": 15}, "15 percent is 0.15"),
        ({"intensity": 1.0}, "below 1; got 1.0"),
        ({"gain": 0.1, "order": 5}, "order is 1, 2, 3, 4 or 'nm'; got 5"),
        ({"gain": 0.1, "order": "NM"}, "got 'NM'"),
        ({"gain": 0.1, "order": 0}, "got 0"),
    ],
)
def test_senseless_remnants(options, message):
    with pytest.raises(ValueError, match=message):
        Remnant(**options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"multiples": (0,)}, r"at least 1, .*; got \(0,\)"),
        ({"multiples": (1.5,)}, r"whole numbers of the base frequency .*got \(1.5,\)"),
        ({"amplitudes": (np.nan,)}, "amplitudes must be finite numbers"),
        ({"phases": (np.inf,)}, "phases must be finite numbers"),
        ({"phases": ()}, r"phases must be finite numbers; got \(\)"),
        ({"phases": (1.0, 2.0)}, "as many; got 1, 1 and 2"),
        ({"period": 0.0}, "period must be positive, in s; got 0.0"),
        ({"period": np.nan}, "period must be positive"),
    ],
)
def test_senseless_multisines(options, message):
    one_line = {"multiples": (3,), "amplitudes": (1.0,), "phases": (0.0,)}
    with pytest.raises(ValueError, match="Multisine: .*" + message):
        Multisine(**(one_line | options))


def test_a_line_cannot_occur_twice():
    with pytest.raises(ValueError, match=r"a multiple occurs twice in \(2, 2\)"):
        Multisine((2, 2), (1.0, 1.0), (0.0, 0.0))


# Frequency responses


@pytest.mark.parametrize(("K_c", "omega_b"), [(90.0, 6.0), (30.0, 0.2), (5.0, 0.0)])
def test_controlled_element_response(K_c, omega_b):
    _, expected = freqs([K_c], [1.0, omega_b, 0.0], OMEGA)
    found = ControlledElement(K_c, omega_b).frequency_response(OMEGA)
    np.testing.assert_allclose(found, expected, rtol=1e-13)


def test_controlled_element_response_at_zero_is_infinite():
    assert np.isinf(np.abs(ControlledElement().frequency_response(0.0)))


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
    remnant = Remnant(order=order, gain=0.3, time_constant=0.1, omega_nm=8.0, zeta_nm=0.4)
    if order == "nm":
        _, expected = freqs([0.3 * 64], [1.0, 6.4, 64.0], OMEGA)
    else:
        _, expected = freqs([0.3], np.poly([-10.0] * order) / 10.0**order, OMEGA)
    np.testing.assert_allclose(remnant.frequency_response(OMEGA), expected, rtol=1e-12)
    q = remnant.filter_coefficients()
    A = np.array([[q[0], q[1], 0, 0], [q[3], q[4], 0, 0], [0, q[5], -q[5], 0], [0, 0, q[5], -q[5]]])
    for omega, H in zip(OMEGA, expected, strict=True):
        states = np.linalg.solve(1j * omega * np.eye(4) - A, [0.3 * q[2], 0, 0, 0])
        assert q[6:] @ states == pytest.approx(H, rel=1e-12)


@pytest.mark.parametrize("t", [0.0, 40.0, 41.5, 80.0])
def test_responses_of_what_varies_are_those_of_the_frozen(t):
    condition = tracking_condition("C3")
    for value in (condition.operator, condition.controlled_element):
        np.testing.assert_array_equal(
            value.frequency_response(OMEGA, t), value.at(t).frequency_response(OMEGA)
        )
    gain = Sigmoid(0.1, 0.3, rate=0.5, time=40.96)
    np.testing.assert_allclose(
        Remnant(gain=gain).frequency_response(OMEGA, t),
        Remnant(gain=float(gain(t))).frequency_response(OMEGA),
    )
    frozen = condition.operator.at(t)
    assert frozen.rate_gain == frozen.K_edot == pytest.approx(float(condition.operator.K_edot(t)))


def test_response_without_a_gain():
    with pytest.raises(ValueError, match=r"has no gain yet: tune_remnant\(task\)"):
        Remnant(intensity=0.1).frequency_response(OMEGA)


def test_rate_gain():
    assert HumanOperator(K_e=0.09, T_L=0.4).rate_gain == 0.036
    varying = HumanOperator(K_e=Ramp(0.1, 0.2, 0, 1), T_L=Step(1.0, 2.0, 0.5))
    t = np.array([0.0, 0.25, 0.5, 1.0])
    K_e, K_edot = varying.gains(t)
    np.testing.assert_allclose(K_e, [0.1, 0.125, 0.15, 0.2])
    np.testing.assert_allclose(K_edot, [0.1, 0.125, 0.3, 0.4])


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


def test_a_sigmoid_is_the_mixture_of_its_ends():
    t = np.linspace(0, 10, 50)
    weight = Sigmoid(0, 1, rate=2.0, time=5.0)
    np.testing.assert_allclose(
        Mixture(90.0, 30.0, weight)(t), Sigmoid(90, 30, rate=2.0, time=5.0)(t), rtol=1e-13
    )


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


@pytest.mark.parametrize("name", list(TRANSITIONS))
def test_conditions_are_mixtures(name):
    begin, end, G = TRANSITIONS[name]
    weight = Sigmoid(0, 1, rate=G, time=40.96)
    assert mixed_condition(begin, end, weight, name) == tracking_condition(name)
    mirrored = mixed_condition(end, begin, Sigmoid(1, 0, rate=G, time=40.96), name)
    t = np.linspace(30, 50, 41)
    np.testing.assert_allclose(
        mirrored.controlled_element.K_c(t), tracking_condition(name).controlled_element.K_c(t)
    )


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


@pytest.mark.parametrize("weight", [-0.1, 1.1, np.nan])
def test_senseless_weights(weight):
    with pytest.raises(ValueError, match="weight is from 0 to 1"):
        mixed_condition("C1", "C2", weight)


def test_delays_cannot_be_mixed():
    quick = Condition("quick", ControlledElement(), HumanOperator(tau_e=0.2))
    with pytest.raises(ValueError, match=r"C1 has tau_e = 0.28 s and quick 0.2 s"):
        mixed_condition("C1", quick, 0.5)


@pytest.mark.parametrize(
    ("name", "hint"),
    [("C7", "C6"), ("C 4", "C4"), (4, "C4"), ("condition C2", None), ("foo", None), (None, None)],
)
def test_unknown_conditions(name, hint):
    with pytest.raises(ValueError, match=r"Unknown condition .*C1, C2, C3, C4, C5, C6") as caught:
        tracking_condition(name)
    if hint:
        assert str(caught.value).endswith(f"Did you mean {hint!r}?")


def test_case_of_names_does_not_matter():
    assert tracking_condition("c4") == tracking_condition("C4")
    assert tracking_condition("c4").name == "C4"
    assert Remnant.from_table("c4", 0.15) == Remnant.from_table("C4", 0.15)


# Multisines


def test_target_of_the_thesis():
    f_t = Multisine()
    f = f_t(np.arange(8192) / 100)
    assert np.var(f, ddof=1) == pytest.approx(2.2490040366255646, abs=5e-5)  # ft.variance_deg2
    assert f_t.crest_factor() == pytest.approx(2.6930107053410755, abs=5e-5)  # ft.crest_factor
    assert np.mean(f) == pytest.approx(0.0, abs=1e-12)
    spectrum = np.abs(np.fft.rfft(f)) / 4096
    np.testing.assert_allclose(spectrum[list(f_t.multiples)], f_t.amplitudes, rtol=1e-10)
    assert np.delete(spectrum, f_t.multiples).max() < 1e-12
    np.testing.assert_allclose(
        f_t.omega,
        [0.230, 0.383, 0.614, 0.997, 1.687, 2.608, 4.065, 6.596, 10.661, 17.564],
        atol=5e-4,
    )


@settings(max_examples=40, deadline=None)
@given(
    st.integers(-20_000, 20_000),
    st.integers(1, 3000),
    st.sampled_from([50.0, 100.0, 99.7, 1000.0]),
    st.sampled_from([81.92, 1.7, 3.0, 2.345678]),
)
def test_samples_are_values(first, n_samples, rate, period):
    f = Multisine((1, 3), (1.0, 0.5), (0.2, 1.0), period)
    expected = f(np.arange(first, first + n_samples) / rate)
    np.testing.assert_allclose(f.sample(first, n_samples, rate), expected, rtol=0, atol=1e-9)


def test_samples_repeat_exactly():
    f = Multisine().sample(-8192, 3 * 8192, 100.0)
    np.testing.assert_array_equal(f[:8192], f[8192:16384])
    np.testing.assert_array_equal(f[:8192], f[16384:])


def test_shapes_of_values():
    f = Multisine()
    assert np.ndim(f(1.0)) == 0
    assert f(np.zeros((3, 4))).shape == (3, 4)
    np.testing.assert_allclose(f([[0.0], [1.0]]), [[f(0.0)], [f(1.0)]])


def test_random_phases():
    f = Multisine()
    one, same, other = (f.with_random_phases(seed) for seed in (0, 0, 1))
    assert one == same
    assert one != other
    assert (one.multiples, one.amplitudes, one.period) == (f.multiples, f.amplitudes, f.period)
    phases = np.concatenate([f.with_random_phases(seed).phases for seed in range(400)])
    assert np.abs(phases).max() <= np.pi
    # 4000 draws: mean resultant length below 4 sigma, sigma = 1 / sqrt(4000).
    assert np.abs(np.exp(1j * phases).mean()) < 4 / np.sqrt(4000)


def test_random_phases_with_a_crest_factor():
    for seed in range(5):
        drawn = Multisine().with_random_phases(seed, max_crest_factor=2.4)
        assert drawn.crest_factor() <= 2.4
    with pytest.raises(ValueError, match=r"crest factor of 1.2 or less; the lowest is \d.\d\d"):
        Multisine().with_random_phases(0, max_crest_factor=1.2)


def test_crest_factor_of_one_line():
    line = Multisine((2,), (3.0,), (0.3,), 10.0)
    assert line.crest_factor(1000.0) == pytest.approx(np.sqrt(2), rel=1e-5)


@pytest.mark.parametrize("offset", [1, -1, 4])
def test_interleaved(offset):
    if offset == -1:
        f = Multisine((3, 8, 20), (1.0, 2.0, 3.0), (0.0, 0.0, 0.0))
    else:
        f = Multisine((3, 9, 20), (1.0, 2.0, 3.0), (0.0, 0.0, 0.0))
    second = f.interleaved(offset=offset, scale=0.5, random_state=3)
    assert second.multiples == tuple(n + offset for n in f.multiples)
    assert second.amplitudes == (0.5, 1.0, 1.5)
    assert second == f.interleaved(offset=offset, scale=0.5, random_state=3)
    t = np.arange(8192) / 100
    assert np.dot(f(t), second(t)) == pytest.approx(0.0, abs=1e-8)


@pytest.mark.parametrize(("offset", "shared"), [(2, r"\[5\]"), (0, r"\[3, 5, 8")])
def test_interleaved_lines_that_coincide(offset, shared):
    with pytest.raises(ValueError, match=f"offset={offset} the lines {shared}"):
        Multisine().interleaved(offset=offset)


# Table G.1


@pytest.mark.parametrize("order", list(TABLE_G1))
@pytest.mark.parametrize("column", range(6))
def test_gains_of_the_table(order, column):
    P_n = (0.05, 0.10, 0.15, 0.20, 0.25, 0.30)[column]
    gains = {state: TABLE_G1[order][i][column] for i, state in enumerate(("C1", "C2"))}
    for state, gain in gains.items():
        assert Remnant.from_table(state, P_n, order) == Remnant(order=order, gain=gain)
    for name, (begin, end, G) in TRANSITIONS.items():
        expected = Sigmoid(gains[begin], gains[end], rate=G, time=40.96)
        assert Remnant.from_table(name, P_n, order).gain == expected


@pytest.mark.parametrize("options", [{"intensity": 0.12}, {"intensity": 0.0}, {"order": 5}])
def test_what_the_table_does_not_have(options):
    with pytest.raises(ValueError, match=r"Table G.1 has the orders .*got order="):
        Remnant.from_table("C1", **({"intensity": 0.15} | options))


# Tasks


def test_task_of_a_condition():
    task = CompensatoryTask.of_condition("C2", duration=10.0, operator=HumanOperator(K_e=0.05))
    assert task.controlled_element == ControlledElement(30.0, 0.2)
    assert task.operator.K_e == 0.05
    own = Condition("mine", ControlledElement(1.0), HumanOperator(tau_e=0.1))
    assert CompensatoryTask.of_condition(own).operator == own.operator
    assert CompensatoryTask.of_condition("C1") == CompensatoryTask()


@pytest.mark.parametrize(
    ("duration", "run_in", "rate", "n_samples", "n_run_in"),
    [
        (81.92, None, 100.0, 8192, 57344),
        (81.92, None, 48.0, 3932, 27524),
        (1.0, 0.0, 100.0, 100, 0),
        (0.999, 0.5, 100.0, 99, 50),
        (10.0, 0.25, 64.0, 640, 16),
    ],
)
def test_numbers_of_samples(duration, run_in, rate, n_samples, n_run_in):
    task = CompensatoryTask(duration=duration, run_in=run_in, sampling_rate=rate)
    assert (task.n_samples, task.n_run_in) == (n_samples, n_run_in)
    record = task.simulate()
    assert record.u.shape == (1, n_samples)
    np.testing.assert_array_equal(record.time, np.arange(n_samples) / rate)


def test_task_at_an_instant():
    task = CompensatoryTask.of_condition("C4", duration=50.0)
    assert task.at(0.0).controlled_element == ControlledElement(90.0, 6.0)
    late = task.at(50.0)
    assert late.operator.K_edot == pytest.approx(0.084)
    assert late.controlled_element.K_c == pytest.approx(30.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"display": np.nan}, "display must be a finite number; got nan"),
        ({"display": True}, "display must be a finite number; got True"),
        ({"display": "pursuite"}, "display is 'compensatory', 'pursuit', .*got 'pursuite'"),
        ({"transport": "hold"}, "transport is 'held', 'interpolated' or None; got 'hold'"),
        ({"duration": 0.005}, "0.005 s at 100.0 Hz are fewer than two samples"),
        ({"duration": 0.2, "run_in": 0.05}, "delay tau_e = 0.28 s is longer than the run of 0.2"),
        (
            {"operator": HumanOperator(tau_e=0.285), "transport": "held"},
            "is 28.5 samples at 100 Hz",
        ),
        ({"operator": HumanOperator(tau_e=0.005)}, "less than one sample at 100 Hz"),
        (
            {"operator": HumanOperator(tau_e=0.0), "transport": "interpolated"},
            "less than one sample",
        ),
    ],
)
def test_senseless_tasks(options, message):
    with pytest.raises(ValueError, match="CompensatoryTask: .*" + message):
        CompensatoryTask(**options)


@pytest.mark.parametrize(
    ("options", "what"),
    [
        ({"sampling_rate": 10.0}, r"neuromuscular mode \(omega_nm, zeta_nm\) of 11.25 rad/s"),
        ({"operator": HumanOperator(omega_nm=60.0)}, r"neuromuscular mode .* of 60 rad/s"),
        (
            {"controlled_element": ControlledElement(1.0, 100.0)},
            r"controlled element \(omega_b\) of 100 rad/s",
        ),
        ({"remnant": Remnant(gain=0.1, time_constant=0.01)}, "remnant filter of 100 rad/s"),
        ({"remnant": Remnant(order="nm", gain=0.1, omega_nm=90.0)}, "remnant filter of 90 rad/s"),
    ],
)
def test_sampling_that_is_too_slow(options, what):
    with pytest.raises(ValueError, match="Hz is too slow for the " + what) as caught:
        CompensatoryTask(**options)
    advised = float(str(caught.value).split("sampling_rate=")[1].split(" ")[0])
    CompensatoryTask(**(options | {"sampling_rate": advised}))
    with pytest.raises(ValueError, match="too slow"):
        CompensatoryTask(**(options | {"sampling_rate": 0.9 * advised}))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"controlled_element": ControlledElement(lambda t: 2 - t)},
            r"K_c is -0.005 at t = 2.005 s",
        ),
        ({"operator": HumanOperator(K_e=Step(0.1, -0.1, 1.0))}, "K_e is -0.1 at t = 1 s"),
        ({"operator": HumanOperator(T_L=Step(-0.5, 0.4, 0.0))}, r"T_L is -0.5 at t = -0.0\d s"),
        ({"operator": HumanOperator(K_edot=lambda t: np.nan)}, "K_edot is nan at t = -0.5 s"),
        ({"operator": HumanOperator(zeta_nm=Step(0.3, -0.3, 2))}, "zeta_nm is -0.3 at t = 2 s"),
        ({"operator": HumanOperator(K_x=lambda t: np.inf)}, "K_x is inf .* must be finite, in"),
        ({"remnant": Remnant(gain=Step(0.1, -0.1, 2))}, "K_n is -0.1 at t = 2 s"),
        ({"display": Ramp(1, -1, 0, 2)}, "display is -0.005 at t = 1.005 s"),
        ({"target": lambda t: np.where(t < 1, 0.0, np.nan)}, "target is nan at t = 1 s"),
        ({"target": np.zeros(7)}, r"target must have 350 samples \(50 of the run-in and 300 of"),
        ({"disturbance": np.zeros(7)}, "disturbance must have 350 samples"),
    ],
)
def test_senseless_functions_of_time(options, message):
    task = CompensatoryTask(**({"duration": 3.0, "run_in": 0.5} | options))
    with pytest.raises(ValueError, match=message):
        task.simulate()


@pytest.mark.parametrize("operator", [None, "me", 3.0, ControlledElement()], ids=repr)
def test_what_is_not_an_operator(operator):
    with pytest.raises(TypeError, match=r"CompensatoryTask.*operator.*fitted ARX.*; got"):
        CompensatoryTask(operator=operator, duration=1.0).simulate()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"n_runs": 0}, "n_runs is a whole number, at least 1; got 0"),
        ({"n_runs": True}, "n_runs is a whole number, at least 1; got True"),
        ({"n_runs": 2.0}, "n_runs is a whole number, at least 1; got 2.0"),
        ({"keep_run_in": 0.6}, "keep_run_in is from 0 to the run-in of 0.5 s; got 0.6"),
        ({"keep_run_in": -0.1}, "keep_run_in is from 0"),
        ({"noise": np.zeros((2, 150))}, r"a row for each of 1 runs and .* 150 .*; got \(2, 150\)"),
        ({"noise": np.full((1, 150), np.nan)}, "noise is nan in run 0, sample 0"),
        ({"random_state": -1}, "random_state is a whole number from 0 up, .*; got -1"),
        ({"random_state": "0"}, "got '0'"),
        ({"random_state": True}, "got True"),
    ],
)
def test_senseless_arguments_of_simulate(options, message):
    task = CompensatoryTask(duration=1.0, run_in=0.5, remnant=Remnant(gain=0.02))
    with pytest.raises(ValueError, match=message):
        task.simulate(**options)


def test_phases_of_a_function_cannot_be_drawn():
    task = CompensatoryTask(duration=1.0, run_in=0.5, disturbance=lambda t: 0 * t)
    with pytest.raises(
        ValueError, match="draws phases of a Multisine; the disturbance is function"
    ):
        task.simulate(random_phases=True)


def test_remnant_of_unknown_gain_cannot_be_simulated():
    with pytest.raises(ValueError, match="is not known yet: tune_remnant"):
        CompensatoryTask(remnant=Remnant(intensity=0.1)).simulate()


@pytest.mark.parametrize(
    "operator",
    [
        HumanOperator(zeta_nm=20.0),
        HumanOperator(omega_nm=lambda t: 400.0 + 0 * t),
        HumanOperator(zeta_nm=lambda t: np.where(t < 0.5, 0.35, 20.0)),
    ],
    ids=["overdamped", "function", "in between"],
)
def test_fast_muscles_need_a_faster_clock(operator):
    with pytest.raises(ValueError, match="100 Hz is too slow for the neuromuscular mode"):
        CompensatoryTask(operator=operator, duration=1.0, run_in=0.0).simulate()


@pytest.mark.parametrize("order", [2.0, True, [2], 0, "NM"])
def test_remnant_orders_that_are_none(order):
    with pytest.raises(ValueError, match="order is 1, 2, 3, 4 or 'nm'"):
        Remnant(order=order, gain=0.1)


def test_lines_above_nyquist_are_refused():
    with pytest.raises(ValueError, match="not below Nyquist"):
        Multisine(multiples=[6000], amplitudes=[1], phases=[0]).sample(0, 100, 100.0)


def test_functions_of_time_must_take_arrays():
    def scalar_only(t):
        return 0.09 if t < 10 else 0.08

    for function in (scalar_only, lambda t: t[:3]):
        operator = HumanOperator(K_e=function)
        with pytest.raises(ValueError, match="must take an array of instants"):
            CompensatoryTask(operator=operator, duration=1.0, run_in=0.0).simulate()


def test_the_default_target_has_a_short_name():
    assert repr(Multisine()) == "Multisine()"
    assert "period=40.0" in repr(Multisine(period=40.0))


@pytest.mark.parametrize("name", ["e", "f_t", "x"])
def test_responses_of_a_pursuit_operator(name):
    operator = HumanOperator(K_e=0.07, K_edot=0.03, K_t=0.02, K_tdot=0.01, K_x=-0.03, K_xdot=-0.02)
    gains = {"e": (0.07, 0.03), "f_t": (0.02, 0.01), "x": (-0.03, -0.02)}[name]
    alone = HumanOperator(K_e=1.0, T_L=0.0).frequency_response(OMEGA)
    expected = (gains[0] + gains[1] * 1j * OMEGA) * alone
    np.testing.assert_allclose(operator.frequency_response(OMEGA, input=name), expected)
    with pytest.raises(ValueError, match="input is 'e', or 'f_t' or 'x'"):
        operator.frequency_response(OMEGA, input="q")
