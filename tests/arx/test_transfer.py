"""Transfer functions of other libraries against skhoid's own free run."""

import numpy as np
import pytest
from scipy import signal

from skhoid import ARXRegressor


def fitted(n_inputs, **options):
    rng = np.random.default_rng(3)
    X = rng.standard_normal((400, n_inputs))
    y = signal.lfilter([0, 0, 0.3, 0.2], [1, -1.2, 0.5], X[:, 0])
    if n_inputs == 2:
        y = y + signal.lfilter([0.1, 0.0, 0.7], [1, -1.2, 0.5], X[:, 1])
    y += 0.01 * rng.standard_normal(400)
    return ARXRegressor(dt=0.05, **options).fit(X, y), X


def test_scipy_simulates_the_same():
    model, X = fitted(1, na=2, nb=2, nk=2)
    system = model.to_transfer_function()
    assert system.dt == 0.05
    _, response = signal.dlsim(system, X[:, 0])
    np.testing.assert_allclose(response.ravel(), model.predict(X), atol=1e-10)


def test_several_inputs_are_a_dict_by_input():
    model, X = fitted(2, na=2, nb=[2, 3], nk=[2, 0])
    systems = model.to_transfer_function()
    assert list(systems) == model.inputs_ == ["x0", "x1"]
    parts = [signal.dlsim(system, X[:, i])[1].ravel() for i, system in enumerate(systems.values())]
    np.testing.assert_allclose(sum(parts), model.predict(X), atol=1e-10)


def test_python_control_agrees_at_all_frequencies():
    control = pytest.importorskip("control")
    model, _ = fitted(2, na=2, nb=[2, 3], nk=[2, 0])
    system = model.to_transfer_function("control")
    assert isinstance(system, control.TransferFunction)
    assert system.dt == 0.05
    assert system.input_labels == ["x0", "x1"]
    omega = np.array([0.5, 3.0, 20.0])
    for i, other in enumerate(model.to_transfer_function().values()):
        _, expected = signal.dfreqresp(other, omega * 0.05)
        np.testing.assert_allclose(system(np.exp(1j * omega * 0.05))[0, i], expected, rtol=1e-9)


CONTINUOUS = {
    "first order": ([2.0], [0.5, 1.0], 0.1, 0.0),
    "delayed": ([2.0], [0.5, 1.0], 0.05, 0.4),
    "resonant": ([1.0, 9.0], [1.0, 1.8, 9.0], 0.1, 0.2),
    "integral": ([0.7], [1.0, 0.0], 0.2, 0.0),
    "double integral": ([0.7], [1.0, 0.0, 0.0], 0.1, 0.1),
    "unstable": ([1.0], [1.0, -0.5], 0.1, 0.0),
    "third order": ([1.0, 2.0], [1.0, 3.0, 4.0, 2.0], 0.02, 0.0),
    "slow, in minutes": ([1.5], [600.0, 1.0], 60.0, 120.0),
}


@pytest.mark.parametrize("name", CONTINUOUS)
def test_continuous_time_is_what_was_sampled(name):
    num, den, dt, delay = CONTINUOUS[name]
    b, a, _ = signal.cont2discrete((num, den), dt)
    na, nk = a.size - 1, 1 + round(delay / dt)
    u = np.random.default_rng(0).standard_normal(300)
    y = signal.lfilter(np.r_[np.zeros(nk - 1), b.ravel()], a, u)
    model = ARXRegressor(na, na, nk, dt=dt).fit(u[:, None], y)
    system, late = model.to_transfer_function(continuous=True)
    assert late == pytest.approx(delay)
    s = 1j * np.array([0.01, 0.3, 1.0]) / dt
    found = np.polyval(system.num, s) / np.polyval(system.den, s)
    np.testing.assert_allclose(found, np.polyval(num, s) / np.polyval(den, s), rtol=1e-5)


def test_continuous_time_of_an_input_that_acts_at_once():
    b, a, _ = signal.cont2discrete(([2.0, 3.0], [1.0, 4.0]), 0.1)
    u = np.random.default_rng(0).standard_normal((200, 2))
    y = signal.lfilter(b.ravel(), a, u[:, 0]) + signal.lfilter([0, 0, 0, 0.5], a, u[:, 1])
    model = ARXRegressor(1, [2, 1], [0, 3], dt=0.1).fit(u, y)
    found = model.to_transfer_function(continuous=True)
    assert list(found) == ["x0", "x1"]
    np.testing.assert_allclose(found["x0"][0].num, [2.0, 3.0], rtol=1e-6)
    np.testing.assert_allclose(found["x0"][0].den, [1.0, 4.0], rtol=1e-6)
    assert [delay for _, delay in found.values()] == pytest.approx([0.0, 0.2])
    control = pytest.importorskip("control")
    system, _ = model.to_transfer_function("control", continuous=True)["x0"]
    assert isinstance(system, control.TransferFunction)
    assert system.isctime()


def test_what_has_no_continuous_time_says_so():
    u = np.random.default_rng(0).standard_normal(200)
    y = signal.lfilter([0, 1.0], [1, 0.5], u)
    with pytest.raises(ValueError, match=r"pole at z = -0\.5 has no counterpart"):
        ARXRegressor(1, 1, 1, dt=0.1).fit(u[:, None], y).to_transfer_function(continuous=True)
    model, _ = fitted(1, na=1, nb=3, nk=1)
    with pytest.raises(ValueError, match="nb = 3 input coefficients with na = 1"):
        model.to_transfer_function(continuous=True)
