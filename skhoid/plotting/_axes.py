"""Colours, labels and the Axes that a caller hands in."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from sklearn.utils.validation import check_is_fitted

# Okabe and Ito's colours, which people with any colour vision tell apart.
BLACK = "#000000"
GREY = "#999999"
BLUE = "#0072B2"
VERMILLION = "#D55E00"
GREEN = "#009E73"
PURPLE = "#CC79A7"
ORANGE = "#E69F00"
SKY = "#56B4E9"


def with_unit(quantity: str, unit: str | None) -> str:
    return f"{quantity}, {unit}" if unit else quantity


def given_axes(ax: Any, allowed: Sequence[int], what: str) -> list[Axes]:
    """The Axes of ``ax`` (one, or a sequence or array of them) in order, as many as allowed."""
    axes = [ax] if isinstance(ax, Axes) else list(np.asarray(ax, dtype=object).ravel())
    wrong = [a for a in axes if not isinstance(a, Axes)]
    if wrong:
        raise TypeError(
            f"ax must be matplotlib Axes, or a sequence of them; got {type(wrong[0]).__name__}."
        )
    if len(axes) not in allowed:
        numbers = " or ".join(str(n) for n in dict.fromkeys(allowed))
        raise ValueError(
            f"ax holds {len(axes)} Axes; this picture needs {numbers}: {what}. ax=None makes them."
        )
    return axes


def check_search(search: Any, expected: type, display: str) -> None:
    """Refuse anything but a fitted search of the expected class."""
    if not isinstance(search, expected):
        raise TypeError(
            f"{display}.from_estimator draws a fitted {expected.__name__}; got "
            f"{type(search).__name__}."
        )
    check_is_fitted(search, "best_estimator_")
