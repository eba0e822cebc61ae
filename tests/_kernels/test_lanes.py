"""Vectors of lanes, compiled, against the NumPy arrays that they are uncompiled."""

import numpy as np
import pytest
from numba import njit

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
