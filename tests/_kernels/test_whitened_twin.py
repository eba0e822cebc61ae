"""Kernels beside autoregressive noise: each instant is that of a plain twin."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import lfilter
from support import whitened_twin as twin

from skhoid.arx.orders import Orders
from skhoid.tracking.box_jenkins import BoxJenkinsFilter
from skhoid.tracking.recursive_iv import InstrumentsFilter
from skhoid.tracking.whitened import LITTLE_WORTH, Start, Window

pytestmark = pytest.mark.slow  # compiles for many orders

N, DT = 220, 0.25  # so a run settles in 8 rows
F = {0: [], 1: [-0.6], 2: [-1.2, 0.5], 3: [-1.5, 0.9, -0.2]}


@dataclass
class Case:
    """Signals of shape (n_signals, N, n_runs), outputs, and a start that is not the truth."""

    orders: Orders
    signals: np.ndarray
    target: np.ndarray
    start: Start
    lam: np.ndarray
    n_external: int = 0


def triangle(nd, rng):
    """R of a QR decomposition."""
    return np.linalg.qr(rng.standard_normal((40, nd)), mode="r") if nd else np.empty((0, 0))


def case(na, nb, nk, nd, *, n_runs=1, n_external=0, holes=False, lam=0.97, seed=0):
    rng = np.random.default_rng([seed, na, nd, n_runs])
    n_inputs = len(nb)
    external = np.cumsum(rng.standard_normal((n_external, N, n_runs)), axis=1)
    external = lfilter([1.0], [1.0, -0.7], np.diff(external, axis=1, prepend=0), axis=1)
    signals = rng.standard_normal((n_inputs, N, n_runs))
    if n_external:
        for i in range(n_inputs):
            signals[i] += 1.5 * external[i % n_external]
            signals[i, 3:] += external[(i + 1) % n_external, :-3]
    orders = Orders(na, tuple(nb), tuple(nk))
    true = np.r_[F[na], rng.uniform(0.3, 1.0, sum(nb))]
    f, b, _ = orders.split(true)
    target = np.zeros((N, n_runs))
    for i in range(n_inputs):
        target += lfilter(np.r_[np.zeros(nk[i]), b[i]], np.r_[1, f], signals[i], axis=0)
    target += lfilter([1.0], [1.0, -0.8], 0.2 * rng.standard_normal((N, n_runs)), axis=0)
    signals = np.concatenate([signals, external])
    if holes:
        target[rng.random(target.shape) < 0.06] = np.nan
        for signal in signals:
            signal[rng.random(signal.shape) < 0.008] = np.nan
        target[5], signals[0, 0, 0] = np.nan, np.nan
    n = orders.n_params
    root = rng.standard_normal((3 * n, n))
    start = Start(
        theta=0.8 * true,
        d=0.3 * rng.uniform(-1, 1, nd) / max(nd, 1),
        information=root.T @ root,
        noise_triangle=triangle(nd, rng),
        noise_variance=0.05,
        n_rows=90,
    )
    lam = np.broadcast_to(lam, n).astype(float)
    return Case(orders, signals, target, start, lam, n_external)


def setting_of(case, row_filter):
    """What the twin is told, from the documentation of the filter and its kernel."""
    start, orders = case.start, case.orders
    depth = max(nb + nk for nb, nk in zip(orders.nb, orders.nk, strict=True)) + start.d.size
    if case.n_external:
        depth = max(depth, int(row_filter.before[0][-1]) + 1 + start.d.size)
    memory = 1 / (1 - case.lam.min())
    follow = 1 / min(memory, 10.24 / DT)
    assert row_filter.waits.tolist() == [depth + round(2 / DT), depth]
    return twin.Setting(
        orders.na, list(orders.nb), list(orders.nk), start.d.size, (depth + round(2 / DT), depth),
        case.lam, 1.0, follow, DT / 10.24,
    )  # fmt: skip


def noise_of(case, setting):
    R = case.start.noise_triangle
    return twin.Noise(case.start.d, np.linalg.inv(R.T @ R), case.start.noise_variance, setting)


def worth_of(lam, n_rows):
    """Share of the window's information that the start keeps: the memory's, else little."""
    memory = 1 / (1 - lam) if lam < 1 else np.inf
    return memory / n_rows if memory < n_rows else LITTLE_WORTH


def box_jenkins(case, n_runs):
    row_filter = BoxJenkinsFilter(case.start, case.orders, case.lam, DT, n_runs)
    setting = setting_of(case, row_filter)
    largest = np.sqrt(np.diag(case.start.information) / case.start.n_rows)
    worth = worth_of(case.lam.min(), case.start.n_rows)
    information = worth * case.start.information
    plain = twin.PredictionErrors(
        setting, case.start.theta, noise_of(case, setting), largest, information, n_runs
    )
    return row_filter, plain


def instruments(case, n_runs, lags=(1, 2, 4, 7, 11)):
    """Filters begun with the sums of a first window, which estimates do not change in."""
    window_case = case_like(case)
    n_inputs = len(case.orders.nb)
    X, y = window_case.signals[:, :, 0].T, window_case.target[:, 0]
    window = Window([(X, y)], case.orders, case.start.d.size, DT)
    assert n_inputs == window.parts[0][0].shape[1]
    row_filter = InstrumentsFilter(case.start, window, np.array(lags), case.lam, DT, n_runs)
    setting = setting_of(case, row_filter)
    largest = np.sqrt(np.diag(case.start.information) / case.start.n_rows)
    plain = twin.Instruments(
        setting, case.start.theta, noise_of(case, setting), largest, lags, case.n_external, 1
    )
    plain.frozen = True
    for t in range(N):
        plain.instant(window_case.signals[:, t, :1], window_case.target[t, :1])
    worth = worth_of(case.lam[0], case.start.n_rows)
    plain.ZZ, plain.ZP, plain.ZU = (worth * s for s in (plain.ZZ, plain.ZP, plain.ZU))
    plain.frozen, plain.n_updates, plain.squares, plain.n_held = False, 0, 0.0, 0
    plain.lanes = [twin.Lane() for _ in range(n_runs)]
    return row_filter, plain


def case_like(other):
    """Another recording of the same system, without holes."""
    orders = other.orders
    return case(
        orders.na, orders.nb, orders.nk, other.start.d.size, n_external=other.n_external, seed=91
    )


def both(case, build, rests=()):
    """Paths of theta, D, information and errors, of the kernel and its twin."""
    n_runs = case.target.shape[1]
    row_filter, plain = build(case, n_runs)
    n, nd = case.orders.n_params, case.start.d.size
    kernel_paths = tuple(np.empty(s) for s in ((N, n), (N, nd), (N, n, n), (N, n_runs)))
    twin_paths = tuple(np.empty_like(p) for p in kernel_paths)
    edges = sorted({0, N, *(t for t, _ in rests)})
    for begin, end in pairwise(edges):
        for at, run in rests:
            if at == begin:
                row_filter.memory[run] = 0.0
                plain.rest(run)
        paths = tuple(p[begin:end] for p in kernel_paths)
        row_filter.run(
            np.ascontiguousarray(case.signals[:, begin:end]), case.target[begin:end].copy(), paths
        )
        for t in range(begin, end):
            twin_paths[3][t] = plain.instant(case.signals[:, t], case.target[t])
            twin_paths[0][t], twin_paths[1][t] = plain.theta, plain.noise.d
            twin_paths[2][t] = plain.R
    return row_filter, plain, kernel_paths, twin_paths


def assert_same(row_filter, plain, kernel_paths, twin_paths, rtol=1e-8):
    assert plain.n_updates > 20
    before = (twin_paths[2] == 0).all(axis=(1, 2))  # what is known then is no matter of the kernel
    kernel_paths[2][before] = 0.0
    for found, expected in zip(kernel_paths, twin_paths, strict=True):
        size = np.nanmax(np.abs(expected), initial=0.0)
        np.testing.assert_allclose(found, expected, rtol=rtol, atol=1e-10 * size)
    held = [plain.n_updates, plain.squares, plain.n_held, plain.noise.variance]
    held.append(len(kernel_paths[0]) - plain.n_held)
    np.testing.assert_allclose(row_filter.counts, held, rtol=10 * rtol)
    np.testing.assert_allclose(row_filter.slow, plain.slow, rtol=rtol)
    moved = np.abs(kernel_paths[0][-1] - kernel_paths[0][0]).max()
    assert moved > 1e-3  # the paths are not constant


SHAPES = [(0, [3], [2]), (2, [2], [5])]
ONE_PER_INPUT = [(2, [2, 3], [1, 0])]


@pytest.mark.parametrize("nd", [0, 6])
@pytest.mark.parametrize(("na", "nb", "nk"), SHAPES + ONE_PER_INPUT)
@pytest.mark.parametrize("holes", [False, True], ids=["whole", "holes"])
def test_prediction_errors(na, nb, nk, nd, holes):
    assert_same(*both(case(na, nb, nk, nd, holes=holes), box_jenkins))


@pytest.mark.parametrize("nd", [0, 6])
@pytest.mark.parametrize(("na", "nb", "nk"), SHAPES + ONE_PER_INPUT)
@pytest.mark.parametrize("holes", [False, True], ids=["whole", "holes"])
def test_instruments(na, nb, nk, nd, holes):
    n_external = 1 if len(nb) == 1 else 2
    data = case(na, nb, nk, nd, n_external=n_external, holes=holes)
    # Normal equations of instruments lose digits that the twin, which solves them once, keeps.
    assert_same(*both(data, instruments), rtol=1e-7)


@pytest.mark.parametrize("build", [box_jenkins, instruments])
@pytest.mark.parametrize("holes", [False, True], ids=["whole", "holes"])
def test_runs_side_by_side(build, holes):
    data = case(2, [2], [1], 3, n_runs=3, n_external=int(build is instruments), holes=holes)
    data.target[150:, 2] = np.nan  # the third run ends, and the second begins late
    data.signals[:, 150:, 2] = np.nan
    data.signals[:, :20, 1] = data.target[:20, 1] = np.nan
    rests = [(20, 1), (90, 0)]
    assert_same(*both(data, build, rests), rtol=1e-7)


@pytest.mark.parametrize("nd", [0, 3])
def test_forgetting_by_parameter(nd):
    data = case(2, [2], [1], nd, lam=[0.99, 0.9, 0.97, 1.0])
    _, plain, *paths = both(data, box_jenkins)
    assert_same(_, plain, *paths)
    same = both(case(2, [2], [1], nd, lam=0.97), box_jenkins)[2][0]
    assert np.abs(same - paths[0][0]).max() > 1e-3


@pytest.mark.parametrize("build", [box_jenkins, instruments])
def test_the_unit_circle_is_not_left(build):
    """Truth outside it: steps are halved, or left out."""
    data = case(2, [2], [1], 1, n_external=int(build is instruments))
    data.target[:] = np.nan_to_num(
        lfilter([0.0, 1.0, 0.4], [1, -1.9, 1.01], data.signals[0], axis=0)
    )
    _, _, kernel_paths, twin_paths = both(data, build)
    assert all(twin.inside(f) for f in kernel_paths[0][:, :2])
    np.testing.assert_allclose(kernel_paths[0], twin_paths[0], rtol=1e-5)
