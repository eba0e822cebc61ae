"""Free runs with forces inside the recursion: the readable twin, closed forms, friction at rest."""

import numpy as np
import pytest
from scipy.signal import lfilter
from support import naive_greybox as naive

from skhoid._kernels import greybox, inside

pytestmark = pytest.mark.slow  # compiles for many seconds

DT = 0.02
TERMS = {
    "coulomb": [(3.0, 0.0, 0.3, 1e-3, 0.0, 1.0)],
    "coulomb of the rate": [(3.0, 1.0, 0.2, 1e-2, 0.0, 1.0)],
    "smooth": [(0.0, 0.0, 0.3, 0.2, 0.0, 1.0)],
    "smooth of the rate": [(0.0, 1.0, 0.2, 3.0, 0.0, 1.0)],
    "root": [(1.0, 0.0, 0.4, 1e-3, -0.2, 0.0)],
    "stops": [(2.0, 0.0, -0.3, 0.2, 0.0, 0.0)],
    "all": [
        (3.0, 0.0, 0.1, 1e-2, 0.0, 1.0),
        (0.0, 1.0, 0.1, 1.0, 0.0, 1.0),
        (1.0, 0.0, 0.2, 1e-3, 0.1, 0.0),
        (2.0, 0.0, -0.6, 0.8, 0.0, 0.0),
    ],
}


def noise(n, runs=2, seed=0):
    return np.random.default_rng(seed).standard_normal((n, runs))


NONE = np.zeros((0, 6)), np.zeros((0, 9))
PLACES = np.linspace(-0.4, 0.4, 9)
TABLES = np.array([0.4 * np.tanh(PLACES / 0.1), 3 * PLACES**3 + PLACES**2])
TABLED = {
    "of the rate": [(4.0, 1.0, -0.4, 0.1, 0.0, 0.0)],
    "of the output": [(4.0, 0.0, -0.4, 0.1, 1.0, 0.0)],
    "both, and friction": [
        (4.0, 0.0, -0.4, 0.1, 0.0, 0.0),
        (4.0, 1.0, -0.4, 0.1, 1.0, 0.0),
        (3.0, 0.0, 0.1, 1e-2, 0.0, 1.0),
    ],
}


def run(x, a, b, against, terms, spring=(0.0, 0.0), constant=0.0, bound=1e9, begun=None):
    return inside.arx_inside(
        x,
        np.atleast_2d(np.asarray(a, float)),
        np.atleast_2d(np.asarray(b, float)),
        np.asarray(against, float),
        np.array(spring, float),
        NONE[0],
        np.array(terms, float).reshape(-1, 6),
        NONE[1],
        constant,
        np.zeros((0, x.shape[1])) if begun is None else begun,
        DT,
        bound,
    )


@pytest.mark.parametrize("terms", TERMS.values(), ids=TERMS)
@pytest.mark.parametrize("against", [[0.4, 0.1], [0.0, 0.1]], ids=str)
def test_it_is_its_twin(terms, against):
    x, a, b = noise(60), [-0.9, 0.2], [0.0, 0.4, 0.1]
    sizes = (0.05, 0.02)
    out = run(x, a, b, against, terms, sizes, 0.05)
    for j in range(x.shape[1]):
        expected = naive.arx_inside(x[:, j], [a], [b], against, sizes, terms, 0.05, DT, 1e9)
        np.testing.assert_allclose(out[:, j], expected, rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("terms", [TERMS["root"], TERMS["all"]], ids=["root", "all"])
def test_what_led_to_the_first_samples_passes_through_the_forces(terms):
    x, a, b, begun = noise(60), [-0.9, 0.2], [0.0, 0.4, 0.1], noise(3, seed=5)
    out = run(x, a, b, [0.3], terms, begun=begun)
    for j in range(x.shape[1]):
        expected = naive.arx_inside(
            x[:, j], [a], [b], [0.3], (0.0, 0.0), terms, 0.0, DT, 1e9, begun[:, j]
        )
        np.testing.assert_allclose(out[:, j], expected, rtol=1e-8, atol=1e-9)


def test_friction_holds_what_rests_and_lets_go_above_its_force():
    """A mass with friction F: nothing moves below it, and above it x - F drives it."""
    a, b, friction = [-0.98], [0.02], [(3.0, 0.0, 0.5, 1e-9, 0.0, 1.0)]
    held = run(np.full((200, 1), 0.49), a, b, b, friction)
    assert np.abs(held).max() < 1e-8
    moving = run(np.full((200, 1), 1.2), a, b, b, friction)
    expected = lfilter(b, [1.0, *a], np.full(200, 0.7))
    np.testing.assert_allclose(moving[:, 0], expected, rtol=1e-9)
    coasting = run(np.r_[np.full((100, 1), 1.2), np.zeros((100, 1))], a, b, b, friction)
    stopped = np.flatnonzero(coasting[100:, 0] < 1e-8)[0]
    assert (np.abs(coasting[100 + stopped :]) < 1e-8).all(), "it comes to rest, without chatter"


def test_a_tank_empties_by_torricellis_law():
    """dy/dt = -k sqrt(y): the root of the level falls in a line."""
    k, fill = 0.1, 200
    x = np.zeros((1200, 1))
    x[:fill] = 1.0 / (fill * DT) + k  # more than flows out
    y = run(x, [-1.0], [DT], [DT], [(1.0, 0.0, k, 1e-9, 0.0, 0.0)])[:, 0]
    top = y[fill - 1]
    t = DT * np.arange(1200 - fill + 1)
    expected = np.maximum(np.sqrt(top) - k * t / 2, 0.0) ** 2
    np.testing.assert_allclose(y[fill - 1 :], expected, atol=2e-3 * top)


def test_what_diverges_stays_within_the_bound():
    x = noise(300)
    out = run(x, [-1.5], [1.0], [1.0], TERMS["coulomb"], bound=1e6)
    assert 0.99e6 < np.abs(out).max() <= 1e6


@pytest.mark.parametrize("terms", TABLED.values(), ids=TABLED)
@pytest.mark.parametrize("against", [[0.4, 0.1], [-0.05, 0.2]], ids=str)
def test_forces_by_tables_are_their_twin(terms, against):
    x, a, b, bends = noise(60), [-0.9, 0.2], [0.2, 0.4], [(4.0, 0.0, -0.4, 0.1, 1.0, 0.0)]
    rows, springs = np.array(terms), np.array(bends)
    tables = TABLES if against[0] > 0 else 0.1 * TABLES  # without a balance it runs away
    rest = (tables, 0.05, np.zeros((0, 2)), DT, 1e9)
    matrices = np.atleast_2d(a), np.atleast_2d(b), np.array(against)
    out = inside.arx_inside(x, *matrices, np.zeros(2), springs, rows, *rest)
    for j in range(2):
        plain = (x[:, j], [a], [b], against, (0.0, 0.0), terms, 0.05, DT, 1e9)
        expected = naive.arx_inside(*plain, bends=bends, tables=tables)
        np.testing.assert_allclose(out[:, j], expected, rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("varies", [False, True])
@pytest.mark.parametrize("terms", TABLED.values(), ids=TABLED)
def test_a_limb_against_forces_is_its_twin(terms, varies):
    rows = 60 if varies else 1
    omega = np.random.default_rng(3).uniform(8, 12, rows)
    matrices = greybox.held_linearly(omega, np.full(rows, 0.4), DT)
    position, rate = 0.5 * noise(60), 0.02 * noise(60, seed=1)
    terms = [*terms, (5.0, 0.0, 2.0, 1.0, 0.0, 0.0)]
    out = inside.limb_inside(position, rate, matrices, np.array(terms), TABLES, DT, 1e9)
    of_sample = list(np.broadcast_to(matrices, (60, 12)).reshape(60, 3, 2, 2))
    for j in range(2):
        expected = naive.limb_inside(position[:, j], rate[:, j], of_sample, terms, TABLES, DT)
        np.testing.assert_allclose(out[:, j], expected, rtol=1e-7, atol=1e-9)
