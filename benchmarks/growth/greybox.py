"""Growth of fits in simulation with rows: an operator, and the search for what it lacks.

cd benchmarks && python -m growth.greybox
"""

from __future__ import annotations

import sys

from growth.harness import Work, main
from skhoid import EffectSearchCV, OperatorRegressor

WORKS = {
    "OperatorRegressor": Work(
        lambda data: OperatorRegressor().fit(*data), seconds=30.0, memory=4.0
    ),
    "EffectSearchCV": Work(
        lambda data: EffectSearchCV(OperatorRegressor()).fit(*data), seconds=600.0, memory=5.0
    ),
}

if __name__ == "__main__":
    sys.exit(main(__spec__.name, WORKS))
