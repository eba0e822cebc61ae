"""The error for least squares without a unique solution; it names the cause."""

from __future__ import annotations

import numpy as np

from ..exceptions import RankDeficiencyError
from ..regression import STILL, bad_output, still
from .orders import Orders


def rank_error(
    null_space: np.ndarray,
    names: list[str],
    channels: list[str],
    X: np.ndarray,
    y: np.ndarray,
    output: str,
    orders: Orders,
) -> RankDeficiencyError:
    """Build the error that names the cause; ``X`` and ``y`` are the finite rows."""
    n_params = len(names)
    head = (
        f"The {n_params} parameters cannot all be estimated: the regressors have rank "
        f"{n_params - len(null_space)}. "
    )
    bad, relation = _bad_channel(channels, X, orders), _linear_relation(channels, X)
    if bad is None and relation is not None:
        return RankDeficiencyError(
            head + relation, hint="inputs=[...] says which to keep.", options=["input"]
        )
    cause = (
        bad or (bad_output(output, y) if orders.na else None) or _generic(null_space, names, orders)
    )
    return RankDeficiencyError(head + cause)


def _bad_channel(channels: list[str], X: np.ndarray, orders: Orders) -> str | None:
    for position, channel in enumerate(channels):
        found = still(f"Input {channel!r}", X[:, position])
        if found is not None and not X[:, position].any():
            return f"{found}: it excites nothing. Leave it out."
        if found is not None and (orders.nb[position] > 1 or orders.intercept):
            return (
                f"{found}: its lags cannot be told apart. Leave it out, or use data in which "
                "it changes; for an offset use fit_intercept=True."
            )
    return None


def _linear_relation(channels: list[str], X: np.ndarray) -> str | None:
    """Find a channel that is a combination of the others, such as e = f_t - x."""
    if len(channels) < 2:
        return None
    norms = np.sqrt(np.mean(X**2, axis=0))
    for position in np.argsort([name != "e" for name in channels], kind="stable"):
        others = [i for i in range(len(channels)) if i != position]
        weights = np.linalg.lstsq(X[:, others] / norms[others], X[:, position], rcond=1e-10)[0]
        misfit = X[:, position] - (X[:, others] / norms[others]) @ weights
        if np.sqrt(np.mean(misfit**2)) > STILL * norms[position]:
            continue
        weights = weights / norms[others]
        terms = [
            (w, channels[i])
            for w, i in zip(weights, others, strict=True)
            if abs(w) * norms[i] > 1e-6 * norms[position]
        ]
        if len(terms) == 1 and abs(terms[0][0] - 1) < 1e-9:
            return (
                f"Inputs {channels[position]!r} and {terms[0][1]!r} are the same signal. "
                "Leave one out."
            )
        return (
            f"The inputs are linearly dependent: {channels[position]} = {_formula(terms)}. "
            "Leave one of them out."
        )
    return None


def _formula(terms: list[tuple[float, str]]) -> str:
    text = ""
    for weight, name in sorted(terms, reverse=True):
        sign = ("- " if weight < 0 else "") if not text else (" - " if weight < 0 else " + ")
        size = "" if abs(abs(weight) - 1) < 1e-9 else f"{abs(weight):.4g} "
        text += f"{sign}{size}{name}"
    return text


def _generic(null_space: np.ndarray, names: list[str], orders: Orders) -> str:
    weight = np.abs(null_space).max(axis=0)
    involved = [n for n, w in zip(names, weight, strict=True) if w > 1e-3]
    if not any(name.startswith("a") for name in involved):
        return (
            f"The inputs do not excite {', '.join(involved)}: n sine waves can distinguish at "
            "most 2 n lags of an input, a step only one. Use a smaller nb, or a richer forcing "
            "function."
        )
    return (
        f"{', '.join(involved)} are linearly dependent. Either the data are free of noise and "
        "fewer lags explain them exactly (use smaller na and nb), or the inputs excite too few "
        "frequencies."
    )
