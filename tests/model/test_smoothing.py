"""How smooth a free form is, chosen by marginal likelihood."""

import numpy as np
import pytest

from skhoid import OperatorRegressor, make_tracking_runs
from skhoid.effects import CubicGain, FreeMap
from skhoid.model.extend import extended
from skhoid.model.fitting import Criterion
from skhoid.model.smoothing import find_posterior, refine_detail


def with_map(effects, spread=None, seed=0):
    X, y = make_tracking_runs(
        "C1", 2, duration=40.96, remnant_intensity=0.1, random_state=seed, effects=effects
    )
    estimator = OperatorRegressor()
    prepared = estimator.prepare(X, y)
    criterion = Criterion(prepared.record)
    base = estimator.first_fit(prepared)
    return extended(base, "map", FreeMap(spread=spread), criterion, criterion.coarse())


def dof_of(model):
    criterion = Criterion(model.simulator.record)
    criterion.set_noise(criterion.remnant_model(model.output))
    own = [i for i, name in enumerate(model.simulator.names) if name.startswith("map__")]
    return float(find_posterior(model, criterion).dof[own].sum())


@pytest.fixture(scope="module")
def bent():
    return with_map(CubicGain(hardening=0.3, form="cubic"))


@pytest.mark.slow
def test_the_data_decide_how_smooth_a_curve_is(bent):
    straight = with_map(None)
    assert dof_of(straight) < 4.0 < dof_of(bent)
    spreads = [dict(m.effects.steps)["map"].spread for m in (bent, straight)]
    assert spreads[0] > 3 * spreads[1]


@pytest.mark.slow
def test_more_knots_show_what_bends_between_them(bent):
    few, many = bent, refine_detail(bent, "map")
    old, new = (dict(model.effects.steps)["map"] for model in (few, many))
    assert set(old.knots) < set(new.knots)
    assert len(new.knots) == 2 * len(old.knots) - 1
    assert many.sse < 1.001 * few.sse  # a smoother curve may be likelier
    assert refine_detail(many, "map") is many
    own = [[m.values()[f"map__{p.name}"] for p in e.free] for m, e in ((few, old), (many, new))]
    at = np.linspace(old.knots[0], old.knots[-1], 50)
    curves = [e.design(at) @ c for e, c in zip((old, new), own, strict=True)]
    curves = [c - np.polyval(np.polyfit(at, c, 1), at) for c in curves]  # which is the gain's
    assert np.std(curves[0] - curves[1]) < 0.2 * np.std(curves[0])
