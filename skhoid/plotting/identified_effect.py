"""Plot of one identified effect: what it does, with its uncertainty."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, Self

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from sklearn.utils.validation import check_is_fitted

from ..effects.registry import title_of
from ..model.effect_curves import EffectCurves, effect_curves
from ..model.parameters import parameter_text
from ._axes import letters, letters_above, letters_across, plain_logarithmic, wrapped
from ._display import Display
from ._roles import GREY, PALETTE, dimmed, foreground, scaled, veil
from .operator_parameters import SYMBOLS

WITHOUT = "without the effect"
BAND = "95 % band"
BINS = 60
LEAST_GAIN = 1.5  # up and down on the axis, so that a small effect looks small
LINE = 0.17  # inches of a line of the text below, of a font of 10 points
CURVE, DENSITY = 2.3, 0.8  # inches that the panels take at least
SYMBOL = re.compile(r"\b(" + "|".join(SYMBOLS) + r")\b")


@dataclass(kw_only=True, eq=False, repr=False)
class IdentifiedEffectDisplay(Display):
    """What an identified effect does, with a band that holds 95 % of its uncertainty.

    An effect on the error or the output is a curve from what goes in to what comes out (a loop
    where it depends on the past), with the density of the values met in the runs below. Gains and
    delays are drawn over the time in the run, or over the channel that they follow; a further path
    by the response of the output to a pulse in its channel; a filter of the command by its gain
    over frequency; a spring by the command that holds an output; an offset by its course. Bands
    are of draws from the covariance of the estimates. Dashed lines are the model without it. Below
    the figure stands what the effect is, and its parameters with standard errors.

    Make it with :meth:`from_estimator`, which draws effects of your own too.

    Parameters
    ----------
    name : str
        Name of the effect in the model.
    curves : EffectCurves
        Its curves.
    physics : str, default=""
        The effect in a sentence.
    parameters : str, default=""
        Its parameters as text.

    Attributes
    ----------
    axes_ : ndarray of Axes, shape (1,) or (2,)
        The curve, and the density below where there is one.
    ax_ : Axes
        The first of them.
    figure_ : Figure
        The figure that holds them.
    lines_ : dict of Line2D
        The curves.
    bands_ : dict of FillBetweenPolyCollection
        Their bands, where the uncertainty is known.
    without_ : Line2D
        What there would be without the effect.
    density_ : StepPatch or None
        The density.

    See Also
    --------
    EffectStepsDisplay : What the effect does to the simulation.

    Examples
    --------
    >>> from skhoid import OperatorRegressor, make_tracking_runs
    >>> from skhoid.effects import DeadZone
    >>> from skhoid.plotting import IdentifiedEffectDisplay
    >>> X, y = make_tracking_runs(n_runs=2, remnant_intensity=0.05, random_state=1)
    >>> model = OperatorRegressor(effects=DeadZone(form="gap")).fit(X, y)
    >>> display = IdentifiedEffectDisplay.from_estimator(model, "dead_zone", X)
    >>> display.curves.kind
    'map'
    """

    name: str
    curves: EffectCurves
    physics: str = ""
    parameters: str = ""

    @classmethod
    def from_estimator(
        cls,
        model: Any,
        effect: str | None = None,
        X: Any = None,
        y: Any = None,
        *,
        n_draws: int = 300,
        random_state: Any = 0,
        ax: Any = None,
        **styles: Any,
    ) -> Self:
        """Draw an effect of a fitted model.

        Parameters
        ----------
        model : fitted OperatorRegressor, ARXRegressor or EffectSearchCV
            The model; of a search, the best.
        effect : str or None, default=None
            Name of the effect in ``model.effects_``. None takes the first.
        X : DataFrame or array of shape (n_rows, n_columns) or None, default=None
            Channels of runs, which amplitudes, times and densities are taken from. None takes the
            amplitudes and the duration of the runs of the fit, and draws no density.
        y : Series or array of shape (n_rows,) or None, default=None
            Measured output, for the density of its values. None takes what the model predicts.
        n_draws : int, default=300
            Draws of the parameters that bands are made of; 0 draws no bands.
        random_state : int, Generator or None, default=0
            Of these draws.
        ax : Axes, sequence of two Axes or None, default=None
            Where to draw, see :meth:`plot`. None makes a figure.
        **styles : dict
            Keywords of :meth:`plot` whose names end in ``_kw``.

        Returns
        -------
        display : IdentifiedEffectDisplay

        Raises
        ------
        ValueError
            If the model has no such effect.
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
        return cls(
            name=name,
            curves=effect_curves(model, name, X, y, n_draws=n_draws, random_state=random_state),
            physics=effects[name].physics_in("human"),
            parameters=parameter_text(model.parameters_, name),
        ).plot(ax, **styles)

    def plot(
        self,
        ax: Any = None,
        *,
        line_kw: dict[str, Any] | None = None,
        band_kw: dict[str, Any] | None = None,
        without_kw: dict[str, Any] | None = None,
    ) -> Self:
        """Draw.

        Parameters
        ----------
        ax : Axes, sequence of two Axes or None, default=None
            Where to draw the curve, and the density. One leaves the density out. None makes a
            figure.
        line_kw : dict or None, default=None
            Keywords of matplotlib for the curves.
        band_kw : dict or None, default=None
            Keywords of matplotlib for their bands.
        without_kw : dict or None, default=None
            Keywords of matplotlib for what there would be without the effect.

        Returns
        -------
        self : IdentifiedEffectDisplay
        """
        found = self.curves
        with_density = found.measured is not None
        self.axes_ = self._take_axes(
            ax,
            "the curve, and the density below",
            (1 + with_density, 1),
            allowed=(1, 2),
            sharex=True,
            figsize=(6.4, 4.8 if with_density else 4.0),
            height_ratios=[3.2, 1.0] if with_density else None,
        )
        self.ax_ = self.axes_[0]
        self.lines_: dict[str, Any] = {}
        self.bands_: dict[str, Any] = {}
        self.density_: Any = None
        self._draw_curves(self.ax_)
        self._restyle(
            {"line": line_kw, "band": band_kw, "without": without_kw},
            line=self.lines_,
            band=self.bands_,
            without=self.without_,
        )
        if with_density and len(self.axes_) == 2:
            self._draw_density(self.axes_[1])
        self.axes_[-1].set_xlabel(found.xlabel)
        title = wrapped(self._title_text(), letters_above(self.ax_))
        self.ax_.set_title(title, fontsize="medium")
        self._legend_of_panels()
        if self._own:
            self._say_below(title)
        return self

    def _title_text(self) -> str:
        """What the effect is called, with all that is said of it in one line."""
        title = title_of(self.name)
        title = title[:1].upper() + title[1:]
        if not self._own:  # there is no room below
            return f"{title}: {self.parameters}" if self.parameters else title
        whole = f"{title}: {self.physics}".rstrip(".")
        fits = self.physics and len(whole) <= letters_above(self.ax_)
        return whole if fits else title

    def _say_below(self, title: str) -> None:
        """Physics, estimates and a note, small, below the figure."""
        # A parameter stays in one line with its deviation and unit.
        together = self.parameters.replace(" ", "\xa0").replace(",\xa0", ", ")
        said = self.physics.rstrip(".") in title
        lines = ["" if said else self.physics, together, self.curves.note]
        width = letters(self.figure_)
        text = "\n".join(wrapped(line, width) for line in lines if line)
        (legend,) = self.figure_.legends
        n_lines = text.count("\n") + 1 + 1.4 * len(legend.get_texts()) / legend._ncols
        least = CURVE + DENSITY * (len(self.axes_) - 1) + LINE * (n_lines + 2)
        letter = mpl.rcParams["font.size"] / 10.0
        self.figure_.set_figheight(max(self.figure_.get_figheight(), least * letter))
        legend.set_title(text, {"size": "small"})
        legend.get_title().set(color=dimmed(0.75), multialignment="center")

    def _draw_curves(self, panel: Axes) -> None:
        found = self.curves
        (self.without_,) = panel.plot(
            found.without.x, found.without.y, color=GREY, lw=scaled(1.2), ls="--", label=WITHOUT
        )
        for (label, curve), colour in zip(found.curves.items(), PALETTE, strict=False):
            if curve.low is not None and curve.high is not None:
                self.bands_[label] = panel.fill_between(
                    curve.x,
                    curve.low,
                    curve.high,
                    color=colour,
                    alpha=veil(0.25),
                    lw=0,
                    label=BAND if len(self.bands_) == 0 else None,
                )
            (self.lines_[label],) = panel.plot(
                curve.x, curve.y, color=colour, lw=scaled(1.8), label=_with_symbols(label)
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
        height = panel.get_window_extent().height / panel.figure.dpi
        panel.set_ylabel(wrapped(found.ylabel, letters_across(height)))
        panel.grid(alpha=0.3)

    def _draw_density(self, panel: Axes) -> None:
        values = np.asarray(self.curves.measured, dtype=float)
        low, high = self.ax_.get_xlim()
        heights, edges = np.histogram(
            values[np.isfinite(values)], np.linspace(low, high, BINS + 1), density=True
        )
        self.density_ = panel.stairs(heights, edges, fill=True, color=GREY, alpha=0.7)
        panel.set_yticks([])
        panel.set_ylabel("density\nin the runs", fontsize="small")


def _with_symbols(label: str) -> str:
    """The same with parameters as symbols."""
    return SYMBOL.sub(lambda found: SYMBOLS[found[0]], label)
