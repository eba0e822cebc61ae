"""The controlled element estimated in closed loops: form, constants, timing of the input."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from skhoid import ControlledElement, LinearElement
from skhoid.effects.record import Record
from skhoid.greybox.element import element_estimate
from skhoid.greybox.element_timing import given_element

PERIOD = 20.0  # s


def sines(rng, t, multiples, runs):
    phase = rng.uniform(0, 2 * np.pi, (len(multiples), 1, runs))
    omega = 2 * np.pi * np.array(multiples)[:, None, None] / PERIOD
    return (np.sin(omega * t[:, None] + phase) / (1 + (omega / np.pi) ** 2)).sum(axis=0)


def tracked(text, *, rate=60, direct=False, seed=0, runs=5, disturbance=0.6, remnant=0.2):
    """Runs of 43 s of someone who answers the error, in a loop with a disturbance."""
    rng = np.random.default_rng(seed)
    element = replace(LinearElement.of(text), direct=direct)
    dt, n, late = 1 / rate, round(43 * rate), round(0.2 * rate)
    t = np.arange(n) * dt
    target = sines(rng, t, [2, 5, 11, 17, 29, 41], runs)
    moved = disturbance * sines(rng, t, [3, 7, 13, 19, 31], runs)
    noise = lfilter(
        [8 * dt / 0.15], [1, -np.exp(-dt / 0.15)], rng.standard_normal((n, runs)), axis=0
    )
    gain, slope = 2.2 / element.numerator[0], element.denominator
    on_error = gain * (slope[1] if element.order == 2 else 1.0) + 0.6 * (text == "2/s^2")
    on_rate = gain if element.order == 2 else 0.0
    b, a = element.discrete(dt)
    e, u, x = np.zeros((3, n, runs))
    arm = np.zeros((2, runs))
    for k in range(n):
        if k > late:
            i = k - late
            command = on_error * e[i] + on_rate * (e[i] - e[i - 1]) / dt + remnant * noise[k]
            arm[1] += dt * (144.0 * (command - arm[0]) - 14.4 * arm[1])
            arm[0] += dt * arm[1]
        u[k] = arm[0]
        for i in range(min(k + 1, b.size)):
            x[k] += b[i] * (u + moved)[k - i] - (a[i] * x[k - i] if i else 0.0)
        e[k] = target[k] - x[k]
    known = np.ones((n, runs), dtype=bool)
    known[: 3 * rate] = False
    channels = {"e": e, "x": x, "f_t": target, "dist": moved}
    roles = dict(zip(channels, channels, strict=True))
    return Record(dt, t[:, None], channels, roles, ("e",), known, u)


def without(record, *names):
    channels = {k: v for k, v in record.channels.items() if k not in names}
    return replace(record, channels=channels, roles={k: k for k in channels}, _derived={})


@pytest.mark.parametrize(
    ("rate", "direct"),
    [
        (60, True),
        *(pytest.param(*case, marks=pytest.mark.slow) for case in [(60, False), (100, True)]),
    ],
)
@pytest.mark.parametrize(
    ("text", "constants", "within"),
    [
        ("1/s", [1.0], [0.05]),
        ("1/(s(s+1))", [1.0, 1.0], [0.07, 0.1]),
        ("2/s^2", [2.0], [0.2]),
        ("4/(s(s+2))", [4.0, 2.0], [0.8, 0.4]),
    ],
)
def test_a_hidden_disturbance_does_not_bias_it(text, constants, within, direct, rate):
    record = tracked(text, rate=rate, direct=direct, seed=int(direct))
    hidden = element_estimate(without(record, "dist"))
    assert hidden.instruments
    assert len(hidden.constants) == len(constants)
    assert (np.abs(hidden.constants - constants) < within).all()
    assert (np.abs(hidden.constants - constants) < 4 * hidden.sd).all()
    assert hidden.element.direct == direct
    known = element_estimate(record)
    np.testing.assert_allclose(known.constants, constants, rtol=2e-3)
    assert known.disturbance == "dist"


def test_fast_motion_tells_the_gain_without_the_target():
    """Least squares on integrals alone gives 0.86: u answers the disturbance."""
    blind = element_estimate(without(tracked("1/s"), "dist", "f_t"))
    assert not blind.instruments
    assert blind.constants[0] == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(
    "text", ["0.5", "3/(s+1)", "1/s", "2/s^2", pytest.param("90/(s(s+6))", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("dt", [1 / 60, 9.0])
def test_forms_in_an_open_loop(text, dt):
    """Of clocks as different as a stick's and a furnace's: its time runs with the clock."""
    rng = np.random.default_rng(3)
    true = LinearElement.of(text)
    b, a = true.discrete(1 / 60)
    target = lfilter([0.1], [1, -0.9], rng.standard_normal((2400, 3)), axis=0)
    u = lfilter([0.2], [1, -0.95], target, axis=0) + 0.05 * rng.standard_normal((2400, 3))
    x = lfilter(b, a, u, axis=0)
    x += 0.01 * x.std() * rng.standard_normal(x.shape)
    t = np.arange(2400)[:, None] * dt
    record = Record(
        dt, t, {"e": target - x, "x": x}, {"e": "e", "x": "x"}, ("e",), np.ones(x.shape, bool), u
    )
    found = element_estimate(record).element
    slower = dt * 60
    assert found.order == true.order
    omega = np.array([0.5, 2.0, 6.0])
    np.testing.assert_allclose(
        found.frequency_response(omega / slower), true.frequency_response(omega), rtol=0.05
    )


def test_what_does_not_answer_the_output_has_no_element():
    record = tracked("1/s", runs=2)
    rng = np.random.default_rng(1)
    walk = lfilter([1.0], [1.0, -0.99], rng.standard_normal(record.y.shape), axis=0)
    channels = {"e": record.channels["e"], "x": walk}
    assert element_estimate(replace(record, channels=channels, roles={"e": "e", "x": "x"})) is None
    assert element_estimate(without(record, "x")) is None


@pytest.mark.parametrize("direct", [False, True])
def test_a_given_element_gets_the_timing_of_the_data(direct):
    record = without(tracked("1/(s(s+1))", direct=direct, runs=2), "dist")
    assert given_element("1/(s(s+1))", record).direct == direct
    assert given_element(ControlledElement(1.0, 1.0), record).direct == direct
    # A wrong element says nothing about samples.
    assert not given_element("30/(s(s+1))", record).direct
