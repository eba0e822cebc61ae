"""Standard errors: the noise model estimated along, and what is between samples."""

import numpy as np
import pytest

from skhoid import OperatorRegressor, make_tracking_runs
from skhoid.effects import Quantised
from skhoid.model.fitting import Criterion, RemnantModel
from skhoid.model.uncertainty import (
    UNKNOWN_DELAY,
    differentiate_by_noise,
    simulate_later,
)

ALL = slice(None)


@pytest.fixture(scope="module")
def fitted():
    X, y = make_tracking_runs("C1", n_runs=2, remnant_intensity=0.1, random_state=5)
    estimator = OperatorRegressor()
    prepared = estimator.prepare(X, y)
    model = estimator.first_fit(prepared)
    criterion = Criterion(prepared.record)
    criterion.set_noise(criterion.remnant_model(model.output))
    return model.under(criterion), criterion


def test_derivatives_by_the_noise_model_are_differences(fitted):
    model, criterion = fitted
    residual = criterion.residual(model.output)
    found = differentiate_by_noise(criterion, model.output, ALL)
    here = criterion.whitened(residual[None])[0]
    for i, row in enumerate(found):
        ar = criterion.noise.ar.copy()
        ar[i] += 1.0
        other = Criterion(criterion.record, RemnantModel(ar, criterion.noise.scale))
        np.testing.assert_allclose(here - row, other.whitened(residual[None])[0], atol=1e-10)


def test_later_channels_are_as_a_longer_delay(fitted):
    model, criterion = fitted
    simulator = model.simulator
    change = simulate_later(simulator, criterion, model.output, ALL)
    later = model.theta.copy()
    dt = simulator.record.dt
    later[simulator.names.index("tau_e")] += UNKNOWN_DELAY * dt
    expected = (simulator.run(later) - model.output)[:: criterion.thin]
    # Delays between samples go straight from one to the next, so two in a row are not quite one.
    at = criterion.known
    np.testing.assert_allclose(change[at], expected[at], atol=0.05 * np.abs(expected[at]).max())
    assert not change[~at].any()


def test_a_delay_is_not_known_better_than_what_is_between_samples():
    X, y = make_tracking_runs("C1", n_runs=2, remnant_intensity=0.0, random_state=5)
    table = OperatorRegressor().fit(X, y).parameters_
    assert table.loc["tau_e", "sd"] == pytest.approx(0.01 / np.sqrt(12), rel=0.3)


@pytest.mark.slow
def test_an_output_in_steps_has_intervals_like_any_other():
    """A row that jumps must not tell more than remnant lets it."""
    steps = Quantised(step=0.1, offset=0.0, at="output", form="sharp")
    X, y = make_tracking_runs(
        n_runs=1, duration=40.96, remnant_intensity=0.15, effects=steps, random_state=1
    )
    table = OperatorRegressor(effects=steps).fit(X, y).parameters_
    names = ["K_e", "K_edot", "omega_nm", "zeta_nm", "tau_e"]
    sd = (table.loc[names, "sd"] / table.loc[names, "value"]).to_numpy()
    assert np.isfinite(sd).all()
    assert (sd > 0.01).all()
    assert (sd < 0.3).all()
