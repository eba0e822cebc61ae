"""Starts of fits in simulation: spread ones, those of a user; no fit is worse than its starts."""

import numpy as np
import pytest
from scipy.signal import lfilter

from skhoid import ARXRegressor, OperatorRegressor, SimulatedARX, make_tracking_runs
from skhoid.effects import Effect
from skhoid.model.arx_starts import find_arx_starts
from skhoid.model.fitting import Criterion
from skhoid.model.simulator import Effects, Simulator


class Magnitude(Effect):
    """A sensor that shows the size alone; it knows nothing of signs."""

    name = "magnitude"
    place = "output"

    def apply(self, signal, record):
        return np.abs(signal)


def stiff(seed):
    """Position to torque: acceleration, and slow noise that least squares of one step follow."""
    rng = np.random.default_rng(seed)
    x = lfilter([1.0], [1.0, -1.6, 0.7], rng.standard_normal(1500))
    y = lfilter([-40.0, 60.0, -22.0], [1.0, -1.2, 0.5], x)
    return x[:, None], y + lfilter([1.0], [1.0, -0.98], 6.0 * rng.standard_normal(1500))


def errors_of(prepared, thetas):
    simulator = Simulator(prepared.core, Effects([]), prepared.record)
    criterion = Criterion(prepared.record)
    return [criterion.sse(simulator.run(np.asarray(theta))) for theta in thetas]


def test_fit_is_never_worse_than_its_starts():
    X, y = stiff(0)
    model = SimulatedARX(2, 3, 0, dt=0.01, initial="rest")
    prepared = model.prepare(X, y)
    starts = find_arx_starts(prepared.core, prepared.record, prepared.record.input, 5)
    by_one_step = ARXRegressor(2, 3, 0, dt=0.01).fit(X, y).coef_
    fitted = model.first_fit(prepared)
    assert fitted.sse <= min(errors_of(prepared, [*starts, by_one_step]))
    # The likelihood weighs errors by the noise, and may not spoil the free run for it.
    done = model.set_params(effects="bias").fit(X, y)
    assert done.vaf_ >= 100 * (1 - 1.06 * fitted.sse / float(y @ y))


def test_map_that_hides_the_sign_is_fitted():
    rng = np.random.default_rng(0)
    u = np.repeat(rng.choice([-1.0, 1.0], 40), 8)
    y = np.abs(lfilter([0.0, 0.03, 0.03], [1.0, -1.85, 0.88], u))
    y += 0.02 * rng.standard_normal(y.size)
    model = SimulatedARX(2, 2, 1, dt=0.02, effects=Magnitude(), initial="rest")
    assert model.fit(u[:, None], y).vaf_ > 98.0
    np.testing.assert_allclose(model.a_, [-1.85, 0.88], atol=0.02)


def test_start_of_a_user(monkeypatch):
    monkeypatch.setattr("skhoid.model.arx_starts.N_SPREAD", 1)
    rng = np.random.default_rng(3)
    u = rng.standard_normal((400, 1))
    y = np.abs(lfilter([0.5], [1.0, -1.5, 0.7], u.ravel()))
    start = {"a1": -1.4, "a2": 0.6, "b0": 0.4}
    model = SimulatedARX(2, 1, 0, dt=0.02, effects=Magnitude(), initial="rest")
    assert model.fit(u, y).vaf_ < 95.0
    assert model.set_params(start=start).fit(u, y).vaf_ > 99.9


def test_start_of_a_user_that_is_worse_does_no_harm():
    X, y = make_tracking_runs(duration=20.48, remnant_intensity=0.05, random_state=2)
    plain = OperatorRegressor(effects="dead_zone").fit(X, y)
    start = {"K_e": 5.0, "omega_nm": 50.0, "dead_zone__width": 1.5}
    given = OperatorRegressor(effects="dead_zone", start=start).fit(X, y)
    assert given.vaf_ >= plain.vaf_ - 1e-3


@pytest.mark.parametrize(
    ("start", "message"),
    [
        ({"dead_zone__with": 0.1}, r"no parameter .*Did you mean 'dead_zone__width'"),
        ({"K_e": "large"}, r"must be a finite number; got 'large'"),
        ({"omega_nm": 1e3}, r"outside its range of 1.5 to 60"),
    ],
)
def test_start_of_what_is_not_there(start, message):
    X, y = make_tracking_runs(duration=20.48, random_state=2)
    with pytest.raises(ValueError, match=message):
        OperatorRegressor(effects="dead_zone", start=start).fit(X, y)
