"""Speed of recursive least squares against its peers, in one run, and what each survives.

    pip install -e ".[bench]"
    python benchmarks/bench_recursion.py

The task is the thesis's: four parameters of an ARX[2,2] model, λ = 1 - 1/256. Figures are best and
median of repetitions taken in turn. Peers are given the ready regressors, which skhoid builds
itself. A peer that is not installed is left out. Exits with 1 if a target is missed.
"""

from __future__ import annotations

import os
import platform
import sys
import warnings
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from itertools import islice
from statistics import median

import numba
import numpy as np
import pandas as pd
import sklearn
from bench_simulate import cpu, timed
from numba import njit
from scipy.signal import lfilter
from sklearn.model_selection import GridSearchCV, LeaveOneGroupOut

from skhoid import RecursiveARX, RecursiveARXCV, VAFScorer, _kernels, make_tracking_runs, run_labels
from skhoid.arx.forgetting import kernel_arrays
from skhoid.arx.rls import RecursionState

N_ROWS, LANE_ROWS, PEER_ROWS = 65536, 8192, 1500
REPEATS, PEER_REPEATS, SEARCH_REPEATS, GRID_REPEATS = 40, 10, 20, 2
NK, FIRST, LANES = 29, 30, 16  # delay, first row with all regressors, lanes
TRUTH = np.array([-1.91211, 0.92427, 0.04428, -0.04318])
FORGETTING, P0 = 1 - 1 / 256, 1e4
SHORT = 0.95  # the forgetting factor of the pause
EXCITED, PAUSE, AFTER = 2000, 16000, 60  # AFTER is 3 N0

ONE, BATCH, WANTED, SHARE, FREE = 35.0, 14.0, 8.0, 0.5, 3.0  # ns, a share, ns
ROW, BLOCK_ROW, SEARCH = 9.0, 0.1, 120.0  # µs, µs, ms
EXACT, BACK = 1e-10, 1.0  # relative, %
UNITS = {"ns": 1e9, "µs": 1e6, "ms": 1e3}

Read = Callable[[], np.ndarray]
Peer = Callable[[np.ndarray, np.ndarray, float], Iterator[Read]]


def operator_data(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Smooth input and the output of the thesis's operator model, state 1, with ARX noise."""
    rng = np.random.default_rng(seed)
    e = lfilter([0.1], [1, -0.9], rng.standard_normal(N_ROWS))
    numerator = np.zeros(NK + 2)
    numerator[NK:] = TRUTH[2:]
    noise = 0.002 * rng.standard_normal(N_ROWS)
    y = lfilter(numerator, [1, *TRUTH[:2]], e) + lfilter([1], [1, *TRUTH[:2]], noise)
    return e[:, None], y


def regressors(X: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ready regressors of an ARX[2,2] model and their targets."""
    e = X[:, 0]
    phi = np.column_stack([-y[FIRST - 1 : -1], -y[FIRST - 2 : -2], e[1 : 1 - FIRST], e[:-FIRST]])
    return np.ascontiguousarray(phi), y[FIRST:].copy()


# Each peer is a generator: it learns one sample and yields how to read its parameters. Peers that
# take a whole record learn it at once. All start from zeros and P0 I.


def padasip_rls(phi: np.ndarray, u: np.ndarray, forgetting: float) -> Iterator[Read]:
    from padasip.filters import FilterRLS

    rls = FilterRLS(phi.shape[1], mu=forgetting, eps=1 / P0, w="zeros")
    for row, target in zip(phi, u, strict=True):
        rls.adapt(target, row)
        yield lambda: rls.w


def river_bayesian(phi: np.ndarray, u: np.ndarray, forgetting: float) -> Iterator[Read]:
    """River's information form: P⁻¹ is smoothed, and inverted at every sample."""
    from river.linear_model import BayesianLinearRegression

    # Smoothing begins from I / alpha as information, although alpha I is the documented prior.
    alpha = P0 / (1 - forgetting)
    model = BayesianLinearRegression(alpha=alpha, smoothing=forgetting)
    return _river(model, phi, u)


def river_sgd(phi: np.ndarray, u: np.ndarray, forgetting: float) -> Iterator[Read]:
    from river.linear_model import LinearRegression

    return _river(LinearRegression(intercept_lr=0.0), phi, u)


def _river(model: object, phi: np.ndarray, u: np.ndarray) -> Iterator[Read]:
    names = range(phi.shape[1])

    def read() -> np.ndarray:
        return np.array([model.predict_one({name: 1.0}) for name in names])

    for row, target in zip(phi.tolist(), u.tolist(), strict=True):
        model.learn_one(dict(zip(names, row, strict=True)), target)
        yield read


def filterpy_fading(phi: np.ndarray, u: np.ndarray, forgetting: float) -> Iterator[Read]:
    from filterpy.kalman import KalmanFilter

    kalman = KalmanFilter(dim_x=phi.shape[1], dim_z=1)
    kalman.P *= P0
    kalman.Q[:] = 0.0
    kalman.alpha = forgetting**-0.5
    for row, target in zip(phi, u, strict=True):
        kalman.predict()
        kalman.update(target, H=row[None])
        yield lambda: kalman.x[:, 0]


def sklearn_sgd(phi: np.ndarray, u: np.ndarray, forgetting: float) -> Iterator[Read]:
    from sklearn.linear_model import SGDRegressor

    model = SGDRegressor(penalty=None, fit_intercept=False, learning_rate="constant")
    for k in range(len(u)):
        model.partial_fit(phi[k : k + 1], u[k : k + 1])
        yield lambda: model.coef_


def statsmodels_rls(phi: np.ndarray, u: np.ndarray, forgetting: float) -> Iterator[Read]:
    """Without forgetting, which it does not have."""
    from statsmodels.regression.recursive_ls import RecursiveLS

    found = RecursiveLS(u, phi).fit()
    return _rows(found.recursive_coefficients.filtered.T)


def sysidentpy_rls(phi: np.ndarray, u: np.ndarray, forgetting: float) -> Iterator[Read]:
    from sysidentpy.parameter_estimation import RecursiveLeastSquares

    rls = RecursiveLeastSquares(lam=forgetting, delta=1 / P0)
    # It never reads the first two rows.
    phi, u = np.vstack([phi[:2], phi]), np.concatenate([u[:2], u])
    rls.optimize(phi, u[:, None])
    return _rows(rls.theta_evolution.T[2:])


def pydlm_dynamic(phi: np.ndarray, u: np.ndarray, forgetting: float) -> Iterator[Read]:
    from pydlm import dlm, dynamic

    model = dlm(u.tolist()) + dynamic(phi.tolist(), discount=forgetting, name="arx", w=P0)
    model.setLoggingLevel("CRITICAL")
    model.fitForwardFilter()
    return _rows(np.array(model.getLatentState()))


def numpy_loop(phi: np.ndarray, u: np.ndarray, forgetting: float) -> Iterator[Read]:
    theta, P = np.zeros(phi.shape[1]), P0 * np.eye(phi.shape[1])
    for row, target in zip(phi, u, strict=True):
        g = P @ row
        gain = g / (forgetting + row @ g)
        theta += gain * (target - row @ theta)
        P = (P - np.outer(gain, g)) / forgetting
        yield theta.view


@njit
def textbook(phi, u, forgetting, printed):
    """The update of the textbooks, or, ``printed``, with Eq. 16 as it stands in the thesis."""
    n = phi.shape[1]
    theta, P, g, gain, left = np.zeros(n), P0 * np.eye(n), np.zeros(n), np.zeros(n), np.zeros(n)
    path = np.empty(phi.shape)
    for t in range(phi.shape[0]):
        alpha, error = forgetting, u[t]
        for i in range(n):
            g[i] = 0.0
            for j in range(n):
                g[i] += P[i, j] * phi[t, j]
            alpha += phi[t, i] * g[i]
            error -= phi[t, i] * theta[i]
        for i in range(n):
            gain[i] = g[i] / alpha
            theta[i] += gain[i] * error
            path[t, i] = theta[i]
        if printed:
            for i in range(n):
                left[i] = 0.0
                for j in range(n):
                    left[i] += P[i, j] * gain[j]
            for i in range(n):
                for j in range(n):
                    P[i, j] = (P[i, j] - left[i] * phi[t, j]) / forgetting
        else:
            for i in range(n):
                for j in range(n):
                    P[i, j] = (P[i, j] - gain[i] * g[j]) / forgetting
    return path


def numba_loop(phi: np.ndarray, u: np.ndarray, forgetting: float) -> Iterator[Read]:
    return _rows(textbook(phi, u, forgetting, False))


def _rows(path: np.ndarray) -> Iterator[Read]:
    rows = iter(path)
    for _ in range(len(path)):
        yield lambda: next(rows)


# name, what must be installed, the peer, and the λ for which its algorithm is that of skhoid
PEERS: list[tuple[str, str, Peer, float | None]] = [
    ("padasip FilterRLS.adapt", "padasip", padasip_rls, FORGETTING),
    ("filterpy KalmanFilter, alpha = λ^-1/2", "filterpy", filterpy_fading, FORGETTING),
    ("river BayesianLinearRegression, smoothing", "river", river_bayesian, FORGETTING),
    ("river LinearRegression (SGD)", "river", river_sgd, None),
    ("SysIdentPy RecursiveLeastSquares", "sysidentpy", sysidentpy_rls, FORGETTING),
    ("PyDLM dynamic, discount", "pydlm", pydlm_dynamic, FORGETTING),
    ("statsmodels RecursiveLS (λ = 1)", "statsmodels", statsmodels_rls, 1.0),
    ("scikit-learn SGDRegressor.partial_fit", "sklearn", sklearn_sgd, None),
    ("plain NumPy loop", "numpy", numpy_loop, FORGETTING),
    ("plain numba loop", "numba", numba_loop, FORGETTING),
]


def installed_peers(say: bool = True) -> list[tuple[str, Peer, float | None]]:
    """The peers that can be imported; ``say`` prints a line for each other one."""
    found = []
    for name, module, peer, same in PEERS:
        try:
            import_module(module)
        except Exception as error:  # an old peer may fail in any way on a new NumPy
            if say:
                print(f"{name} is left out: {type(error).__name__}: {error}")
        else:
            found.append((name, peer, same))
    return found


def drained(peer: Peer, phi: np.ndarray, u: np.ndarray) -> Callable[[], object]:
    return lambda: deque(peer(phi, u, FORGETTING), maxlen=0)


def path_of(peer: Peer, phi: np.ndarray, u: np.ndarray, forgetting: float) -> np.ndarray:
    return np.array([np.array(read()) for read in peer(phi, u, forgetting)])


def death(peer: Peer, phi: np.ndarray, u: np.ndarray) -> int | None:
    """First sample, counted from 1, after which parameters are not finite or learning fails."""
    k = -1
    try:
        for k, read in enumerate(peer(phi, u, SHORT)):
            if not np.isfinite(read()).all():
                return k + 1
    except (np.linalg.LinAlgError, ArithmeticError, ValueError):
        return k + 2
    return None


def paused_record(X: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """EXCITED samples with all regressors, PAUSE zeros, and another record, from rest.

    Missing outputs keep the jump to zero out of the regression.
    """
    begin, (X_after, y_after) = FIRST + EXCITED, operator_data(1)
    gap = np.zeros(PAUSE + FIRST + 3)
    X = np.concatenate([X[:begin], gap[:, None], X_after[:AFTER]])
    y = np.concatenate([y[:begin], gap, y_after[:AFTER]])
    y[begin : begin + FIRST + 1] = np.nan
    return X, y


@contextmanager
def quiet() -> Iterator[None]:
    """Silence peers that overflow or warn of their own use of NumPy."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        yield


def largest(found: np.ndarray, wanted: np.ndarray) -> float:
    return float(np.abs(found - wanted).max())


def aligned(values: np.ndarray) -> np.ndarray:
    """A copy that begins at a cache line, as what the package makes for its lanes."""
    copy = _kernels.aligned(values.shape)
    copy[:] = values
    return copy


class Lanes:
    """Calls of the kernels from rest, lanes side by side, without the checks around them."""

    def __init__(self, X: np.ndarray, y: np.ndarray, forgetting: np.ndarray) -> None:
        """X and y of shape (n_rows, 1 or n_lanes), forgetting of shape (1 or 4, n_lanes)."""
        X, y = aligned(X), aligned(y)
        n, lanes = len(y), forgetting.shape[1]
        advance = _kernels.rls.recursion(lanes, X.shape[1] < lanes, 4 if lanes == 1 else 0)
        state = RecursionState(np.zeros(4), P0 * np.eye(4), lanes).buffer
        rest = state.copy()
        signals = aligned(np.stack([-y, X]))[:, :, None]
        recording = np.stack([y[:, 0], X[:, 0]])
        columns, lags = np.array([0, 0, 1, 1]), np.array([1, 2, NK, NK + 1])
        inflate, tilt = kernel_arrays(forgetting[None])
        path, none = _kernels.aligned((n, 4, lanes)), np.empty((0, 0, 0))
        path[:FIRST] = 0.0
        out = np.zeros((n - FIRST, lanes))
        stretch, rows = (np.array([FIRST]), np.array([n]), np.array([0])), np.arange(n)

        def learn() -> None:
            state[:] = rest
            advance(
                signals, y[:, None], columns, lags, FIRST, n, inflate, tilt, 0, False, 0.0, state,
                path, none, none, none, none, np.empty((0, 0)),
            )  # fmt: skip

        def run() -> object:
            return _kernels.rls.free_runs(
                recording, columns, lags, 2, *stretch, path, rows, 1e100, out
            )

        self.learn, self.run, self.path = learn, run, path
        self.samples = (n - FIRST) * lanes


def exact_theta(phi: np.ndarray, u: np.ndarray, forgetting: float) -> np.ndarray:
    """Exponentially weighted least squares of all rows, by QR."""
    weights = np.sqrt(forgetting) ** np.arange(len(u), -1, -1)
    rows = np.vstack([weights[0] / np.sqrt(P0) * np.eye(phi.shape[1]), phi * weights[1:, None]])
    values = np.concatenate([np.zeros(phi.shape[1]), u * weights[1:]])
    return np.linalg.lstsq(rows, values, rcond=None)[0]


class Report:
    """Lines of best and median, and whether every required target is met."""

    def __init__(self) -> None:
        self.ok = True

    def judge(self, value: float, limit: float) -> str:
        good = value <= limit
        self.ok &= good
        return f"<= {limit:g} {'ok' if good else 'MISSED'}"

    def line(
        self,
        name: str,
        seconds: list[float],
        per: float,
        unit: str,
        limit: float | None = None,
        note: str = "",
    ) -> float:
        """Print one line of times, each for ``per`` samples or calls; return the best."""
        values = [UNITS[unit] * value / per for value in seconds]
        target = "" if limit is None else self.judge(values[0], limit)
        print(f"{name:47s} {values[0]:9.2f} {median(values):9.2f} {unit}  {target:16s} {note}")
        return values[0]


def speed_of_kernels(report: Report, X: np.ndarray, y: np.ndarray) -> tuple[float, np.ndarray]:
    """One run, lanes and free runs; ns per sample of a fit, and its path."""
    n, one = LANE_ROWS, Lanes(X, y[:, None], np.array([[FORGETTING]]))
    records = [operator_data(seed) for seed in range(LANES)]
    runs = Lanes(
        np.column_stack([e[:n, 0] for e, _ in records]),
        np.column_stack([u[:n] for _, u in records]),
        np.full((1, LANES), FORGETTING),
    )
    settings = Lanes(X[:n], y[:n, None], 1 - 0.5 ** np.arange(1, LANES + 1)[None])
    given, searched = from_zeros(), RecursiveARX(nk=NK, forgetting=FORGETTING, dt=0.01)
    phi, u = regressors(X, y)
    share = f"{LANES} {{}} side by side, a lane"
    cases: list[tuple[str, Callable[[], object], int, float | None]] = [
        ("kernel, one run", one.learn, one.samples, ONE),
        ("plain numba loop", lambda: textbook(phi, u, FORGETTING, False), len(u), None),
        ("kernel, " + share.format("runs"), runs.learn, runs.samples, BATCH),
        ("kernel, " + share.format("settings"), settings.learn, settings.samples, BATCH),
        ("free run, one path", one.run, one.samples, None),
        ("free run, " + share.format("paths"), settings.run, settings.samples, FREE),
        (f"RecursiveARX.fit from zeros, {N_ROWS} rows", lambda: given.fit(X, y), N_ROWS, None),
        (f"RecursiveARX.fit, {N_ROWS} rows", lambda: searched.fit(X, y), N_ROWS, None),
    ]
    times = timed({name: call for name, call, *_ in cases}, REPEATS)
    best = {}
    for name, _, samples, limit in cases:
        note = f"(wanted {WANTED:g})" if limit == BATCH else ""
        best[name] = report.line(name, times[name], samples, "ns", limit, note)
        if limit == BATCH:
            share = best[name] / best["kernel, one run"]
            print(f"{'    / kernel, one run':47s} {share:9.2f} {report.judge(share, SHARE):>32s}")
    path = given.coef_path_[FIRST:]
    print(
        f"largest difference of RecursiveARX.fit from the kernel "
        f"{largest(path, one.path[FIRST:, :, 0]):.0e}, "
        f"from lanes {largest(path[: n - FIRST], runs.path[FIRST:, :, 0]):.0e}"
    )
    return best[cases[-2][0]], path


def streams(X: np.ndarray, y: np.ndarray) -> dict[str, tuple[Callable[[], object], int]]:
    """Streaming in rows and blocks, each call going on from the one before, with its rows."""
    index = pd.MultiIndex.from_product([["1"], np.arange(N_ROWS) / 100], names=["run", "time"])
    frame, series = pd.DataFrame({"e": X[:, 0]}, index), pd.Series(y, index, name="u")

    def stream(cut: Callable[[slice], tuple], size: int, calls: int) -> tuple:
        model = from_zeros().partial_fit(*cut(slice(1000)))
        begins = 1000 + np.arange(calls * (PEER_REPEATS + 1)) * size % (N_ROWS - 1000 - size)
        pieces = iter([cut(slice(begin, begin + size)) for begin in begins])

        def run() -> None:
            for piece in islice(pieces, calls):
                model.partial_fit(*piece)

        return run, calls * size

    return {
        "partial_fit, a NumPy row": stream(lambda k: (X[k], y[k]), 1, PEER_ROWS),
        "partial_fit, a row in lists": stream(lambda k: (X[k].tolist(), y[k].tolist()), 1, 100),
        "partial_fit, a row in a DataFrame": stream(
            lambda k: (frame.iloc[k], series.iloc[k]), 1, 100
        ),
        "partial_fit, 1000 rows, a row": stream(lambda k: (X[k], y[k]), 1000, 10),
    }


def from_zeros(forgetting: float = FORGETTING, p0: float = P0) -> RecursiveARX:
    return RecursiveARX(nk=NK, forgetting=forgetting, init="zeros", p0=p0)


def speed_of_peers(
    report: Report, X: np.ndarray, y: np.ndarray, fit: float, path: np.ndarray
) -> None:
    """Streaming beside the peers, sample by sample, and whether they find the same."""
    phi, u = (values[:PEER_ROWS] for values in regressors(X, y))
    ours, peers = streams(X, y), installed_peers()
    calls = {name: call for name, (call, _) in ours.items()}
    with quiet():
        times = timed(
            calls | {name: drained(peer, phi, u) for name, peer, _ in peers}, PEER_REPEATS
        )
    row, *_, block = ours
    limits = {row: ROW, block: BLOCK_ROW}
    found = {
        name: report.line(name, times[name], rows, "µs", limits.get(name))
        for name, (_, rows) in ours.items()
    }
    print(f"{'':88s} / fit   / partial_fit")
    n = FIRST + PEER_ROWS
    # statsmodels starts from an infinite P0, so only its end is comparable.
    endless = from_zeros(1.0, p0=1e10).fit(X[:n], y[:n])
    paths = {FORGETTING: path[:PEER_ROWS], 1.0: endless.coef_[None]}
    for name, peer, same in peers:
        agreement = "another algorithm"
        if same is not None:
            with quiet():
                theirs = path_of(peer, phi, u, FORGETTING)[-len(paths[same]) :]
            agreement = f"differs by {largest(theirs, paths[same]):.0e}"
        best = times[name][0] / PEER_ROWS
        ratios = f"{1e9 * best / fit:7.0f} {1e6 * best / found[row]:10.2f}"
        report.line(name, times[name], PEER_ROWS, "µs", note=f"{ratios}     {agreement}")


def same_bits(report: Report, X: np.ndarray, y: np.ndarray) -> None:
    """Streaming in any cut against fit."""
    n = 3000
    wanted = from_zeros().fit(X[:n], y[:n]).coef_
    for cuts in ([n], [1] * n, [1000] * 3, [1, 999, 7, 1993]):
        model, begin = from_zeros(), 0
        for size in cuts:
            model.partial_fit(X[begin : begin + size], y[begin : begin + size])
            begin += size
        same = np.array_equal(model.coef_, wanted)
        report.ok &= same
        print(f"partial_fit in {len(cuts):4d} pieces equals fit bit for bit: {same}")


def exactness(report: Report, X: np.ndarray, y: np.ndarray) -> None:
    """Paths against exact least squares, and where updates of the textbooks go wrong."""
    phi, u = regressors(X, y)
    print(f"\n{len(u)} excited samples; first sample at which an update is 1 % off skhoid")
    print("                        skhoid from exact LS   P - K (P φ)'   Eq. 16 as printed")
    for forgetting in (0.95, 0.99, FORGETTING, 1.0):
        path = from_zeros(forgetting).fit(X, y).coef_path_[FIRST:]
        worst = max(
            largest(path[stop - 1], exact_theta(phi[:stop], u[:stop], forgetting))
            for stop in (50, 500, 5000, 20000, 40000, len(u))
        )
        wrong = [
            first_wrong(textbook(phi, u, forgetting, printed), path) for printed in (False, True)
        ]
        print(
            f"λ = {forgetting:7.5f}             {worst:8.0e} {report.judge(worst, EXACT):16s}"
            f"{wrong[0]:>10s} {wrong[1]:>18s}"
        )


def first_wrong(found: np.ndarray, wanted: np.ndarray) -> str:
    off = np.linalg.norm(found - wanted, axis=1) > 0.01 * np.linalg.norm(wanted, axis=1)
    wrong = np.flatnonzero(off | ~np.isfinite(found).all(axis=1))
    return str(wrong[0] + 1) if wrong.size else "never"


def survival(report: Report, X: np.ndarray, y: np.ndarray) -> None:
    """What a pause does at λ = 0.95, and what as many excited samples do."""
    n = EXCITED + PAUSE
    excited = [values[:n] for values in regressors(X, y)]
    record = paused_record(X, y)
    phi, u = regressors(*record)
    known = np.isfinite(np.column_stack([phi, u])).all(axis=1)
    phi, u = phi[known], u[known]
    told = np.r_[:EXCITED, n : len(u)]
    wanted = exact_theta(phi[told], u[told], SHORT)
    with quiet():  # RecursiveARX warns of the missing outputs
        model = from_zeros(SHORT).fit(*record)
    off = 100 * np.linalg.norm(model.coef_ - wanted) / np.linalg.norm(wanted)
    finite = bool(np.isfinite(model.coef_path_).all())
    report.ok &= finite
    print(
        f"\n{PAUSE} zero samples at λ = {SHORT}, after {EXCITED} excited ones\n"
        f"RecursiveARX: {'finite' if finite else 'NaN'}; {AFTER} samples after it {off:.1g} % "
        f"off a run without, {report.judge(off, BACK)}; forgetting held {model.n_held_} times"
    )
    print(f"{'first NaN or error at':47s} sample of the pause   of {n} excited samples")
    for name, peer, same in installed_peers(say=False):
        if same == FORGETTING:
            with quiet():
                died, worn = death(peer, phi, u), death(peer, *excited)
            if died is None:
                fate = "survives"
            else:
                fate = str(died - EXCITED) if died <= n else "just after it"
            print(f"{name:47s} {fate:>19s}   {'none' if worn is None else worn:>8}")


def speed_of_search(report: Report) -> None:
    """Every memory horizon, leave-one-run-out, against GridSearchCV."""
    X, y = make_tracking_runs("C4", n_runs=10, remnant_intensity=0.15, random_state=0)
    horizons = [*(2.0 ** np.arange(1, 14)), np.inf]
    search = RecursiveARXCV(nk=NK, n_jobs=2)
    grid = GridSearchCV(
        RecursiveARX(nk=NK),
        {"memory_horizon": horizons},
        scoring=VAFScorer(),
        cv=LeaveOneGroupOut(),
        n_jobs=2,
    )
    groups = run_labels(X)
    print(f"\n{len(horizons)} memory horizons, 10 runs, leave-one-run-out, {len(X)} rows, n_jobs=2")
    quick = timed({"search": lambda: search.fit(X, y)}, SEARCH_REPEATS)["search"]
    slow = timed({"grid": lambda: grid.fit(X, y, groups=groups)}, GRID_REPEATS)["grid"]
    found = report.line("RecursiveARXCV.fit", quick, 1, "ms", SEARCH)
    peer = report.line("GridSearchCV.fit", slow, 1, "ms")
    scores = [model.cv_results_["mean_test_score"] for model in (search, grid)]
    print(
        f"GridSearchCV takes {peer / found:.0f} times as long; scores differ by "
        f"{largest(*scores):.0e}; best N0 {search.best_memory_horizon_:g}"
    )


def main() -> int:
    load = f"{os.getloadavg()[0]:.2f}" if hasattr(os, "getloadavg") else "?"
    print(
        f"{cpu()}, {os.cpu_count()} cores, load {load}; Python {platform.python_version()}, "
        f"NumPy {np.__version__}, scikit-learn {sklearn.__version__}, Numba {numba.__version__}"
    )
    report = Report()
    X, y = operator_data()
    print(f"\n{REPEATS} repetitions, per sample {'':27s} best    median     target")
    fit, path = speed_of_kernels(report, X, y)
    print(f"\n{PEER_REPEATS} repetitions, per sample {'':27s} best    median     target")
    speed_of_peers(report, X, y, fit, path)
    same_bits(report, X, y)
    exactness(report, X, y)
    survival(report, X, y)
    speed_of_search(report)
    return 0 if report.ok else 1


if __name__ == "__main__":
    sys.exit(main())
