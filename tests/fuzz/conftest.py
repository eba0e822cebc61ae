"""Divides the time of the fuzz suite among its tests."""

import os

from support.fuzzing import share


def pytest_collection_finish(session):
    tests = [item for item in session.items if getattr(item.function, "draws", False)]
    share(len(tests), int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1")))
