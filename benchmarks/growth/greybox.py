"""Growth of fits in simulation with rows: an operator, and the search for what it lacks.

cd benchmarks && python -m growth.greybox
"""

from __future__ import annotations

import sys

import numpy as np

from growth.harness import Data, Work, main, make_data
from skhoid import EffectSearchCV, OperatorRegressor


def operator(data: Data) -> None:
    OperatorRegressor().fit(*data)


def single(rows: int) -> Data:
    return make_data(rows, dtype=np.float32)


WORKS = {
    "OperatorRegressor": Work(operator, seconds=30.0, memory=4.0),
    "OperatorRegressor, float32": Work(operator, memory=7.0, make=single),
    "EffectSearchCV": Work(
        lambda data: EffectSearchCV(OperatorRegressor()).fit(*data), seconds=600.0, memory=5.0
    ),
}

if __name__ == "__main__":
    sys.exit(main(__spec__.name, WORKS))
