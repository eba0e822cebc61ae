"""What plots of a comparison share: how they are made, and what they say of missing parts.

Open it for the colours, names and labels of measured, predicted and residual signals.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Self

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from ..diagnosis.comparison import Comparison, compare
from ._axes import with_unit, wrapped
from ._display import Display
from ._roles import dimmed

ALL_RUNS = "all"  # the name in by_time of all validation runs together
CLOSED_LOOP = "closed loop: not a test"
CHANNELS = {"f_t": "target $f_t$", "dist": "disturbance $f_d$", "e": "error e", "x": "output x"}


@dataclass(kw_only=True, eq=False, repr=False)
class ComparisonBaseDisplay(Display):
    """A Display whose fields are attributes of a Comparison, by the same names."""

    @classmethod
    def from_comparison(cls, comparison: Comparison, *, ax: Any = None, **styles: Any) -> Self:
        """Draw a comparison.

        Parameters
        ----------
        comparison : Comparison
            Result of :func:`skhoid.compare`.
        ax : Axes, sequence of Axes or None, default=None
            Where to draw, see :meth:`plot`. None makes a figure.
        **styles : dict
            Keywords of :meth:`plot` whose names end in ``_kw``.

        Returns
        -------
        display : Display
            Of the class that this is called on.
        """
        if not isinstance(comparison, Comparison):
            raise TypeError(
                f"{cls.__name__}.from_comparison draws a result of skhoid.compare; got "
                f"{type(comparison).__name__}. from_estimator(model, X, y) compares first."
            )
        drawn = {field.name: getattr(comparison, field.name) for field in fields(cls)}
        return cls(**drawn).plot(ax, **styles)

    @classmethod
    def from_estimator(cls, model: Any, X: Any, y: Any, *, ax: Any = None, **options: Any) -> Self:
        """Compare a fitted model with measured runs, and draw that.

        Parameters
        ----------
        model : fitted estimator
            With ``predict``.
        X : DataFrame of shape (n_rows, n_channels)
            Channels of the validation runs.
        y : Series of shape (n_rows,)
            The operator's measured output.
        ax : Axes, sequence of Axes or None, default=None
            Where to draw, see :meth:`plot`. None makes a figure.
        **options : dict
            Keywords of :meth:`plot` whose names end in ``_kw``, and other arguments of
            :func:`skhoid.compare`.

        Returns
        -------
        display : Display
            Of the class that this is called on.
        """
        styles = {name: options.pop(name) for name in list(options) if name.endswith("_kw")}
        return cls.from_comparison(compare(model, X, y, **options), ax=ax, **styles)


def is_of_all_runs(table: pd.DataFrame) -> np.ndarray:
    return (table["run"] == ALL_RUNS).to_numpy(dtype=bool)


def exceeding(table: pd.DataFrame) -> np.ndarray:
    """Rows that exceed chance; what is not known does not."""
    return table["exceeds"].eq(True).to_numpy(dtype=bool)


def beyond(false_alarm: float) -> str:
    return f"beyond chance ({100 * (1 - false_alarm):g} %)"


def chance(false_alarm: float) -> str:
    return f"chance ({100 * (1 - false_alarm):g} %)"


def channel_name(name: str) -> str:
    return CHANNELS.get(name, name)


def percent(value: float) -> str:
    return f"{value:.1f} %"


def residual_label(unit: str | None) -> str:
    return with_unit("mean residual", unit)


def say_instead(panel: Axes, text: str, width: int = 46) -> None:
    """What is not available, in the place where it would be drawn."""
    # Not set_xticks([]), which panels that share the axis would lose their ticks by.
    panel.tick_params(which="both", length=0, labelbottom=False, labelleft=False)
    panel.text(
        0.5,
        0.5,
        wrapped(text, width),
        transform=panel.transAxes,
        ha="center",
        va="center",
        color=dimmed(),
        fontsize="small",
    )
