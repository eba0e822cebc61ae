"""One fitted model and the runs it is compared with."""

import pytest
from support.comparison import NK, runs

from skhoid import ARXRegressor, compare


@pytest.fixture(scope="module")
def simulated():
    return runs()


@pytest.fixture(scope="module")
def arx():
    X, y, _ = runs(2, seed=100, first_run=11)
    return ARXRegressor(nk=NK).fit(X, y)


@pytest.fixture(scope="module")
def of_arx(arx, simulated):
    X, y, _ = simulated
    return compare(arx, X, y, run_in=0)
