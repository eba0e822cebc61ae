"""What the page of the workbench does, without a browser."""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from skhoid.lab.explore.payloads import unpack
from skhoid.lab.workbench.bench import Workbench
from skhoid.lab.workbench.server import Keys

PORT = 8765
OWN = f"http://127.0.0.1:{PORT}"
LATER = ("revision", "ceiling", "ceiling_pending", "findings", "search")  # not of the step itself


@dataclass
class Page:
    """A page that is open."""

    client: Any
    bench: Workbench
    keys: Keys

    def post(self, path, /, **args):
        return self.client.post(f"/api/{path}", json=args, headers={"origin": OWN})

    def call(self, action, **args):
        """A reply of the component's actions."""
        reply = self.post(action, **{"run": 0, **args})
        assert reply.status_code == 200, reply.text
        return unpack(reply.content)

    def state(self):
        """The state, without what is found in the background."""
        state = self.call("state")["state"]
        return {name: value for name, value in state.items() if name not in LATER}

    def opening(self):
        return self.client.get("/api/opening").json()

    def upload(self, name, content):
        headers, params = {"origin": OWN}, {"name": name}
        return self.client.post("/api/upload", params=params, content=content, headers=headers)

    def wait(self, phase):
        """Until nothing is done any more; the phase must be this one then."""

        def rests():
            found = self.opening()
            return None if found["doing"] else found

        found = until(rests)
        assert found["phase"] == phase, found
        return found


def until(condition, patience=60.0):
    """The first true value of a condition."""
    end = time.monotonic() + patience
    while time.monotonic() < end:
        found = condition()
        if found:
            return found
        time.sleep(0.02)
    raise AssertionError("It has not happened.")


def same(one, other):
    """Whether two values are equal to the last digit, arrays included."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[k], other[k]) for k in one)
    if isinstance(one, list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, np.ndarray):
        return np.array_equal(one, other, equal_nan=True)
    return one == other
