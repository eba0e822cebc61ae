"""What it costs to import skhoid, and how soon the command line answers.

    pip install -e ".[completion]"
    python benchmarks/bench_startup.py               # a minute
    python benchmarks/bench_startup.py --repeats 15

Each row is a fresh Python with its bytecode at hand; the rows take turns, and each figure is the
median. Imports are compared with that of scikit-learn and pandas, without which skhoid does
nothing. Exits with 1 if `import skhoid` takes more than 1.15 times as much of the processor, or
an answer of the command line more than 0.3 s.
"""

from __future__ import annotations

import argparse
import os
import platform
import resource
import statistics
import subprocess
import sys
import tempfile
import time

REFERENCE = "import sklearn.linear_model, pandas"
IMPORTS = (
    REFERENCE,
    "import skhoid",
    "from skhoid import ARXRegressor",
    "from skhoid import ARXRegressor, DelaySearchCV, make_tracking_runs, EffectSearchCV",
    "from skhoid import *",
)
ANSWERS = (
    "--help",
    "demo --help",
    "identify --help",
    "--version",
    "--no-such-option",
    "no-such-command",
    "completion bash",
)
MOST_IMPORT, MOST_ANSWER = 1.15, 0.3  # times the reference, s


def measure(words: list[str], environment: dict[str, str]) -> tuple[float, float]:
    """Seconds by the clock and of the processor that a fresh Python takes."""

    def processor() -> float:
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        return used.ru_utime + used.ru_stime

    before, start = processor(), time.perf_counter()
    subprocess.run([sys.executable, *words], env=environment, capture_output=True, check=False)
    return time.perf_counter() - start, processor() - before


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--repeats", type=int, default=7, help="of each row (default: 7)")
    repeats = parser.parse_args().repeats

    rows = {line: ["-c", line] for line in IMPORTS}
    rows |= {f"skhoid {line}": ["-m", "skhoid", *line.split()] for line in ANSWERS}
    taken: dict[str, list[tuple[float, float]]] = {name: [] for name in rows}
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "PYTHONPYCACHEPREFIX": folder}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)
        for words in rows.values():  # compiles
            measure(words, environment)
        for _ in range(repeats):
            for name, words in rows.items():
                taken[name].append(measure(words, environment))

    print(f"Python {platform.python_version()}, {os.cpu_count()} processors, {repeats} repeats")
    print(f"{'clock, s':>9} {'processor, s':>13} {'ratio':>6}")
    found = {}
    for name, pairs in taken.items():
        clock, processor = (statistics.median(column) for column in zip(*pairs, strict=True))
        found[name] = clock, processor
        ratio = processor / found[REFERENCE][1]
        print(f"{clock:9.2f} {processor:13.2f} {ratio:6.2f}  {name}")
    slow = [f"skhoid {line}" for line in ANSWERS if found[f"skhoid {line}"][0] > MOST_ANSWER]
    if found["import skhoid"][1] > MOST_IMPORT * found[REFERENCE][1]:
        slow.append("import skhoid")
    print(f"Too slow: {', '.join(slow)}" if slow else "All within their bounds.")
    return bool(slow)


if __name__ == "__main__":
    sys.exit(main())
