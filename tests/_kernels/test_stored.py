"""Compiled kernels that several processes left in the cache work together."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = """
import runpy, sys, zlib

test = runpy.run_path(sys.argv[1])
signals, y = test["odd_runs"](6)
for kind in sys.argv[2:]:
    factors = test["forgetting_of"](kind, 16)
    found = test["recursions"](signals[..., None].copy(), y[..., None].copy(), kind, factors)
    print(kind, zlib.crc32(found[0].tobytes()))
"""


@pytest.mark.slow
def test_kernels_that_two_processes_compiled(tmp_path):
    """Numba numbers what a process compiles, and one number in two of them is one symbol."""

    def found_in_a_process(*kinds):
        code = [sys.executable, "-c", SCRIPT, str(Path(__file__).with_name("test_rls.py")), *kinds]
        environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
        done = subprocess.run(code, capture_output=True, text=True, check=True, env=environment)
        return done.stdout.splitlines()

    one = found_in_a_process("one")
    by_parameter = found_in_a_process("by parameter")
    assert found_in_a_process("one", "by parameter") == one + by_parameter
    assert found_in_a_process("by parameter", "one") == by_parameter + one
