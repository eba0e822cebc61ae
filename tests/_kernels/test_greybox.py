"""Kernels that simulate operators with effects: against naive twins and SciPy."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy import special, stats
from scipy.signal import lsim
from support import naive_greybox as naive

from skhoid import _kernels
from skhoid._kernels import greybox

pytestmark = pytest.mark.slow  # slow twins, and much to compile

EXACT = {"rtol": 1e-11, "atol": 1e-11}


def noise(n=60, runs=3, seed=0):
    return np.random.default_rng(seed).standard_normal((n, runs))


def by_run(twin, x, *args):
    return np.stack([twin(column, *args) for column in x.T], axis=1)


@st.composite
def signals(draw, largest=2.0):
    n, runs = draw(st.integers(1, 25)), draw(st.integers(1, 3))
    seed = draw(st.integers(0, 2**32 - 1))
    return largest * np.random.default_rng(seed).uniform(-1, 1, (n, runs))


@given(x=signals(), data=st.data())
@settings(max_examples=150)
def test_delayed_is_its_twin(x, data):
    n, runs = x.shape
    rows, columns = data.draw(st.sampled_from([(1, 1), (n, 1), (1, runs), (n, runs)]))
    seed = data.draw(st.integers(0, 2**32 - 1))
    delay = np.random.default_rng(seed).uniform(-6, 12, (rows, columns))
    if data.draw(st.booleans()):
        delay = np.round(delay)
    everywhere = np.broadcast_to(delay, x.shape)
    expected = np.stack([naive.delayed(x[:, j], everywhere[:, j]) for j in range(runs)], axis=1)
    np.testing.assert_allclose(greybox.delayed(x, _kernels.gate(delay)), expected, **EXACT)


@given(
    omega=st.floats(0.5, 60.0),
    zeta=st.one_of(st.floats(0.0, 3.0), st.sampled_from([0.0, 1.0, 1.0 - 1e-12, 1.0 + 1e-9])),
    dt=st.sampled_from([0.002, 0.01, 0.04]),
)
@settings(max_examples=200)
def test_matrices_of_the_neuromuscular_system_are_its_exponential(omega, zeta, dt):
    row = greybox.held_linearly(np.array([omega]), np.array([zeta]), dt)[0]
    # Inverses of a stiffness of omega^2 dt^2 lose that much of the digits.
    tolerance = 1e-14 / min(1.0, omega * dt) ** 2 * max(1.0, omega**2)
    for got, expected in zip(row.reshape(3, 2, 2), naive.transition(omega, zeta, dt), strict=True):
        np.testing.assert_allclose(got, expected, rtol=1e-9, atol=tolerance)


@pytest.mark.parametrize("zeta", [0.35, 2.0])
def test_second_order_is_the_linear_system_of_scipy(zeta):
    omega, dt = 11.25, 0.01
    position, rate = noise(400, 2, seed=1), noise(400, 2, seed=2)
    matrices = greybox.held_linearly(np.array([omega]), np.array([zeta]), dt)
    out = greybox.second_order(position, rate, matrices, 0.0, 0.0, 1e9)
    t = np.arange(400) * dt
    # omega^2 (position + s rate) / (s^2 + 2 zeta omega s + omega^2)
    denominator = [1.0, 2 * zeta * omega, omega**2]
    for j in range(2):
        of_position = lsim(([omega**2], denominator), position[:, j], t)[1]
        of_rate = lsim(([omega**2, 0.0], denominator), rate[:, j], t)[1]
        np.testing.assert_allclose(out[:, j], of_position + of_rate, rtol=1e-8, atol=1e-8)


@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(1, 40),
    varies=st.booleans(),
    cubic=st.sampled_from([0.0, 0.5, 40.0]),
    square=st.sampled_from([0.0, 3.0]),
    bound=st.sampled_from([0.05, 1e9]),
)
@example(seed=395, n=34, varies=False, cubic=40.0, square=0.0, bound=1e9)
@settings(max_examples=60)
def test_second_order_is_its_twin(seed, n, varies, cubic, square, bound):
    rng = np.random.default_rng(seed)
    position, rate = 0.1 * rng.standard_normal((2, n, 2))
    rows = n if varies else 1
    omega = rng.uniform(3, 30) * rng.uniform(0.95, 1.05, rows)
    matrices = greybox.held_linearly(omega, rng.uniform(0.1, 1.5, rows), 0.02)
    out = greybox.second_order(position, rate, matrices, cubic, square, bound)
    # The matrices themselves have a test of their own.
    of_sample = list(np.broadcast_to(matrices, (n, 12)).reshape(n, 3, 2, 2))
    for j in range(2):
        expected = np.array(
            naive.second_order(position[:, j], rate[:, j], of_sample, cubic, square, bound)
        )
        # Of what runs away, thousands of times the command, the cubic's root has fewer digits.
        calm = np.maximum.accumulate(np.abs(expected)) < 1e3
        np.testing.assert_allclose(out[calm, j], expected[calm], rtol=1e-8, atol=1e-9)
        np.testing.assert_allclose(out[~calm, j], expected[~calm], rtol=1e-5)


def test_a_stiff_spring_is_the_duffing_oscillator():
    """y'' = w^2 (p - k y^3 - y) - 2 z w y' by Runge-Kutta in small steps."""
    omega, zeta, k, dt, fine = 6.0, 0.4, 3.0, 0.002, 8
    t = np.arange(1500) * dt

    def command(time):
        return 1.2 * np.sin(2.0 * time) + 0.5 * np.sin(5.3 * time)

    def slope(state, time):
        y, v = state
        force = omega**2 * (command(time) - k * y**3 - y)
        return np.array([v, force - 2 * zeta * omega * v])

    h = dt / fine
    state, expected = np.zeros(2), [0.0]
    for i in range((t.size - 1) * fine):
        time = i * h
        k1 = slope(state, time)
        k2 = slope(state + h / 2 * k1, time + h / 2)
        k3 = slope(state + h / 2 * k2, time + h / 2)
        k4 = slope(state + h * k3, time + h)
        state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        if (i + 1) % fine == 0:
            expected.append(state[0])
    matrices = greybox.held_linearly(np.array([omega]), np.array([zeta]), dt)
    position = command(t)[:, None]
    out = greybox.second_order(position, np.zeros_like(position), matrices, k, 0.0, 1e9)[:, 0]
    # Linear interpolation of command and spring between samples: second order in dt.
    assert np.abs(out - expected).max() < 1e-4 * np.abs(expected).max()


@given(
    x=signals(),
    seed=st.integers(0, 2**32 - 1),
    na=st.integers(0, 3),
    nb=st.integers(1, 4),
    direct=st.booleans(),
    cubic=st.sampled_from([0.0, 0.02, 0.1]),
    square=st.sampled_from([0.0, 0.05]),
    constant=st.sampled_from([0.0, 0.3]),
)
@settings(max_examples=100)
def test_arx_response_is_its_twin(x, seed, na, nb, direct, cubic, square, constant):
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(-0.3, 0.3, na), rng.uniform(-0.4, 0.4, nb)
    if not direct:
        b[0] = 0.0
    out = greybox.arx_response(x, a, b, cubic, square, constant, 1e9)
    expected = by_run(naive.arx_response, x, a, b, cubic, square, constant, 1e9)
    np.testing.assert_allclose(out, expected, rtol=1e-9, atol=1e-9)


@given(n=st.integers(1, 20), runs=st.integers(1, 3), seed=st.integers(0, 2**32 - 1))
@settings(max_examples=60)
def test_whitened_is_its_twin(n, runs, seed):
    rng = np.random.default_rng(seed)
    table, weight = rng.standard_normal((2, n, runs)), rng.uniform(0, 1, (n, runs))
    ar = rng.uniform(-1, 1, 6)
    out = greybox.whitened(table, ar, weight).reshape(2, n, runs)
    for i in range(2):
        for j in range(runs):
            expected = naive.whitened(table[i, :, j], ar, weight[:, j])[:n]
            np.testing.assert_allclose(out[i, :, j], expected, **EXACT)


@given(x=signals(), period=st.floats(1.0, 9.0), phase=st.floats(0.0, 12.0))
@settings(max_examples=150)
def test_held_by_a_clock_is_its_twin(x, period, phase):
    out = greybox.held(x, x, period, 0.0, phase)
    np.testing.assert_allclose(
        out, by_run(naive.held_by_clock, x, period, phase), rtol=1e-9, atol=1e-9
    )


@given(
    x=signals(),
    seed=st.integers(0, 2**32 - 1),
    period=st.floats(1.0, 6.0),
    threshold=st.floats(0.05, 2.0),
    phase=st.floats(0.0, 4.0),
)
@settings(max_examples=100)
def test_held_by_events_is_its_twin(x, seed, period, threshold, phase):
    watched = np.random.default_rng(seed).uniform(-2, 2, x.shape)
    out = greybox.held(x, watched, period, threshold, phase)
    for j in range(x.shape[1]):
        expected = naive.held_by_event(x[:, j], watched[:, j], period, threshold, phase)
        np.testing.assert_allclose(out[:, j], expected, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("of_error", [False, True])
def test_a_scan_of_events_leaves_what_the_held_command_leaves(of_error):
    rng = np.random.default_rng(2)
    position = np.cumsum(rng.standard_normal((200, 2)), axis=0)
    slope, dt, omega, zeta = np.gradient(position, axis=0), 0.04, 9.0, 0.4
    known = rng.uniform(size=(100, 2)) < 0.9
    y = rng.standard_normal((100, 2)) * known
    points = np.array([[3.7, 1.3, 0.8, 0.6], [0.0, 0.4, 0.2, 1.5]])
    matrices = greybox.held_linearly(np.array([omega]), np.array([zeta]), dt)
    args = (position, slope, y, known, points, matrices, 2 * zeta * omega, of_error, 2, 200, 0)
    left = greybox.events_scanned(*args)
    for (period, threshold, ratio, factor), row in zip(points, left, strict=True):
        command = factor * (position + ratio * slope)
        watched = position if of_error else command
        kept = greybox.held(command, watched, period, threshold, 0.0)
        answer = greybox.second_order(kept, np.zeros_like(kept), matrices, 0.0, 0.0, 1e9)
        assert np.isfinite(row).all()
        assert row[0] <= (y**2).sum() * (1 + 1e-12)
        # With the output of the command itself nothing is left.
        args = (position, slope, answer[::2] * known, *args[3:])
        again = greybox.events_scanned(*args)
        at = int(np.flatnonzero(points[:, 0] == period)[0])
        assert abs(again[at, 0]) < 1e-9 * (answer**2).sum()
        np.testing.assert_allclose(again[at, 1:], [0.0, 1.0], atol=1e-6)


def test_windows_of_a_scan_of_events_begin_as_suits_them():
    rng = np.random.default_rng(3)
    position = np.cumsum(rng.standard_normal((400, 3)), axis=0)
    slope, dt, omega, zeta = np.gradient(position, axis=0), 0.04, 9.0, 0.4
    matrices = greybox.held_linearly(np.array([omega]), np.array([zeta]), dt)
    period, threshold = 12.0, 0.5
    kept = greybox.held(position, position, period, threshold, 5.0)  # events begin late
    y = greybox.second_order(kept, np.zeros_like(kept), matrices, 0.0, 0.0, 1e9)
    points = np.array([[period, threshold, 0.0, 1.0], [0.7 * period, threshold, 0.0, 1.0]])
    args = (position, slope, y, np.ones_like(y, dtype=bool), points, matrices, 2 * zeta * omega)
    whole = greybox.events_scanned(*args, False, 1, 400, 0)[:, 0]
    right, wrong = greybox.events_scanned(*args, False, 1, 100, 4)[:, 0]
    assert right < min(wrong, whole[0]) / 2


@given(x=signals(), step=st.floats(0.01, 3.0))
@settings(max_examples=100)
def test_rate_limited_is_its_twin_and_limits_the_rate(x, step):
    out = greybox.rate_limited(x, step)
    np.testing.assert_allclose(out, by_run(naive.rate_limited, x, step), **EXACT)
    assert np.all(np.abs(np.diff(out, axis=0)) <= step * (1 + 1e-12))
    assert np.all(np.abs(out) <= np.abs(x).max() * (1 + 1e-12))


@given(x=signals(), limit=st.floats(0.0, 3.0), remnant=st.floats(0.01, 3.0))
@settings(max_examples=100)
def test_cut_within_is_the_mean_over_normal_remnant(x, limit, remnant):
    above, below = (x.ravel() - limit) / remnant, (x.ravel() + limit) / remnant
    mean = [at * special.ndtr(at) + stats.norm.pdf(at) for at in (below, above)]
    wanted = remnant * (mean[0] - mean[1]) - limit
    scale = 1e-14 * max(1.0, limit, remnant, np.abs(x).max())
    out = greybox.cut_within(x.ravel(), limit, remnant)
    np.testing.assert_allclose(out, wanted, rtol=0.0, atol=10 * scale)


@given(x=signals(), breakaway=st.floats(0.0, 1.5), share=st.floats(0.0, 1.0))
@settings(max_examples=200)
def test_stuck_is_its_twin_and_stays_within_its_distance(x, breakaway, share):
    kinetic = share * breakaway
    out = greybox.stuck(x, breakaway, kinetic, True)
    np.testing.assert_allclose(out, by_run(naive.stuck, x, breakaway, kinetic), **EXACT)
    assert np.all(np.abs(out - x) <= breakaway * (1 + 1e-9) + 1e-12)


def test_weighted_plays_are_the_sum_of_single_ones():
    x, gaps, weights = noise(), np.array([0.2, 0.5, 1.1]), np.array([0.5, -0.3, 1.2])
    ahead = [x - by_run(naive.stuck, x, gap, gap) for gap in gaps]
    out = greybox.stops_summed(x, gaps, weights)
    np.testing.assert_allclose(out, np.tensordot(weights, ahead, 1), atol=1e-12)
