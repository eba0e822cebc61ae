"""A model of a user's own is searched like those of the package, or refused with a reason."""

import numpy as np
import pytest
from scipy.signal import lfilter
from sklearn.base import clone

from skhoid import EffectSearchCV
from skhoid.effects import Dimension, Parameter
from skhoid.model import GreyBox, SimulatedCore
from skhoid.model.cores import OperatorCore
from skhoid.model.model import fit_core

DT = 0.02
K_E, LAG, LEVEL = 0.8, 0.4, 0.3


class LagCore(OperatorCore):
    """A gain and a first-order lag in place of the neuromuscular system."""

    def __init__(self):
        super().__init__(fixed_delay=0.0)
        lag = Parameter("lag", Dimension(s=1), 0.02, 5.0, (0.2,), "time constant")
        self.parameters = (*self.parameters[:2], lag)

    def response(self, command, gains, spring, values, dt):
        pole = np.exp(-dt / values["lag"])
        x = command.position + np.gradient(command.rate, dt, axis=0)
        return lfilter([0.0, 1 - pole], [1.0, -pole], x, axis=0)


def lag_from_starts(core, record, criterion):
    starts = np.array([[1.0, 0.0, 0.1], [0.5, 0.0, 1.0]])
    return fit_core(core, record, criterion, starts)


class LagRegressor(GreyBox):
    """A first-order lag as an estimator."""

    def __init__(
        self,
        *,
        inputs=None,
        effects=None,
        roles=None,
        controlled_element=None,
        settling=1.0,
        dt=None,
        run=None,
    ):
        self.inputs = inputs
        self.effects = effects
        self.roles = roles
        self.controlled_element = controlled_element
        self.settling = settling
        self.dt = dt
        self.run = run

    def _simulated_core(self):
        return SimulatedCore(LagCore(), lag_from_starts, "first-order lag", "As for operators.")


@pytest.fixture(scope="module")
def biased():
    """One run of a lag with an offset."""
    rng = np.random.default_rng(3)
    t = DT * np.arange(2000)
    omega = np.array([0.5, 1.3, 2.9, 5.1])
    e = np.sin(np.multiply.outer(t, omega) + rng.uniform(0, 6, omega.size)).sum(axis=1)
    pole = np.exp(-DT / LAG)
    y = K_E * lfilter([0.0, 1 - pole], [1.0, -pole], e) + LEVEL
    return e[:, None], y + 0.05 * rng.standard_normal(t.size)


@pytest.mark.slow
def test_a_model_of_ones_own_is_searched(biased):
    model = LagRegressor(dt=DT)
    search = EffectSearchCV(model, effects=["saturation", "bias"], confidence=0.0)
    search.fit(*biased)
    assert search.best_effects_ == ["bias"]
    best = search.best_estimator_
    assert type(best) is type(model)
    assert best.effects.names == ["bias"]
    values = best.parameters_["value"]
    np.testing.assert_allclose(values[["K_e", "lag"]], [K_E, LAG], rtol=0.05)
    assert values["bias__level"] == pytest.approx(LEVEL, abs=0.02)
    assert search.score(*biased) > search.baseline_.score(*biased) + 10
    assert "bias" in search.summary()
    assert "bias__level" in search._repr_html_()
    refitted = clone(best).fit(*biased)
    np.testing.assert_allclose(refitted.parameters_["value"], values, rtol=1e-2, atol=1e-3)
