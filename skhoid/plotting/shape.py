"""The curve of an effect without a name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd

from ..search.effect_search import EffectSearchCV
from ..search.shape import Shape
from ._axes import letters_above, letters_across, wrapped
from ._checks import check_search
from ._display import Display
from ._roles import dimmed, foreground, scaled, series_colour, veil

BAND = "95 % band, of the whole curve"
KNOTS = "knots"
KNOT = 0.035  # of the height of the panel


@dataclass(kw_only=True, eq=False, repr=False)
class ShapeDisplay(Display):
    """What the data show of an effect that has no name: a curve with its band.

    The band holds the whole curve with a probability of 95 %. Ticks at the bottom are the knots,
    most of which are at quantiles of the data: between two of them lie as many rows as between two
    others. A thin line is where the curve does nothing. The dashed curve is the named effect that
    comes nearest, where one has half of its power in common.

    Make it with :meth:`from_estimator`, from a search.

    Parameters
    ----------
    curve : DataFrame
        Over the abscissa: value, low and high.
    x_label, y_label : str
        Names and units of both axes.
    sentence : str, default=""
        Where it acts, for the title.
    gain : float, default=nan
        Points of held-out VAF, for the title.
    knots : sequence of float, default=()
        Where the curve is given.
    neutral : float, default=0.0
        Value of a curve that does nothing.
    nearest : Series or None, default=None
        Curve of a named effect, over the abscissa.
    nearest_title : str, default=""
        What it is called.

    Attributes
    ----------
    ax_ : Axes
        The panel.
    figure_ : Figure
        The figure that holds it.
    line_ : Line2D
        The curve.
    band_ : FillBetweenPolyCollection
        Its band.
    nearest_ : Line2D or None
        The named effect.
    knots_ : Line2D
        The ticks at the knots.

    See Also
    --------
    IdentifiedEffectDisplay : The same of an effect with a name.

    Examples
    --------
    >>> import numpy as np
    >>> import pandas as pd
    >>> from skhoid.plotting import ShapeDisplay
    >>> e = pd.Index(np.linspace(-2, 2, 101), name="e")
    >>> value = 0.3 * np.sin(2 * e.to_numpy())
    >>> curve = pd.DataFrame({"value": value, "low": value - 0.05, "high": value + 0.05}, e)
    >>> display = ShapeDisplay(
    ...     curve=curve,
    ...     x_label="error e, deg",
    ...     y_label="departure from a straight line, deg",
    ...     sentence="it acts on the error, as a function of its size and sign",
    ...     gain=9.7,
    ...     knots=np.linspace(-2, 2, 11),
    ...     nearest=pd.Series(0.35 * np.sin(1.9 * e.to_numpy()), e),
    ...     nearest_title="dead zone",
    ... ).plot()
    >>> display.ax_.get_xlabel()
    'error e, deg'
    """

    curve: pd.DataFrame
    x_label: str
    y_label: str
    sentence: str = ""
    gain: float = np.nan
    knots: Any = ()
    neutral: float = 0.0
    nearest: pd.Series | None = None
    nearest_title: str = ""

    @classmethod
    def from_estimator(cls, search: Any, *, ax: Any = None, **styles: Any) -> Self:
        """Draw the shape of what a search has no name for.

        Parameters
        ----------
        search : fitted EffectSearchCV
            The search.
        ax : Axes or None, default=None
            Where to draw. None makes a figure.
        **styles : dict
            Keywords of :meth:`plot` whose names end in ``_kw``.

        Returns
        -------
        display : ShapeDisplay

        Raises
        ------
        ValueError
            If the search has no shape.
        """
        check_search(search, EffectSearchCV, cls.__name__)
        shape = search.shape_
        if shape is None:
            raise ValueError(
                f"This search has no shape to draw: {search.verdict_}. There is one where "
                "something has no name (best_effects_ ends in 'unknown') and a free form explains "
                "it."
            )
        return cls.from_shape(shape, ax=ax, **styles)

    @classmethod
    def from_shape(cls, shape: Shape, *, ax: Any = None, **styles: Any) -> Self:
        """Draw a shape.

        Parameters
        ----------
        shape : Shape
            Of a search.
        ax : Axes or None, default=None
            Where to draw. None makes a figure.
        **styles : dict
            Keywords of :meth:`plot` whose names end in ``_kw``.

        Returns
        -------
        display : ShapeDisplay
        """
        named = shape.nearest_curve is not None and shape.is_near
        display = cls(
            curve=shape.curve,
            x_label=shape.x_label,
            y_label=shape.y_label,
            sentence=shape.sentence,
            gain=shape.gain,
            knots=shape.effect.knots or (),
            neutral=shape.effect.at_rest,
            nearest=shape.nearest_curve if named else None,
            nearest_title=str(shape.nearest["title"].iloc[0]) if named else "",
        )
        return display.plot(ax, **styles)

    def plot(
        self,
        ax: Any = None,
        *,
        line_kw: dict[str, Any] | None = None,
        band_kw: dict[str, Any] | None = None,
        nearest_kw: dict[str, Any] | None = None,
        knots_kw: dict[str, Any] | None = None,
    ) -> Self:
        """Draw.

        Parameters
        ----------
        ax : Axes or None, default=None
            Where to draw. None makes a figure.
        line_kw : dict or None, default=None
            Keywords of matplotlib for the curve.
        band_kw : dict or None, default=None
            Keywords of matplotlib for the band.
        nearest_kw : dict or None, default=None
            Keywords of matplotlib for the named effect.
        knots_kw : dict or None, default=None
            Keywords of matplotlib for the ticks at the knots.

        Returns
        -------
        self : ShapeDisplay
        """
        (self.ax_,) = self._take_axes(ax, "the curve", figsize=(6.4, 4.2))
        panel = self.ax_
        at = self.curve.index.to_numpy(dtype=float)
        colour = series_colour(0)
        self.band_ = panel.fill_between(
            at, self.curve["low"], self.curve["high"], color=colour, alpha=veil(0.25), lw=0
        )
        self.band_.set_label(BAND)
        panel.axhline(self.neutral, color=foreground(), lw=scaled(0.6))
        self.nearest_: Any = None
        if self.nearest is not None:
            (self.nearest_,) = panel.plot(
                self.nearest.index,
                self.nearest,
                color=series_colour(1),
                ls="--",
                lw=scaled(1.4),
                label=f"nearest name: {self.nearest_title}",
            )
        (self.line_,) = panel.plot(
            at, self.curve["value"], color=colour, lw=scaled(1.8), label="curve"
        )
        panel.margins(x=0.0)
        knots = np.asarray(self.knots, dtype=float)
        (self.knots_,) = panel.plot(
            np.repeat(knots, 3),
            np.tile([0.0, KNOT, np.nan], len(knots)),
            color=dimmed(),
            lw=scaled(1.0),
            transform=panel.get_xaxis_transform(),
            label=KNOTS,
        )
        self._restyle(
            {"line": line_kw, "band": band_kw, "nearest": nearest_kw, "knots": knots_kw},
            line=self.line_,
            band=self.band_,
            nearest=self.nearest_,
            knots=self.knots_,
        )
        panel.set_xlabel(self.x_label)
        height = panel.get_window_extent().height / panel.figure.dpi
        panel.set_ylabel(wrapped(self.y_label, letters_across(height)))
        panel.set_title(self._title_text(letters_above(panel)), fontsize="medium")
        panel.grid(alpha=0.3)
        self._legend_of_panels()
        return self

    def _title_text(self, width: int) -> str:
        """Where it acts, and below it what it gains."""
        lines = [self.sentence[:1].upper() + self.sentence[1:]]
        if np.isfinite(self.gain):
            lines.append(f"{self.gain:+.1f} points of held-out VAF")
        return "\n".join(wrapped(line, width) for line in lines if line)
