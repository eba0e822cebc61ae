"""Frequency responses of ARX parameters, and their derivatives."""

from __future__ import annotations

import numpy as np


def response_and_gradient(
    theta: np.ndarray, omega: np.ndarray, dt: float, na: int, delay: float
) -> tuple[np.ndarray, np.ndarray]:
    """H(j omega) e^(-j omega delay), of shape (..., n_lines), and dH/dtheta (Eqs. H.14-H.17).

    ``theta`` (..., n_params) is [a_1 ... a_na, b_0 ...]; ``omega`` (rad/s) may have leading axes.
    """
    n_b = theta.shape[-1] - na
    if n_b < 1:
        raise ValueError(
            f"theta holds {theta.shape[-1]} parameters, of which na={na} are of the output; none "
            "is left for the input. Give [a_1 ... a_na, b_0 ... b_{nb-1}] on the last axis."
        )
    lags = np.exp(-1j * omega[..., None] * dt * np.arange(max(na + 1, n_b)))
    to_a, to_b = lags[..., 1 : na + 1], lags[..., :n_b]
    with np.errstate(divide="ignore", invalid="ignore"):
        denominator = 1 + _times(to_a, theta[..., :na])
        shares = np.exp(-1j * omega * delay) / denominator
        response = shares * _times(to_b, theta[..., na:])
        slopes = -(response / denominator)[..., None] * to_a, shares[..., None] * to_b
    return response, np.concatenate(slopes, axis=-1)


def _times(lags: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    return (lags @ coefficients[..., None])[..., 0]
