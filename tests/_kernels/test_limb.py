"""The limb with dry friction: against its twin, the linear limb, and the balance of forces."""

import numpy as np
import pytest
from support import naive_greybox as naive

from skhoid._kernels import greybox, limb

NONE = np.zeros(2)
DT = 0.01


def limb_of(omega, zeta, n, varies, rng):
    rows = n if varies else 1
    omega = omega * rng.uniform(0.95, 1.05, rows)
    zeta = zeta * rng.uniform(0.95, 1.05, rows)
    return omega, zeta, greybox.held_linearly(omega, zeta, DT)


@pytest.mark.parametrize("varies", [False, True])
@pytest.mark.parametrize("friction", [0.0, 0.05, 0.4])
def test_it_is_its_twin(varies, friction):
    rng = np.random.default_rng(3)
    position, rate = np.cumsum(rng.standard_normal((2, 300, 2)), axis=1) / 10
    rate *= 0.01
    omega, zeta, matrices = limb_of(11.0, 0.4, 300, varies, rng)
    spring = np.array([0.3, 0.1])
    out = limb.rubbing(position, rate, matrices, omega, zeta, friction, spring, 1e9)
    each = [np.broadcast_to(a, 300) for a in (omega, zeta)]
    of_sample = list(np.broadcast_to(matrices, (300, 12)).reshape(300, 3, 2, 2))
    for j in range(2):
        expected = naive.rubbing(
            position[:, j], rate[:, j], of_sample, *each, friction, spring, 1e9
        )
        np.testing.assert_allclose(out[:, j], expected, rtol=1e-9, atol=1e-12)


def test_it_rests_where_friction_holds_the_spring():
    """After a step the limb stops for good, within the friction of the command."""
    n = 2000
    position = np.full((n, 1), 1.0)
    matrices = greybox.held_linearly(np.array([10.0]), np.array([0.1]), DT)
    omega, zeta = np.array([10.0]), np.array([0.1])
    out = limb.rubbing(position, 0 * position, matrices, omega, zeta, 0.2, NONE, 1e9)[:, 0]
    assert np.ptp(out[500:]) < 1e-9
    assert abs(out[-1] - 1.0) <= 0.2
    held = limb.rubbing(0.15 * position, 0 * position, matrices, omega, zeta, 0.2, NONE, 1e9)
    assert np.abs(held).max() < 1e-15  # too little to break away
