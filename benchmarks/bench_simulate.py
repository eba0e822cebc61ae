"""Speed of the simulated tracking loop, alone and against its peers, in one run.

    pip install -e .
    python benchmarks/bench_simulate.py

The task is the thesis's: 8 windows of 81.92 s at 100 Hz, Runge-Kutta, second-order remnant, the
transition of C3. Figures are nanoseconds per step per run, best and median of repetitions taken in
turn. The peers integrate the same scheme, with inputs held over the step, for fewer steps. Then
the thesis's whole Monte Carlo is simulated. Exits with 1 if a target is missed.
"""

from __future__ import annotations

import os
import platform
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from statistics import median

import numba
import numpy as np
import scipy
from rich.progress import Progress
from scipy.integrate import solve_ivp

from skhoid import CompensatoryTask, Remnant, _kernels, make_tracking_runs, tune_remnant
from skhoid.simulation.engine import operator_response, physics_rows

REPEATS, BATCHES = 15, 3
PEER_STEPS, PEER_REPEATS = 1500, 3
ALONE, TOGETHER, RATIO, BATCH = 90.0, 40.0, 200.0, 20.0  # ns, ns, times, s
INTENSITIES = (0.0, 0.05, 0.10, 0.15, 0.20, 0.25, 0.30)
CONDITIONS = ("C1", "C2", "C3", "C4", "C5", "C6")
N_RUNS = 110


def timed(functions: dict[str, Callable[[], object]], repeats: int) -> dict[str, list[float]]:
    """Sorted times of each function in seconds, called in turn after a first call."""
    times: dict[str, list[float]] = {name: [] for name in functions}
    for function in functions.values():
        function()
    for _ in range(repeats):
        for name, function in functions.items():
            start = time.perf_counter()
            function()
            times[name].append(time.perf_counter() - start)
    return {name: sorted(values) for name, values in times.items()}


def task_of_c3() -> CompensatoryTask:
    return CompensatoryTask.of_condition("C3", remnant=Remnant.from_table("C3", 0.15))


def kernel_calls(task: CompensatoryTask) -> dict[str, tuple[Callable[[], object], int]]:
    """The kernel alone, for 1 run and for blocks of eight, with the runs of each."""
    n = task.n_run_in + task.n_samples
    f_t = _kernels.gate(task.target.sample(-task.n_run_in, n, task.sampling_rate)[:, None])
    white = 10 * np.random.default_rng(0).standard_normal((n, _kernels.loop.MANY))
    assert task.remnant is not None
    rest = (
        *physics_rows(task), task.remnant.filter_coefficients(), *operator_response(task).arguments,
        1 / task.sampling_rate, 1.0, task.n_run_in, 1e9,
    )  # fmt: skip
    blocks = {width: np.ascontiguousarray(white[:, :width]) for width in (1, 6, 8)}
    zero = np.zeros((n, 1))

    def alone() -> object:
        return _kernels.loop.tracker(False)(f_t, zero, blocks[1], *rest)

    def many(*widths: int) -> Callable[[], object]:
        track = _kernels.loop.tracker(False)
        return lambda: [track(f_t, zero, blocks[w], *rest) for w in widths]

    return {
        "kernel, 1 run": (alone, 1),
        "kernel, 8 runs": (many(8), 8),
        "kernel, 16 runs": (many(8, 8), 16),
        "kernel, 110 runs": (many(*[8] * 13, 6), 110),
    }


class PeerLoop:
    """The scheme of the kernel in plain NumPy, one step at a time, from rest.

    z' = A z + B (f_t, delayed output, white) with z = (2 of the operator, x, v, 2 of the remnant);
    A and B are made beforehand for every half step.
    """

    def __init__(self, task: CompensatoryTask, n_steps: int) -> None:
        assert task.remnant is not None
        (rows, begin), q = physics_rows(task), task.remnant.filter_coefficients()
        p = rows[np.clip(np.arange(2 * n_steps + 1) - 2 * begin, 0, len(rows) - 1)].T
        A, B = np.zeros((p.shape[1], 6, 6)), np.zeros((p.shape[1], 6, 3))
        A[:, 0, 1], A[:, 0, 2] = 1.0, p[5]
        A[:, 1, 0], A[:, 1, 1], A[:, 1, 2] = -p[1], -p[0], p[4] - p[0] * p[5]
        A[:, 2, 3] = 1.0
        A[:, 3, 3], A[:, 3, 5] = -p[7], p[6]
        A[:, 4, 4], A[:, 5, 4], A[:, 5, 5] = q[0], q[3], q[4]
        B[:, 0, 0], B[:, 1, 0] = p[3], p[2] - p[0] * p[3]
        B[:, 3, 1], B[:, 4, 2] = p[6], q[2] * p[8]
        self.A, self.B = A, B
        self.delay = round(task.operator.tau_e * task.sampling_rate)
        self.f_t = task.target.sample(-task.n_run_in, n_steps, task.sampling_rate)
        self.white = 10 * np.random.default_rng(0).standard_normal(n_steps)
        self.dt, self.n_steps = 1 / task.sampling_rate, n_steps

    def run(self, integrate: Callable[..., np.ndarray]) -> np.ndarray:
        z, outputs, x = np.zeros(6), np.zeros(self.n_steps + 1), np.empty(self.n_steps)
        for k in range(self.n_steps):
            outputs[k], x[k] = z[0], z[2]
            delayed = outputs[k - self.delay] if k >= self.delay else 0.0
            inputs = np.array([self.f_t[k], delayed, self.white[k]])
            z = integrate(z, inputs, k)
        return x

    def runge_kutta(self, z: np.ndarray, inputs: np.ndarray, k: int) -> np.ndarray:
        A, B, dt, i = self.A, self.B, self.dt, 2 * k
        k1 = A[i] @ z + B[i] @ inputs
        k2 = A[i + 1] @ (z + dt / 2 * k1) + B[i + 1] @ inputs
        k3 = A[i + 1] @ (z + dt / 2 * k2) + B[i + 1] @ inputs
        k4 = A[i + 2] @ (z + dt * k3) + B[i + 2] @ inputs
        return z + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

    def solve_ivp(self, z: np.ndarray, inputs: np.ndarray, k: int) -> np.ndarray:
        """One call of solve_ivp a step, as held inputs and a delay in samples ask for."""

        def rates(t: float, z: np.ndarray) -> np.ndarray:
            i = 2 * k + round(2 * t / self.dt)
            return self.A[i] @ z + self.B[i] @ inputs

        return solve_ivp(
            rates, (0.0, self.dt), z, method="RK45", first_step=self.dt, max_step=self.dt
        ).y[:, -1]

    def run_by_stretches(self) -> np.ndarray:
        """solve_ivp over one delay at a time, where all delayed outputs are known beforehand.

        Inputs jump between samples, which the error control of RK45 does not know: the kindest way
        to call it, but not quite the scheme.
        """
        z, outputs, x = np.zeros(6), np.zeros(self.n_steps + 1), np.zeros(self.n_steps)

        def rates(t: float, z: np.ndarray) -> np.ndarray:
            k = min(int(t / self.dt + 1e-9), self.n_steps - 1)
            delayed = outputs[k - self.delay] if k >= self.delay else 0.0
            i = round(2 * t / self.dt)
            return self.A[i] @ z + self.B[i] @ np.array([self.f_t[k], delayed, self.white[k]])

        for begin in range(0, self.n_steps, self.delay):
            instants = np.arange(begin, min(begin + self.delay, self.n_steps) + 1) * self.dt
            solved = solve_ivp(
                rates,
                (instants[0], instants[-1]),
                z,
                method="RK45",
                t_eval=instants,
                first_step=self.dt,
                max_step=self.dt,
                rtol=1e-2,
                atol=1e-2,
            ).y
            outputs[begin : begin + instants.size] = solved[0]
            x[begin : begin + instants.size - 1] = solved[2, :-1]
            z = solved[:, -1]
        return x


def batch_through_simulate(progress: Progress) -> int:
    """All of the Monte Carlo through CompensatoryTask.simulate; the number of steps."""
    bar = progress.add_task("CompensatoryTask.simulate", total=len(CONDITIONS) * len(INTENSITIES))
    steps = 0
    for condition in CONDITIONS:
        for seed, P_n in enumerate(INTENSITIES):
            remnant = Remnant(order=2, intensity=P_n)
            task = CompensatoryTask.of_condition(condition, remnant=remnant)
            task = tune_remnant(task, random_state=seed, n_jobs=2)
            record = task.simulate(N_RUNS, random_state=seed, n_jobs=2)
            assert record.u.shape == (N_RUNS, task.n_samples)
            steps += N_RUNS * (task.n_run_in + task.n_samples)
            progress.advance(bar)
    return steps


def batch_through_runs(progress: Progress) -> int:
    """The same as datasets, of make_tracking_runs."""
    bar = progress.add_task("make_tracking_runs", total=len(CONDITIONS) * len(INTENSITIES))
    rows = 0
    for condition in CONDITIONS:
        for seed, P_n in enumerate(INTENSITIES):
            X, _ = make_tracking_runs(
                condition, N_RUNS, remnant_intensity=P_n, random_state=seed, n_jobs=2
            )
            rows += len(X)
            progress.advance(bar)
    return 8 * rows


def cpu() -> str:
    info = Path("/proc/cpuinfo")
    names = [
        line.split(":", 1)[1].strip()
        for line in (info.read_text().splitlines() if info.exists() else [])
        if line.startswith("model name")
    ]
    return names[0] if names else platform.processor() or platform.machine()


def main() -> int:
    load = (
        "/".join(f"{value:.2f}" for value in os.getloadavg()) if hasattr(os, "getloadavg") else "?"
    )
    print(
        f"{cpu()}, {os.cpu_count()} cores, load {load}; Python {platform.python_version()}, "
        f"NumPy {np.__version__}, SciPy {scipy.__version__}, Numba {numba.__version__}"
    )
    ok = True

    def verdict(good: bool) -> str:
        nonlocal ok
        ok &= good
        return "ok" if good else "MISSED"

    task = task_of_c3()
    n_steps = task.n_run_in + task.n_samples
    calls = kernel_calls(task) | {
        "CompensatoryTask.simulate, 1 run": (lambda: task.simulate(1, random_state=0), 1),
        "CompensatoryTask.simulate, 8 runs": (lambda: task.simulate(8, random_state=0), 8),
    }
    times = timed({name: call for name, (call, _) in calls.items()}, REPEATS)

    short = replace(task, run_in=0.0, duration=PEER_STEPS / task.sampling_rate)
    loop = PeerLoop(short, PEER_STEPS)
    found = short.simulate(noise=loop.white / 10).x[0]
    peers: dict[str, Callable[[], np.ndarray]] = {
        "plain NumPy loop": lambda: loop.run(loop.runge_kutta),
        "solve_ivp (RK45), a call a step": lambda: loop.run(loop.solve_ivp),
        "solve_ivp (RK45), a call a delay": loop.run_by_stretches,
    }
    peer_times = timed(peers, PEER_REPEATS)

    print(f"{REPEATS} repetitions, {PEER_REPEATS} of the peers")
    print(f"\n{n_steps} steps a run; ns per step per run      best   median   target")
    best = {}
    for name, (_, n_runs) in calls.items():
        per_step = [1e9 * seconds / (n_steps * n_runs) for seconds in times[name]]
        best[name] = per_step[0]
        target = ""
        if name.startswith("kernel"):
            limit = ALONE if n_runs == 1 else TOGETHER
            target = f"{limit:6.0f} {verdict(per_step[0] <= limit)}"
        print(f"{name:42s} {per_step[0]:9.1f} {median(per_step):8.1f}   {target}")
    for name, peer in peers.items():
        per_step = [1e9 * seconds / PEER_STEPS for seconds in peer_times[name]]
        difference = np.abs(peer() - found).max() / np.abs(found).max()
        print(
            f"{name:42s} {per_step[0]:9.0f} {median(per_step):8.0f}   "
            f"({PEER_STEPS} steps; x differs by {difference:.0e})"
        )
        for ours in ("kernel, 1 run", "kernel, 8 runs", "CompensatoryTask.simulate, 8 runs"):
            ratio = per_step[0] / best[ours]
            target = f"{RATIO:6.0f} {verdict(ratio >= RATIO)}" if ours == "kernel, 8 runs" else ""
            print(f"    / {ours:36s} {ratio:9.0f} times       {target}")

    print(
        f"\n{N_RUNS} realisations x {len(CONDITIONS)} conditions x {len(INTENSITIES)} intensities"
    )
    batches: dict[str, Callable[[Progress], int]] = {
        "CompensatoryTask.simulate": batch_through_simulate,
        "make_tracking_runs": batch_through_runs,
    }
    batch_times: dict[str, list[float]] = {name: [] for name in batches}
    with Progress(transient=True) as progress:
        for _ in range(BATCHES):
            for name, batch in batches.items():
                start = time.perf_counter()
                steps = batch(progress)
                batch_times[name].append(time.perf_counter() - start)
    for name, seconds in batch_times.items():
        print(
            f"{name:42s} {min(seconds):7.1f} s, median {median(seconds):.1f} s of {BATCHES}, for "
            f"{steps / 1e6:.0f} million steps, n_jobs=2 (target {BATCH:g} s) "
            f"{verdict(min(seconds) <= BATCH)}"
        )
    return 0 if ok else 1


if __name__ == "__main__":
    sys.exit(main())
