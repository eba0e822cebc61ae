"""Fits of effects that jump: the likeliest of many narrow minima."""

import pytest

from skhoid import OperatorRegressor, make_tracking_runs
from skhoid.effects import Stiction
from skhoid.model.fitting import Criterion
from skhoid.model.likelihood import likelihood_fit, settled
from skhoid.model.model import Model

BREAKAWAY, KINETIC = 0.06, 0.6


@pytest.fixture(scope="module")
def wrong():
    """A model that sticks with hardly any jumps, its criterion, and the true parameters."""
    X, y = make_tracking_runs(
        condition="C1",
        n_runs=2,
        duration=40.96,
        sampling_rate=50,
        remnant_intensity=0.03,
        effects=Stiction(form="jump", breakaway=BREAKAWAY, kinetic=KINETIC),
        random_state=2,
    )
    estimator = OperatorRegressor(effects=Stiction(form="jump"))
    prepared = estimator.prepare(X, y)
    first = estimator.first_fit(prepared)
    own = [first.simulator.names.index(f"stiction__{n}") for n in ("breakaway", "kinetic")]
    theta = first.theta.copy()
    mean = BREAKAWAY * (1 + KINETIC) / 2
    theta[own] = 2 * mean / 1.94, 0.94
    model, noise = settled(first.at(theta), Criterion(prepared.record))
    return model, Criterion(prepared.record, noise), own


@pytest.mark.slow
def test_a_fit_seeks_and_has_the_covariance_of_chains(wrong):
    model, criterion, own = wrong
    fit = Model(model.simulator, model.fit, model.other_cores)
    found, _ = likelihood_fit(fit, Criterion(criterion.record))
    assert found.theta[own] == pytest.approx([BREAKAWAY, KINETIC], rel=0.05)
    assert found.fit.beside is not None
    assert not found.fit.jointly
