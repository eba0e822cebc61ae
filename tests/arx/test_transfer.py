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
