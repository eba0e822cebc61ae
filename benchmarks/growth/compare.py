"""Growth of ``compare`` with rows, by models of five other runs, and of RecursiveARX.

cd benchmarks && python -m growth.compare
"""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from growth.harness import DELAY, DT, Data, Work, main, make_data
from skhoid import ARXRegressor, OperatorRegressor, RecursiveARX, compare

FEW = 50_000  # rows that models are fitted on


@cache
def fitted(kind: str) -> Any:
    """A model of five runs, which are not those that it is compared with."""
    X, y = make_data(FEW, random_state=1)
    model = {
        "arx": ARXRegressor(na=2, nb=2, nk=DELAY + 1),
        "recursive": RecursiveARX(na=2, nb=2, nk=DELAY + 1, memory_time=5.0),
        "operator": OperatorRegressor(delay=DELAY * DT, inputs=["e"]),
    }[kind]
    return model.fit(X, y)


def compared(kind: str) -> Work:
    return Work(lambda data: compare(fitted(kind), *data), seconds=60.0, memory=5.5)


def single(rows: int) -> Data:
    return make_data(rows, dtype=np.float32)


def recursive(data: Data) -> None:
    RecursiveARX(na=2, nb=2, nk=DELAY + 1).fit(*data).predict(data.X)


WORKS = {
    "compare, ARX": compared("arx"),
    "compare, ARX, float32": replace(compared("arx"), make=single, seconds=None, memory=9.0),
    "compare, RecursiveARX": compared("recursive"),
    "compare, OperatorRegressor": compared("operator"),
    "RecursiveARX fit and predict": Work(recursive),
}

if __name__ == "__main__":
    sys.exit(main(__spec__.name, WORKS))
