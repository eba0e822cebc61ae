"""The controlled element estimated in closed loops: form, constants, timing of the input."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter
from support.hidden_disturbance import tracked

from skhoid import ControlledElement, LinearElement
from skhoid.effects.record import Record
from skhoid.model.element import adopt_element, search_element


def without(record, *names):
    channels = {k: v for k, v in record.channels.items() if k not in names}
    return replace(record, channels=channels, roles={k: k for k in channels}, remembered={})


@pytest.mark.parametrize(
    ("text", "constants", "within"),
    [
        ("1/s", [1.0], [0.05]),
        ("2/s^2", [2.0], [0.2]),
        ("4/(s(s+2))", [4.0, 2.0], [0.8, 0.4]),
    ],
)
def test_a_hidden_disturbance_does_not_bias_it(text, constants, within):
    record = tracked(text, rate=60, direct=True, seed=1)
    hidden = search_element(without(record, "dist"))
    assert hidden.instruments
    assert len(hidden.constants) == len(constants)
    assert (np.abs(hidden.constants - constants) < within).all()
    assert (np.abs(hidden.constants - constants) < 4 * hidden.sd).all()
    assert hidden.element.direct
    known = search_element(record)
    np.testing.assert_allclose(known.constants, constants, rtol=2e-3)
    assert known.disturbance == "dist"


def test_fast_motion_tells_the_gain_without_the_target():
    """Least squares on integrals alone gives 0.86: u answers the disturbance."""
    blind = search_element(without(tracked("1/s"), "dist", "f_t"))
    assert not blind.instruments
    assert blind.constants[0] == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(
    ("text", "dt"), [("0.5", 1 / 60), ("3/(s+1)", 9.0), ("1/s", 1 / 60), ("2/s^2", 9.0)]
)
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
    found = search_element(record).element
    slower = dt * 60
    assert found.order == true.order
    omega = np.array([0.5, 2.0, 6.0])
    np.testing.assert_allclose(
        found.frequency_response(omega / slower), true.frequency_response(omega), rtol=0.05
    )


@pytest.mark.parametrize("x", [2.0, "parabola"])
def test_what_rests_has_no_element(x):
    record = tracked("1/s", runs=2)
    at_rest = record.t**2 - 1e3 if x == "parabola" else x
    channels = {"e": record.channels["e"], "x": np.zeros_like(record.y) + at_rest}
    assert search_element(replace(record, channels=channels, roles={"e": "e", "x": "x"})) is None


@pytest.mark.parametrize("direct", [False, True])
def test_a_given_element_gets_the_timing_of_the_data(direct):
    record = without(tracked("1/(s(s+1))", direct=direct, runs=2), "dist")
    assert adopt_element("1/(s(s+1))", record).direct == direct
    assert adopt_element(ControlledElement(1.0, 1.0), record).direct == direct
    # A wrong element says nothing about samples.
    assert not adopt_element("30/(s(s+1))", record).direct
