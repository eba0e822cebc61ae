"""What one effect does: a curve with its uncertainty, of an effect with a name or without one."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from matplotlib.axes import Axes
from sklearn.utils.validation import check_is_fitted

from ..effects.registry import title_of
from ..model.effect_curves import Curve, EffectCurves, effect_curves
from ..model.parameters import parameter_text
from ..search import EffectSearchCV, Shape
from ._axes import (
    SYMBOLS,
    draw_band,
    letters,
    plain_logarithmic,
    wrapped,
)
from ._display import Display, check_search, letter_size
from ._roles import GREY, PALETTE, dimmed, foreground, scaled, series_colour

WITHOUT = "without the effect"
BANDS = {"shape": "95 % band, of the whole curve"}
BAND = "95 % band"
BINS = 60
N_DRAWS = 300  # of the parameters, that bands are made of
LEAST_GAIN = 1.5  # up and down on the axis, so that a small effect looks small
LINE = 0.17  # inches of a line of the text below, of a font of 10 points
CURVE, DENSITY = 2.3, 0.8  # inches that the panels take at least
KNOT = 0.035  # of the height of the panel
SYMBOL = re.compile(r"\b(" + "|".join(SYMBOLS) + r")\b")


@dataclass(kw_only=True, eq=False, repr=False)
class EffectDisplay(Display):
    """What an effect does, with a band that holds 95 % of its uncertainty.

    An effect on the error or the output is a curve from what goes in to what comes out, with the
    density of the values met in the runs below. Gains and delays are drawn over the time in the
    run, or over the channel that they follow; a further path by the response of the output to a
    pulse in its channel; a filter by its gain over frequency; a spring by the command that holds an
    output. Dashed lines are the model without it. Below the figure stands what the effect is, and
    its parameters with standard errors.

    Of an effect that has no name, the curve is what the data show, and the band holds the whole of
    it with a probability of 95 %. Ticks at the bottom are its knots, and the dashed curve is the
    named effect that comes nearest, where one has half of its power in common.

    Make it with :meth:`from_estimator`, which draws effects of your own too, or
    :meth:`from_shape`.

    Parameters
    ----------
    title : str
        What it is called.
    curves : EffectCurves
        Its curves.
    physics : str, default=""
        The effect in a sentence.
    parameters : str, default=""
        Its parameters as text.
    shape : Shape or None, default=None
        Of an effect without a name: its knots and the nearest named effect are drawn too.

    Attributes
    ----------
    axes_ : ndarray of Axes, shape (1,) or (2,)
        The curve, and the density below where there is one.
    ax_ : Axes
        The first of them.
    figure_ : Figure
        The figure that holds them.
    lines_ : dict of Line2D
        The curves: the main artists.

    See Also
    --------
    SearchDisplay : What effects do to the simulation.

    Examples
    --------
    >>> from skhoid import OperatorRegressor, make_tracking_runs
    >>> from skhoid.effects import DeadZone
    >>> from skhoid.plotting import EffectDisplay
    >>> X, y = make_tracking_runs(n_runs=2, remnant_intensity=0.05, random_state=1)
    >>> model = OperatorRegressor(effects=DeadZone(form="gap")).fit(X, y)
    >>> display = EffectDisplay.from_estimator(model, "dead_zone", X)
    >>> display.curves.kind
    'map'
    """

    title: str
    curves: EffectCurves
    physics: str = ""
    parameters: str = ""
    shape: Shape | None = None

    @classmethod
    def from_estimator(
        cls,
        model: Any,
        effect: str | None = None,
        X: Any = None,
        y: Any = None,
        *,
        ax: Any = None,
        **kwargs: Any,
    ) -> Self:
        """Draw an effect of a fitted model.

        Parameters
        ----------
        model : fitted OperatorRegressor, SimulatedARX or EffectSearchCV
            The model; of a search, the best.
        effect : str or None, default=None
            Name of the effect in ``model.effects_``. None takes the first.
        X : DataFrame or array of shape (n_rows, n_columns) or None, default=None
            Channels of runs, which amplitudes, times and densities are taken from. None takes the
            amplitudes and the duration of the runs of the fit, and draws no density.
        y : Series or array of shape (n_rows,) or None, default=None
            Measured output, for the density of its values. None takes what the model predicts.
        """
        model = getattr(model, "best_estimator_", model)
        check_is_fitted(model)
        if not hasattr(model, "effects_"):
            raise TypeError(
                f"{cls.__name__}.from_estimator draws an effect of a fitted OperatorRegressor "
                f"or SimulatedARX; got {type(model).__name__}, which has no effects_."
            )
        effects = dict(model.effects_.steps)
        if not effects:
            raise ValueError("This model has no effects.")
        name = next(iter(effects)) if effect is None else effect
        if name not in effects:
            raise ValueError(f"This model has no effect {name!r}; it has {', '.join(effects)}.")
        title = title_of(name)
        return cls(
            title=title[:1].upper() + title[1:],
            curves=effect_curves(model, name, X, y, n_draws=N_DRAWS, random_state=0),
            physics=effects[name].physics_in("human"),
            parameters=parameter_text(model.parameters_, name),
        ).plot(ax, **kwargs)

    @classmethod
    def from_shape(cls, shape: Any, *, ax: Any = None, **kwargs: Any) -> Self:
        """Draw the shape of what has no name.

        Parameters
        ----------
        shape : Shape or fitted EffectSearchCV
            What a search found, or the search, whose ``shape_`` is drawn.
        """
        if not isinstance(shape, Shape):
            check_search(shape, EffectSearchCV, cls.__name__)
            if shape.shape_ is None:
                raise ValueError(
                    f"This search has no shape to draw: {shape.verdict_}. There is one where "
                    "something has no name (best_effects_ ends in 'unknown') and a free form "
                    "explains it."
                )
            shape = shape.shape_
        x = shape.curve.index.to_numpy(dtype=float)
        value, low, high = (shape.curve[n].to_numpy(dtype=float) for n in ("value", "low", "high"))
        sentence = shape.sentence[:1].upper() + shape.sentence[1:]
        gain = f"\n{shape.gain:+.1f} points of held-out VAF" if np.isfinite(shape.gain) else ""
        return cls(
            title=sentence + gain,
            curves=EffectCurves(
                "shape",
                {"curve": Curve(x, value, low, high)},
                shape.x_label,
                shape.y_label,
                Curve(x, np.full(x.size, shape.effect.at_rest)),
            ),
            shape=shape,
        ).plot(ax, **kwargs)

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        """Draw.

        Parameters
        ----------
        ax : Axes, sequence of two Axes, Figure or None, default=None
            Where to draw the curve, and the density. One leaves the density out. None makes a
            figure.
        %(kwargs)

        %(self)
        """
        with_density = self.curves.measured is not None
        self._take_axes(
            ax,
            "the curve, and the density below",
            (1 + with_density, 1),
            allowed=(1, 2),
            sharex=True,
            figsize=(6.4, 4.8 if with_density else 4.0),
            height_ratios=[3.2, 1.0] if with_density else None,
        )
        self.lines_: dict[str, Any] = {}
        self._draw_curves(self.ax_)
        if self.shape is not None:
            self._draw_nearest(self.ax_, self.shape)
        self._restyle(kwargs, self.lines_)
        if with_density and len(self.axes_) == 2:
            self._draw_density(self.axes_[1])
        self.axes_[-1].set_xlabel(self.curves.xlabel)
        said = "" if self._own or not self.parameters else f": {self.parameters}"
        self.ax_.set_title(f"{self.title}{said}", fontsize="medium")
        self._legend_of_panels()
        if self._own:
            self._say_below()
        return self

    def _say_below(self) -> None:
        """Physics, estimates and a note, small, below the figure."""
        # A parameter stays in one line with its deviation and unit.
        together = self.parameters.replace(" ", "\xa0").replace(",\xa0", ", ")
        lines = [self.physics, together, self.curves.note]
        width = letters(self.figure_)
        text = "\n".join(wrapped(line, width) for line in lines if line)
        (legend,) = self.figure_.legends
        n_lines = text.count("\n") + 1 + len(legend.get_texts())
        least = CURVE + DENSITY * (len(self.axes_) - 1) + LINE * (n_lines + 2)
        self.figure_.set_figheight(max(self.figure_.get_figheight(), least * letter_size()))
        legend.set_title(text, {"size": "small"})
        legend.get_title().set(color=dimmed(0.75), multialignment="center")

    def _draw_curves(self, panel: Axes) -> None:
        found = self.curves
        look: dict[str, Any] = {"color": GREY, "lw": scaled(1.2), "ls": "--", "label": WITHOUT}
        panel.plot(found.without.x, found.without.y, **look)
        for (label, curve), colour in zip(found.curves.items(), PALETTE, strict=False):
            if curve.low is not None and curve.high is not None:
                meaning = BANDS.get(found.kind, BAND)
                draw_band(panel, curve.x, curve.low, curve.high, colour, meaning)
            symbols = SYMBOL.sub(lambda known: SYMBOLS[known[0]], label)
            (self.lines_[label],) = panel.plot(
                curve.x, curve.y, color=colour, lw=scaled(1.8), label=symbols
            )
        if found.kind == "gain":
            panel.set_xscale("log")
            panel.set_yscale("log")
            low, high = panel.get_ylim()
            panel.set_ylim(min(low, 1 / LEAST_GAIN), max(high, LEAST_GAIN))
            plain_logarithmic(panel.xaxis)
            plain_logarithmic(panel.yaxis)
        elif found.kind in ("gains", "delay"):
            low, high = panel.get_ylim()
            panel.set_ylim(min(0.0, low), high + 0.05 * abs(high))
        else:
            panel.axhline(0.0, color=foreground(), lw=scaled(0.6))
        panel.margins(x=0.0)
        panel.set_ylabel(found.ylabel)
        panel.grid(alpha=0.3)

    def _draw_nearest(self, panel: Axes, shape: Shape) -> None:
        """The named effect that comes nearest to one without a name, and the knots of that."""
        if shape.nearest_curve is not None and shape.is_near:
            look: dict[str, Any] = {"color": series_colour(1), "ls": "--", "lw": scaled(1.4)}
            look["label"] = f"nearest name: {shape.nearest['title'].iloc[0]}"
            panel.plot(shape.nearest_curve.index, shape.nearest_curve, **look)
        knots = np.asarray(shape.effect.knots or (), dtype=float)
        look = {"color": dimmed(), "lw": scaled(1.0), "label": "knots" if knots.size else None}
        panel.vlines(knots, 0.0, KNOT, transform=panel.get_xaxis_transform(), **look)

    def _draw_density(self, panel: Axes) -> None:
        values = np.asarray(self.curves.measured, dtype=float)
        low, high = self.ax_.get_xlim()
        heights, edges = np.histogram(
            values[np.isfinite(values)], np.linspace(low, high, BINS + 1), density=True
        )
        panel.stairs(heights, edges, fill=True, color=GREY, alpha=0.7)
        panel.set_yticks([])
        panel.set_ylabel("density\nin the runs", fontsize="small")
