"""Fits of effects that jump: the likeliest of many narrow minima."""

import numpy as np
import pytest

from skhoid import OperatorRegressor, make_tracking_runs
from skhoid.effects import Intermittent, Stiction
from skhoid.model.fitting import Criterion, sse_at
from skhoid.model.jumps import POPULATION, evolved, wandered
from skhoid.model.likelihood import NEEDED, likelihood_fit, settled
from skhoid.model.model import Model

BREAKAWAY, KINETIC = 0.06, 0.6


@pytest.fixture(scope="module")
def wrong():
    """A model that sticks with hardly any jumps, its criterion, and the true parameters."""
    X, y = make_tracking_runs(
        condition="C1",
        n_runs=2,
        duration=40.96,
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
def test_evolution_leaves_a_wrong_minimum(wrong):
    model, criterion, own = wrong
    assert abs(model.theta[own[1]] - KINETIC) > 0.1
    found, apart = evolved(model, "stiction", criterion)
    assert criterion.n * np.log(model.sse / found.sse) > NEEDED  # the noise model is still wrong
    assert apart.shape == (POPULATION, model.theta.size)


@pytest.mark.slow
def test_evolution_is_never_worse(wrong):
    model, criterion, own = wrong
    theta = model.theta.copy()
    theta[own] = BREAKAWAY, KINETIC
    good = model.at(theta).refined(criterion)
    assert evolved(good, "stiction", criterion)[0].sse <= good.sse


def test_chains_pass_nothing_better_than_they_report(wrong):
    model, criterion, _ = wrong
    apart = 1e-3 * np.random.default_rng(0).standard_normal((20, model.theta.size))
    found, covariance = wandered(model, criterion, apart)
    assert sse_at(model.simulator, criterion, found.theta) <= model.sse * (1 + 1e-12)
    assert (np.linalg.eigvalsh(covariance) > -1e-12).all()
    assert (np.diag(covariance) > 0).all()


@pytest.mark.slow
def test_a_fit_seeks_and_has_the_covariance_of_chains(wrong):
    model, criterion, own = wrong
    fit = Model(model.simulator, model.fit, model.other_cores)
    found, _ = likelihood_fit(fit, Criterion(criterion.record))
    assert found.theta[own] == pytest.approx([BREAKAWAY, KINETIC], rel=0.05)
    assert found.fit.beside is not None
    assert not found.fit.jointly


@pytest.mark.parametrize(
    ("effect", "values"),
    [
        (Stiction(form="jump"), {"breakaway": 0.4, "kinetic": 0.9}),
        (Stiction(form="slide"), {"breakaway": 0.4, "kinetic": 0.5}),
        (Stiction(form="jump", kinetic=0.3), {"breakaway": 0.4}),
        (Intermittent(trigger="clock"), {"hold_time": 0.3, "phase": 0.1}),
        (Intermittent(trigger="event"), {"hold_time": 0.2, "threshold": 0.5}),
        (Intermittent(trigger="error", threshold=0.2), {"hold_time": 0.2}),
    ],
)
def test_every_point_of_a_cube_has_parameters(effect, values, wrong):
    record = wrong[1].record
    rng = np.random.default_rng(1)
    for at in (*rng.uniform(size=(20, len(values))), np.zeros(len(values)), np.ones(len(values))):
        found = effect.within_cube(values, at, record)
        assert found.keys() == values.keys()
        assert all(np.isfinite(v) and v >= 0.0 for v in found.values())
        if "kinetic" in values and effect.form == "jump":
            assert 0.0 <= found["kinetic"] < 1.0
