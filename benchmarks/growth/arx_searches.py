"""Growth of the ARX searches with rows.

cd benchmarks && python -m growth.arx_searches
"""

from __future__ import annotations

import sys
from typing import Any

from growth.harness import Data, Work, main


def one_step(data: Data) -> Any:
    from skhoid import ARXRegressor, DelaySearchCV

    return DelaySearchCV(ARXRegressor()).fit(*data)


def vaf(data: Data) -> Any:
    from skhoid import ARXRegressor, DelaySearchCV

    return DelaySearchCV(ARXRegressor(), criterion="vaf").fit(*data)


def orders(data: Data) -> Any:
    from skhoid import ARXRegressor, OrderSearchCV

    return OrderSearchCV(ARXRegressor(), na=[1, 2, 3], nb=[1, 2, 3], nk=[28, 29, 30]).fit(*data)


def orders_bic(data: Data) -> Any:
    from skhoid import ARXRegressor, OrderSearchCV

    return OrderSearchCV(
        ARXRegressor(), na=[1, 2, 3], nb=[1, 2, 3], nk=[28, 29, 30], criterion="bic"
    ).fit(*data)


UP_TO_1E6 = (100_000, 1_000_000)
WORKS = {
    "DelaySearchCV, one step": Work(one_step, seconds=10, memory=2),
    "DelaySearchCV, VAF": Work(vaf, UP_TO_1E6, seconds=6, memory=2),
    "OrderSearchCV, 27 candidates": Work(orders, UP_TO_1E6, seconds=4, memory=2),
    "OrderSearchCV, 27 candidates, BIC": Work(orders_bic, UP_TO_1E6, seconds=4, memory=2),
}

if __name__ == "__main__":
    sys.exit(main(__spec__.name, WORKS))
