"""Start values of a recursion: theta0 and P0."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from ..exceptions import PoorExcitationWarning
from .least_squares import Triangle

LARGEST_P0, SMALLEST_P0 = 1e100, 1e-100  # with data of any size, products stay finite
WORTH = {"ols": 1.0, "given": 1e-4}  # of P0 by default, in samples of mean power


def needs_data(init: Any, p0: Any) -> bool:
    """Whether theta0 or P0 come from the first window of data."""
    return p0 is None or (isinstance(init, str) and init == "ols")


def start_of(
    init: Any, p0: Any, names: list[str], table: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """theta0 and P0, from the regressors and output (last column) of the first window."""
    n_params = len(names)
    by_ols = isinstance(init, str) and init == "ols"
    if isinstance(init, str):
        theta0 = np.zeros(n_params)
    else:
        refusal = (
            f"init must be 'ols', 'zeros' or theta0: {n_params} finite numbers for "
            f"{', '.join(names)}; got {init!r}."
        )
        try:
            theta0 = np.array(init, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise ValueError(refusal) from error
        if theta0.shape != (n_params,) or not np.isfinite(theta0).all():
            raise ValueError(refusal)
    power = np.ones(n_params)
    if table is not None:
        power = np.mean(table[:, :-1] ** 2, axis=0)
        power[power == 0] = power.max() or 1.0
    if by_ols:
        assert table is not None
        theta0 = _least_squares(table, np.sqrt(power), names)
    if p0 is None:
        return theta0, np.diag(1.0 / (WORTH["ols" if by_ols else "given"] * power))
    return theta0, _given_P0(p0, n_params)


def _least_squares(table: np.ndarray, scale: np.ndarray, names: list[str]) -> np.ndarray:
    """OLS, of the smallest (scaled) parameters where the data do not determine them."""
    triangle = Triangle.of(np.array(table, order="F"))
    if len(table) >= len(names) and len(triangle.null_space()) == 0:
        return triangle.solve()
    warnings.warn(
        f"The first {len(table)} usable rows do not determine all of {', '.join(names)}; the "
        "recursion starts from the minimum-norm parameters that fit them. Give a longer "
        "init_window, or init= and p0=.",
        PoorExcitationWarning,
        stacklevel=5,
    )
    return np.linalg.lstsq(table[:, :-1] / scale, table[:, -1], rcond=None)[0] / scale


def _given_P0(p0: Any, n_params: int) -> np.ndarray:
    try:
        given = np.asarray(p0, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"p0 must be a number, {n_params} numbers or a matrix of them; got {p0!r}."
        ) from error
    P0 = given
    if given.ndim == 0:
        P0 = given * np.eye(n_params)
    elif given.ndim == 1:
        P0 = np.diag(given)
    if P0.shape != (n_params, n_params):
        raise ValueError(
            f"p0 must be a number, {n_params} numbers or a matrix of shape ({n_params}, "
            f"{n_params}); got the shape {given.shape}."
        )
    scale = np.sqrt(np.abs(np.diag(P0)))
    if (
        not (np.isfinite(P0).all() and (np.diag(P0) > 0).all() and np.array_equal(P0, P0.T))
        or np.linalg.eigvalsh(P0 / np.outer(scale, scale))[0] <= 0
    ):
        raise ValueError(f"p0 must make a symmetric positive definite P0; got {p0!r}.")
    sizes = np.diag(P0)
    if not (sizes.min() > SMALLEST_P0 and sizes.max() < LARGEST_P0):
        raise ValueError(
            f"p0 gives variances from {sizes.min():g} to {sizes.max():g}, outside the range that "
            f"can be computed with, {SMALLEST_P0:g} to {LARGEST_P0:g}. If nothing is known, 1e4 "
            "times the expected variances is enough; or use p0=None."
        )
    return P0
