"""How time and memory grow: of the work on a record with its rows, and of a study with its sizes.

    pip install -e ".[io]"
    python benchmarks/bench_growth.py                              # half an hour, 2 GB of disk
    python benchmarks/bench_growth.py --largest 1e6 --share 0.25   # to try

Work on a record or its file, of 100,000 to 10 million rows in runs of 10,000, is in the parts of
the folder ``growth``, each of which runs alone too (``python -m growth.compare``, in this folder).
Its time may grow with the rows to the power 1.1.

Studies: one process. Each row is a fresh Python, the fastest of three that take turns with those
of the other sizes; memory is the peak of its resident set above that of a study of a single data
set, without the table itself. Time may grow by 1.15 times the size, and memory of what need not
grow by 20 MB. Exits with 1 if something is missed.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import subprocess
import sys
import time

from bench_simulate import cpu
from growth import arx_searches, compare, greybox, reading
from growth.harness import table

FACTORS = (1, 2, 4)
BASE = {"replications": 160, "runs": 2, "samples": 8192, "settings": 2}
REPEATS = 3
LINEAR, FLAT = 1.15, 20.0  # of the growth in size; MB
# A block is in memory as a whole: what grows with its size is stated, what should not is checked.
MUST_BE_FLAT = ("replications", "settings")


def measure(sizes: dict[str, int]) -> dict[str, float]:
    """Seconds, peak memory and table of one study, in this process."""
    from skhoid import ARXRegressor, MonteCarloStudy

    def lead(data, nk):
        return {"b0": ARXRegressor(nk=nk).fit(data.X, data.y).coef_[2]}

    def study(replications: int, settings: int):
        return MonteCarloStudy(
            lead,
            {"condition": ["C1"], "nk": list(range(29, 29 + settings))},
            replications,
            n_runs=sizes["runs"],
            simulation={"remnant_gain": 0.02, "duration": sizes["samples"] / 100, "run_in": 20.0},
            block_size=8,
            random_state=0,
        )

    study(1, 1).run()
    start = time.perf_counter()
    table = study(sizes["replications"], sizes["settings"]).run()
    seconds = time.perf_counter() - start
    size = table.memory_usage(deep=True).sum() / 2**20
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**10
    return {"seconds": seconds, "peak": peak - size, "table": size}


def in_a_process(sizes: dict[str, int]) -> dict[str, float]:
    command = [sys.executable, __file__, "--one", json.dumps(sizes)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return json.loads(done.stdout)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--largest", type=float, default=float("inf"), help="most rows")
    parser.add_argument("--share", type=float, default=1.0, help="part of the replications")
    parser.add_argument("--one", type=json.loads, help="sizes of one study: measure that alone")
    given = parser.parse_args()
    if given.one is not None:
        print(json.dumps(measure(given.one)))
        return 0
    base = BASE | {"replications": max(8, round(given.share * BASE["replications"]))}
    floor = in_a_process(base | {"replications": 1, "runs": 1, "samples": 512, "settings": 1})
    print(f"{cpu()}, {os.cpu_count()} cores, Python {platform.python_version()}")
    missed = []
    for name, works in {
        "growth.arx_searches": arx_searches.WORKS,
        "growth.greybox": greybox.WORKS,
        "growth.compare": compare.WORKS,
        "growth.reading": reading.WORKS,
    }.items():
        missed += table(name, works, given.largest)
    print(f"\na study of one data set: {floor['peak']:.0f} MB\n")
    print(f"{'':<14}{'size':>8}{'seconds':>9}{'growth':>8}{'memory, MB':>12}{'table, MB':>11}")
    for name in BASE:
        rounds = [
            [in_a_process(base | {name: factor * base[name]}) for factor in FACTORS]
            for _ in range(REPEATS)
        ]
        fastest = [min(each, key=lambda one: one["seconds"]) for each in zip(*rounds, strict=True)]
        first = fastest[0]
        for found in fastest:
            found["peak"] -= floor["peak"]
        for factor, found in zip(FACTORS, fastest, strict=True):
            growth = found["seconds"] / first["seconds"]
            print(
                f"{name:<14}{factor * base[name]:>8}{found['seconds']:>9.2f}{growth:>8.2f}"
                f"{found['peak']:>12.1f}{found['table']:>11.2f}"
            )
            if growth > LINEAR * factor:
                missed.append(f"{name}: {factor} times the size takes {growth:.2f} times as long")
            if name in MUST_BE_FLAT and found["peak"] - first["peak"] > FLAT:
                missed.append(f"{name}: {found['peak'] - first['peak']:.0f} MB more")
    print("\n" + ("\n".join(f"MISSED: {what}" for what in missed) or "All targets met."))
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
