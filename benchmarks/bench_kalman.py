"""OperatorKalman: speed, accuracy beside recursive least squares, and bad starts.

    python benchmarks/bench_kalman.py speed
    python benchmarks/bench_kalman.py tracking [--intensity 0.15] [--rate 100] [--runs 10]
    python benchmarks/bench_kalman.py starts [--runs 200]

Defaults were tuned on seeds below 1000; ``tracking`` and ``starts`` use seeds from 5000 on.
"""

from __future__ import annotations

import argparse
import time
import warnings

import numpy as np

from skhoid import RecursiveARX, make_tracking_runs, operator_parameters
from skhoid._kernels import kalman
from skhoid.tracking.operator_kalman import OperatorKalman

NAMES = ("K_e", "K_edot", "omega_nm", "zeta_nm", "tau_e")
METHODS = ("ukf", "ekf", "dual_ekf")
SEED = 5000
SETTLED, LAST = 10.0, 20.0  # s from the start that do not count, and s at the end


def speed(repeats: int = 5) -> None:
    """Time per sample of a lane, and per row of a stream: the best of some repeats."""
    X, y = make_tracking_runs("C3", n_runs=8, remnant_intensity=0.15, random_state=SEED)
    e, u = (np.ascontiguousarray(s.to_numpy().reshape(8, -1)) for s in (X["e"], y))
    fresh = np.zeros(e.shape, dtype=np.int8)
    fresh[:, 0] = 1
    nothing, path = np.empty((0, 0, 0)), np.zeros((*e.shape, kalman.N_PATH))
    for order in (0, 1, 2):
        for number, method in enumerate(METHODS):
            model = OperatorKalman(method, remnant_order=order).fit(X, y)
            settings = np.concatenate([f.settings for f in model._filters])
            states = np.concatenate([f.state for f in model._filters])
            best = np.inf
            for _ in range(repeats):
                begin = time.perf_counter()
                kalman.advance(
                    number, states.copy(), settings, e, u, fresh, 0, e.shape[1],
                    path, nothing, nothing, nothing, np.empty((0, 0, 0, 0)),
                )  # fmt: skip
                best = min(best, time.perf_counter() - begin)
            print(f"{method:9s} {7 + order} states, 8 lanes: {best / e.size * 1e6:.2f} us a sample")
    for method in METHODS:
        model = OperatorKalman(method, dt=0.01).fit(e[0, :3000, None], u[0, :3000])
        best = np.inf
        for _ in range(repeats):
            begin = time.perf_counter()
            for t in range(3000, 5000):
                model.partial_fit(e[0, t : t + 1, None], u[0, t : t + 1])
            best = min(best, time.perf_counter() - begin)
        print(f"{method:9s} partial_fit: {best / 2000 * 1e6:.1f} us a row")


def paths(X, y, rate):
    """Path of each method on one run, with standard errors where it has them."""
    nk = round(0.28 * rate) + 1
    for method in METHODS:
        yield method, OperatorKalman(method).fit(X, y).parameters_path_
    for memory in (2.56, 5.12):
        model = RecursiveARX(nk=nk, memory_time=memory).fit(X, y)
        yield f"RLS {memory:g} s", operator_parameters(model)


def tracking(intensity: float, rate: float, n_runs: int) -> None:
    """Median bias and RMSE of the last 20 s, error of K_edot over time, and coverage."""
    print(f"P_n = {intensity:g}, {rate:g} Hz, {n_runs} runs of each condition and remnant order")
    everything: dict[str, list] = {}
    for condition in ("C1", "C2", "C3", "C4", "C5", "C6"):
        found: dict[str, list] = {}
        for order in (1, 2, 3, 4):
            X, y, truth = make_tracking_runs(
                condition, n_runs=n_runs, remnant_intensity=intensity, remnant_order=order,
                sampling_rate=rate, random_state=SEED + order, return_truth=True,
            )  # fmt: skip
            table = truth.parameters
            table = table.loc[0] if table.index.nlevels > 1 else table
            true = table[list(NAMES)].to_numpy()
            true = np.broadcast_to(true, (len(X.loc[0]), len(NAMES)))
            for run in range(n_runs):
                for name, path in paths(X.loc[[run]], y.loc[[run]], rate):
                    found.setdefault(name, []).append(judged(path, true, rate))
        for name, rows in found.items():
            everything.setdefault(name, []).extend(rows)
            tell(f"{condition} {name}", rows)
    for name, rows in everything.items():
        tell(f"all {name}", rows)


def judged(path, true, rate):
    """Relative bias and RMSE at the end, median error of K_edot, and coverage, of one run."""
    relative = np.full(true.shape, np.nan)
    inside = np.full(true.shape, np.nan)
    for i, name in enumerate(NAMES):
        if name in path:
            values = path[name].to_numpy()
            relative[:, i] = values / true[:, i] - 1
            if f"sd_{name}" in path:
                sd = path[f"sd_{name}"].to_numpy()
                covered = abs(values - true[:, i]) < 1.96 * sd
                inside[:, i] = np.where(np.isfinite(sd), covered, np.nan)
    late = relative[-round(LAST * rate) :]
    settled = slice(round(SETTLED * rate), None)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # runs in which RLS never has an operator's poles
        error = np.nanmedian(abs(relative[settled, 1]))
        ends = np.nanmean(late, axis=0), np.sqrt(np.nanmean(late**2, axis=0))
        covered = np.nanmean(inside[settled], axis=0)
    return *ends, error, covered


def tell(label, rows):
    bias, rmse, error, coverage = (np.array(column) for column in zip(*rows, strict=True))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what a method does not estimate
        numbers = [100 * np.nanmedian(bias, axis=0), 100 * np.nanmedian(rmse, axis=0)]
        inside = 100 * np.nanmean(coverage, axis=0)
    print(
        f"{label:14s} bias % {numbers[0].round(1)}  RMSE % {numbers[1].round(1)}  "
        f"|K_edot| % {100 * np.nanmean(error):.1f}  coverage % {inside.round(0)}  "
        f"without any estimate: {np.isnan(error).sum()} of {len(error)} runs",
        flush=True,
    )


def starts(n_runs: int) -> None:
    """Starts up to a factor of two from the truth: what stays bounded and what comes back."""
    X, y = make_tracking_runs("C1", n_runs=10, remnant_intensity=0.1, random_state=SEED)
    true = {"K_e": 0.09, "K_edot": 0.036, "omega_nm": 11.25, "zeta_nm": 0.35, "tau_e": 0.28}
    for method in METHODS:
        rng = np.random.default_rng(SEED)
        finite, back = 0, []
        for i in range(n_runs):
            factors = np.exp(rng.uniform(-np.log(2), np.log(2), 5))
            init = {name: value * f for (name, value), f in zip(true.items(), factors, strict=True)}
            data = X.loc[[i % 10]], y.loc[[i % 10]]
            path = OperatorKalman(method, init=init).fit(*data).parameters_path_
            finite += bool(np.isfinite(path.to_numpy()).all())
            end = path.iloc[-1]
            back.append([abs(end[name] / value - 1) < 0.3 for name, value in true.items()])
        back = np.array(back)
        each = dict(zip(true, (100 * back.mean(axis=0)).round().tolist(), strict=True))
        print(f"{method}: finite {finite} of {n_runs}; within 30 % at the end (% of starts): "
              f"all {100 * back.all(axis=1).mean():.0f}, {each}")  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=["speed", "tracking", "starts"])
    parser.add_argument("--intensity", type=float, default=0.15)
    parser.add_argument("--rate", type=float, default=100.0)
    parser.add_argument("--runs", type=int, default=10)
    options = parser.parse_args()
    warnings.simplefilter("ignore", UserWarning)
    if options.what == "speed":
        speed()
    elif options.what == "tracking":
        tracking(options.intensity, options.rate, options.runs)
    else:
        starts(options.runs)


if __name__ == "__main__":
    main()
