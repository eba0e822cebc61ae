"""Words and tables of the summaries of ARX models, batch and recursive."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ..text import TextTable, number
from .forgetting import Forgetting
from .orders import Orders

JUDGE = (
    "Residual sd{} one step ahead. Judge a model by its free run, preferably on runs that were not "
    "fitted: summary(X, y)."
)
CLOSED_LOOP = (
    "In a closed loop, coloured remnant biases least squares; standard errors do not show this "
    "bias{}."
)
WHITE = "Standard errors assume a white equation error{}."


def orders_text(orders: Orders) -> str:
    nb, nk = (one_or_all(values) for values in (orders.nb, orders.nk))
    constant = ", intercept" if orders.intercept else ""
    return f"ARX, na = {orders.na}, nb = {nb}, nk = {nk}{constant}"


def delay_text(nk: tuple[int, ...], dt: float) -> str:
    seconds = one_or_all([number(k * dt) for k in nk])
    samples = "sample" if set(nk) == {1} else "samples"
    return f"{one_or_all(nk)} {samples}, {seconds} s"


def one_or_all(values: Iterable[Any]) -> str:
    listed = [str(value) for value in values]
    return listed[0] if len(set(listed)) == 1 else f"({', '.join(listed)})"


def largest_pole(a: np.ndarray) -> str:
    largest = float(np.abs(np.roots([1.0, *a])).max(initial=0.0))
    return f"{largest:.4f}" + (" (unstable)" if largest >= 1.0 else "")


def condition(covariance: np.ndarray) -> float:
    """Condition number of the regressors, each scaled to one."""
    sd = np.sqrt(np.diag(covariance))
    information = np.linalg.pinv(covariance / np.outer(sd, sd), hermitian=True)
    scale = np.sqrt(np.diag(information))
    return float(np.sqrt(np.linalg.cond(information / np.outer(scale, scale))))


def memory_text(forgetting: Forgetting, used: Any, dt: float) -> str:
    """The memory of a recursion; ``used`` are factors that varied by themselves."""
    factors = np.atleast_1d(used if forgetting.nominal else forgetting.factors)
    if forgetting.nominal:
        return f"variable, λ = {factors.min():.6g} to {factors.max():.6g}"
    if forgetting.over_time:
        return f"given over time, λ = {factors.min():.6g} to {factors.max():.6g}"
    with np.errstate(divide="ignore"):
        horizons = 1.0 / (1.0 - factors[0])
    if horizons.size > 1:
        return f"N0 = ({', '.join(f'{h:.4g}' for h in horizons)}) samples"
    if np.isinf(horizons[0]):
        return "nothing is forgotten, λ = 1"
    seconds = number(float(horizons[0]) * dt)
    return f"N0 = {horizons[0]:.4g} samples, {seconds} s (λ = {factors[0, 0]:.6g})"


def path_table(names: list[str], path: np.ndarray, time: np.ndarray) -> TextTable:
    """Range of each parameter over time."""
    rows = []
    for name, values in zip(names, path.T, strict=True):
        low, high = int(np.argmin(values)), int(np.argmax(values))
        rows.append(
            [name, number(float(values[0]))]
            + [text for i in (low, high) for text in (number(float(values[i])), f"{time[i]:.6g}")]
            + [number(float(values[-1]))]
        )
    return TextTable(
        f"Path over {time[0]:.6g} to {time[-1]:.6g} s",
        ["", "first", "min", "at (s)", "max", "at (s)", "last"],
        rows,
    )
