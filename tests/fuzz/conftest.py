"""Divides the time of the fuzz suite among its tests."""

import os

from support.fuzzing import share


def pytest_collection_finish(session):
    functions = [getattr(item, "function", None) for item in session.items]  # doctests have none
    tests = [function for function in functions if getattr(function, "draws", False)]
    share(len(tests), int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1")))
