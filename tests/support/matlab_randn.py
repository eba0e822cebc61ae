"""Normal samples of MATLAB's ``rng(seed, "twister"); randn(...)``, without MATLAB.

The ziggurat of Marsaglia and Tsang (2000) with 256 levels, fed by pairs of 32-bit words of the
Mersenne twister MT19937, the way the ``randn`` of MATLAB does it. The samples equal those of
chapter5_noise.npz bit for bit. MATLAB's own differ from them by up to about 3e-14: its table of
levels is rounded to 15 digits.
"""

import math
from decimal import Decimal, localcontext

import numpy as np

R = 3.654152885361009  # where the tail begins
V = 0.004928673233974655  # the area of every level
# The table behind chapter5_noise.npz was computed with an exp that is an ulp off here and there.
# The recursion below rounds correctly, and then these levels are an ulp wider in the file.
ULP_WIDER = (67, 107, 135, 148, 149)


def _edges():
    """Half-widths of the levels, the narrowest (0) at the mode, the widest (256) at the tail."""
    x = np.zeros(257)
    with localcontext(prec=40):  # not math.exp, whose last bit is the platform's

        def density(v):
            return float(Decimal(-0.5 * v * v).exp())

        x[256], x[255] = V / density(R), R
        for j in range(254, 0, -1):
            wider = float(x[j + 1])
            x[j] = math.sqrt(-2 * float(Decimal(V / wider + density(wider)).ln()))
            if j in ULP_WIDER:
                x[j] = np.nextafter(x[j], np.inf)
    return x


def randn(seed, shape):
    """Normal samples of MATLAB's ``rng(seed, "twister"); randn(shape)``, in column-major order."""
    x = _edges()
    density = np.exp(-0.5 * x * x)
    n = math.prod(np.atleast_1d(shape).tolist())

    # A trial takes one pair of words and so does each uniform number that settles a doubtful
    # trial: pair k is either, and both readings of all pairs are computed at once. (MATLAB draws
    # a uniform number again if it is 0. That has a probability of 2**-53 and is left out.)
    n_pairs = n + n // 20 + 1000  # some 2 % of spare pairs are used
    twister = np.random.RandomState(seed or 5489)  # MATLAB takes seed 0 for 5489
    words = twister.randint(2**32, size=(n_pairs, 2), dtype=np.uint32).astype(np.int64)
    first, second = words.T
    level = (second >> 24) + 1
    signed = ((first >> 3) * 2**24 + (second & 0xFFFFFF)) * 2.0**-52 - 1
    sample = signed * x[level]
    uniform = ((first >> 5) * 2**26 + (second >> 6)) * 2.0**-53

    is_sample = np.ones(n_pairs, dtype=bool)
    free = 0  # pairs before this one are used up
    for k in np.flatnonzero(np.abs(sample) > x[level - 1]):
        if k < free or k > n_pairs - 100:  # used up, or beyond the n samples
            continue
        top, bottom = density[level[k] - 1], density[level[k]]
        if level[k] < 256:  # the wedge under the curve: inside, or a new trial
            height = bottom + uniform[k + 1] * (top - bottom)
            is_sample[k] = height < math.exp(-0.5 * sample[k] ** 2)
            free = k + 2
        else:  # the tail
            free = k + 1
            while True:
                excess = -math.log(uniform[free]) / R
                free += 2
                if -2 * math.log(uniform[free - 1]) > excess**2:
                    break
            sample[k] = math.copysign(R + excess, sample[k])
        is_sample[k + 1 : free] = False
    return sample[is_sample][:n].reshape(shape, order="F")
