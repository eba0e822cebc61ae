"""Fig. 13 at full size: time, memory, and time by stage.

    python benchmarks/bench_study.py [--jobs 2]

6 conditions x 7 intensities x 28 settings x 100 estimation and 10 validation runs: 117,600
recursive fits and 1.18 million simulations of models, the loops simulated too. Stages are timed in
one process on one cell, and given for all 42. Exits with 1 if a target is missed.
"""

from __future__ import annotations

import argparse
import resource
import sys
from time import perf_counter

import numpy as np
from bench_simulate import cpu

from skhoid import _kernels
from skhoid.arx.many_runs import (
    BOUND,
    FORMS,
    NO_FORGETTING,
    ORDERS,
    TRANSITION,
    _begun,
    _inflation,
    fit_runs,
    search_delays,
)
from skhoid.arx.recursive_cv import HORIZONS
from skhoid.arx.rls import recurse
from skhoid.lab.studies import MonteCarloStudy, paper_study
from skhoid.lab.studies.declared import CONDITIONS, INTENSITIES
from skhoid.lab.studies.memory_horizons import KEPT, candidate_delays, shifted

CELLS, ESTIMATION, VALIDATION = len(CONDITIONS) * len(INTENSITIES), 100, 10
SECONDS, GIBIBYTES = 60.0, 2.0


def stages() -> dict[str, float]:
    """Seconds of each stage for one cell, C4 with P_n = 0.15."""
    taken: dict[str, float] = {}

    def timed(name: str, begin: float) -> float:
        taken[name] = taken.get(name, 0.0) + perf_counter() - begin
        return perf_counter()

    study = MonteCarloStudy(
        len,
        {"condition": ["C4"], "remnant_intensity": [0.15]},
        ESTIMATION,
        n_validation_runs=VALIDATION,
        simulation={"keep_run_in": KEPT, "remnant_gain": "table"},
        batched=True,
        random_state=0,
    )
    job = study._job(study._cells[0]["task"], 0, range(ESTIMATION))
    for name in ("compiling", "simulating the loops"):
        begin = perf_counter()
        block = job.block(range(ESTIMATION))
        timed(name, begin)
    before, (first, end) = int((block.record.time < 0).sum()), TRANSITION
    e, u, e_v, u_v = block.record.e, block.record.u, block.validation.e, block.validation.u
    nks = candidate_delays(block.task)
    search_delays(e[:2], u[:2], before, nks)
    begin = perf_counter()
    losses, _ = search_delays(e, u, before, nks)
    begin = timed("delay search", begin)
    lanes = _kernels.trade_off.WIDTH
    factors = 1 - 1 / np.array(HORIZONS)
    for run in range(ESTIMATION):
        nk = int(nks[losses[run].argmin()])
        x = shifted(np.concatenate([e[[run]], e_v]), before, nk, extra=1)
        y = np.concatenate([u[[run], before:], u_v[:, before:]])
        begin = perf_counter()
        theta0 = fit_runs(x[:1, 1 : first + 1], y[:1, :first])[0]
        begin = timed("theta0", begin)
        signals = np.stack([-y[0, :end], x[0, 1 : end + 1]])[:, :, None, None]
        target = y[0, :end, None, None].copy()
        for form in FORMS:
            inflation = _inflation(tuple(factors.tolist()), form, lanes)
            begin = perf_counter()
            path = recurse(
                _begun(theta0, lanes), signals, target, ORDERS, NO_FORGETTING,
                inflation=inflation, keep=("theta",),
            ).theta  # fmt: skip
            begin = timed(f"recursion, {form}", begin)
            x, y = np.ascontiguousarray(x), np.ascontiguousarray(y)
            begin = perf_counter()
            _kernels.trade_off.free_runs_of_many(x, y, path, first, end, BOUND)
            timed("free runs", begin)
    del taken["compiling"]
    return taken


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    print(f"{cpu()}, {options.jobs} workers")
    paper_study("fig13", 1, conditions=["C4"], intensities=[0.15], n_validation=1)  # compiles
    begin = perf_counter()
    found = paper_study("fig13", ESTIMATION, n_validation=VALIDATION, n_jobs=options.jobs)
    seconds = perf_counter() - begin
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    fits = len(found.table)
    print(f"whole study: {seconds:.1f} s ({SECONDS:g} wanted), {memory:.2f} GiB "
          f"({GIBIBYTES:g} wanted); {fits} fits, {fits * (VALIDATION + 1)} free runs")  # fmt: skip
    of_cell = stages()
    total = sum(of_cell.values())
    print(f"by stage, one process, seconds for {CELLS} cells as one takes them:")
    for name, taken in of_cell.items():
        print(f"  {name:<22} {CELLS * taken:6.1f}  {100 * taken / total:3.0f} %")
    print(f"  {'sum':<22} {CELLS * total:6.1f}")
    return int(seconds > SECONDS or memory > GIBIBYTES)


if __name__ == "__main__":
    sys.exit(main())
