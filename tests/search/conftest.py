"""A recording with a dead zone, and the search of it, for the tests of searches."""

import pytest
from support.open_loop import dead, recorded, searched


@pytest.fixture(scope="session")
def hidden_data():
    return recorded(inner=dead)


@pytest.fixture(scope="session")
def found(hidden_data):
    return searched(hidden_data)
