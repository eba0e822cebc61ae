"""The parts of the recursions beside autoregressive noise, against dense algebra."""

import numpy as np
import pytest

from skhoid._kernels import whitened as kernels

rng = np.random.default_rng


@pytest.mark.parametrize("forgetting", [1.0, 0.99])
def test_noise_by_least_squares(forgetting):
    """P in factors is that of the textbook's recursion; large errors weigh less, as documented."""
    nd, n = 3, 400
    random = rng(0)
    v = random.standard_normal(n) * np.where(np.arange(n) == 200, 20.0, 1.0)
    for t in range(2, n):
        v[t] += 1.2 * v[t - 1] - 0.6 * v[t - 2]
    d, P, variance = np.zeros(nd), 10 * np.eye(nd), 1.0
    mine, U, D = np.zeros(nd), np.zeros(3), np.full(nd, 10.0)
    mine_variance, work = 1.0, np.empty((2, nd))
    for t in range(nd, n):
        latest = v[t - nd : t + 1][::-1].copy()
        phi = -latest[1:]
        error = latest[0] - phi @ d
        P = P / forgetting
        alpha = max(1.0, error**2 / (kernels.ORDINARY * variance))
        gain = P @ phi / (alpha + phi @ P @ phi)
        d = d + gain * error
        P = P - np.outer(gain, phi @ P)
        variance += 0.01 * (min(error**2, kernels.LARGE * variance) - variance)
        mine_variance = kernels.follow_noise(
            latest, mine, U, D, forgetting, 0.01, mine_variance, work
        )
    np.testing.assert_allclose(mine, d, rtol=1e-9)
    assert mine_variance == pytest.approx(variance, rel=1e-12)
    upper = np.eye(nd)
    upper[0, 1], upper[0, 2], upper[1, 2] = U
    np.testing.assert_allclose(upper @ np.diag(D) @ upper.T, P, rtol=1e-8)
