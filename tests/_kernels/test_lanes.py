"""Vectors of lanes, compiled, against the NumPy arrays that they are uncompiled."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba import njit

from skhoid import _kernels
from skhoid._kernels.lanes import (
    every,
    everywhere,
    fma,
    load,
    maximum,
    minimum,
    rows,
    select,
    spread,
    store,
)

L = 5


def arithmetic(a, b, out):
    """Leave all that two vectors can give in rows of ``out``."""
    x, y = load(a, 0, L), load(b, 0, L)
    s = rows(4, L)
    for i in range(4):
        s[i] = spread(float(i), L)
    s[1] = x
    store(out, 0, x + y)
    store(out, L, x - y * 2.0)
    store(out, 2 * L, 1.0 / y)
    store(out, 3 * L, -s[1])
    store(out, 4 * L, minimum(x, y))
    store(out, 5 * L, maximum(x, 0.5))
    store(out, 6 * L, select((x < y) | (x == y), x, 7.0))
    store(out, 7 * L, select((x != y) & ~(x >= y), s[2], y))
    store(out, 8 * L, select(everywhere(L) & (x > 0.0), s[3], s[0]))
    store(out, 9 * L, spread(load(b, 1, 1), L))
    store(out, 10 * L, select(spread(load(b, 1, 1) <= 3.0, L), 1.0, x))
    return every(x <= x), every(x < 2.0)


@pytest.mark.parametrize("second", [[0.0, 2.0, -1.0, np.inf, 3.0], [1.0, np.nan, 2.0, -0.0, 1.0]])
def test_compiled_as_uncompiled(second):
    a, b = np.array([1.0, 2.0, -3.0, 0.5, 1e300]), np.array(second)
    plain, compiled = np.zeros((2, 11, L))
    with np.errstate(divide="ignore"):
        wanted = arithmetic(a, b, plain)
        assert njit(error_model="numpy")(arithmetic)(a, b, compiled) == wanted
    np.testing.assert_array_equal(compiled, plain)


def product(a, b, c, out):
    store(out, 0, fma(load(a, 0, L), load(b, 0, L), load(c, 0, L)))


def test_fma_rounds_once():
    a = np.full(L, 1 + 2.0**-30)
    out, plain = np.zeros((2, L))
    arguments = a, a, -a * a
    product(*arguments, plain)
    njit(product)(*arguments, out)
    assert (plain == 0.0).all()
    if hasattr(njit(product), "signatures"):  # not under NUMBA_DISABLE_JIT=1
        assert (out == 2.0**-60).all()


def test_kernels_with_vectors_are_compiled_anew_when_these_change(tmp_path):
    """Numba stores them by their own file alone, which stays the same."""
    copied = tmp_path / "kernels"
    shutil.copytree(
        Path(_kernels.__file__).parent, copied, ignore=shutil.ignore_patterns("__pycache__")
    )
    code = "import kernels.rls as r; print(r.recursion(1).__name__, r.take.__name__)"

    def names():
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path
        )
        return set(done.stdout.split())

    before = names()
    assert len(before) == 2
    assert names() == before
    with (copied / "lanes.py").open("a", encoding="utf-8") as file:
        file.write("\n# A change.\n")
    assert not names() & before
