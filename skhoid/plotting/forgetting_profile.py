"""Forgetting profile of a recursive model: weights of past samples, and the memory horizon."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import matplotlib as mpl
import numpy as np

from ._axes import letters_across, parameter_symbol, seconds_axis
from ._checks import fitted_end
from ._display import Display
from ._layout import figure_size
from ._roles import GREY, dimmed, foreground, scaled, series_colour, sized

STYLES = ("-", "--", "-.", ":")
LONGEST = 1e6  # samples; a longer horizon is as good as infinite
DECADES = np.array([10.0, 1000.0])  # samples, shown where all horizons are infinite
MOSTLY = 90  # percent of the horizons of a factor that varies are inside the panel
SIZE = (6.4, 3.4)  # inches
NARROW = 66  # letters across a figure, below which the panels are below each other
HEIGHT = 6.0  # inches of a narrow figure, of a font of 10 points
SHOWN = 4  # memory horizons of the past, by default


@dataclass(kw_only=True, eq=False, repr=False)
class ForgettingProfileDisplay(Display):
    """Weights of past measurements, and memory horizon over forgetting factor (Fig. 5.15).

    The left panel shows beta(t, k) = lambda(k+1) ... lambda(t), the weight at instant t of a
    measurement that is t - k samples old (Eq. 4.22): lambda^(t - k) where lambda is constant. The
    right one shows N0 = 1 / (1 - lambda), after which a weight is down to 1/e; a factor that
    varies covers a part of that curve. Instants without a measurement, at which a recursion forgets
    nothing, are taken as the others.

    Make it with :meth:`from_factors` or :meth:`from_estimator`.

    Parameters
    ----------
    weights : dict of ndarray
        Weights by label; the first of them is that of the newest measurement, 1.
    forgetting : dict of ndarray
        The forgetting factors that were at work, by label.
    dt : float or None, default=None
        Sampling time in s, for an axis in seconds.

    Attributes
    ----------
    axes_ : ndarray of Axes, shape (2,)
        Weights, and memory horizon.
    figure_ : Figure
        The figure that holds them.
    lines_ : dict of Line2D
        Weights by label.
    horizons_ : dict of Line2D
        Memory horizons by label: points, or parts of the curve. An infinite one is at the upper
        edge.
    curve_ : Line2D
        The memory horizon over the forgetting factor.
    seconds_ax_ : SecondaryAxis or None
        Age in seconds; None where the sampling time is not known.

    See Also
    --------
    skhoid.forgetting_factor : Forgetting factors of memory horizons.

    References
    ----------
    Van Grootheest, thesis, Section 4.3 and Fig. 5.15.

    Examples
    --------
    >>> from skhoid.plotting import ForgettingProfileDisplay
    >>> display = ForgettingProfileDisplay.from_factors([0.9, 0.99, 0.999])
    >>> list(display.lines_)
    ['λ = 0.9', 'λ = 0.99', 'λ = 0.999']
    >>> float(display.weights["λ = 0.99"][100])
    0.366
    """

    weights: Mapping[str, np.ndarray]
    forgetting: Mapping[str, np.ndarray]
    dt: float | None = None

    @classmethod
    def from_factors(
        cls,
        forgetting: Any,
        n_samples: int = 256,
        *,
        dt: float | None = None,
        ax: Any = None,
        **styles: Any,
    ) -> Self:
        """Draw forgetting factors.

        Parameters
        ----------
        forgetting : float, sequence of float, or dict
            Forgetting factors, one line each. In a dict of them by label an array is one factor
            over time, its last entry at the instant of the weights.
        n_samples : int, default=256
            Length of the past to draw, in samples.
        dt : float or None, default=None
            Sampling time in s, for an axis in seconds.
        ax : sequence of two Axes or None, default=None
            Where to draw. None makes a figure.
        **styles : dict
            Keywords of :meth:`plot` whose names end in ``_kw``.

        Returns
        -------
        display : ForgettingProfileDisplay

        Raises
        ------
        ValueError
            If a factor is not in (0, 1], or there is nothing to draw.
        """
        if not isinstance(forgetting, Mapping):
            factors = np.atleast_1d(np.asarray(forgetting, dtype=float))
            if factors.ndim != 1:
                raise ValueError(
                    "forgetting is a factor or a sequence of them, or a dict of factors by label "
                    f"(over time: an array); got an array of the shape {factors.shape}."
                )
            forgetting = {f"λ = {factor:.6g}": factor for factor in factors}
        if n_samples < 1 or not forgetting:
            raise ValueError(
                f"There is nothing to draw: {len(forgetting)} forgetting factors over "
                f"{n_samples} samples."
            )
        paths = {
            str(label): _checked(label, np.asarray(path, dtype=float))
            for label, path in forgetting.items()
        }
        return cls(
            weights={label: _weights(path, n_samples) for label, path in paths.items()},
            forgetting={label: np.atleast_1d(path) for label, path in paths.items()},
            dt=dt,
        ).plot(ax, **styles)

    @classmethod
    def from_estimator(
        cls,
        model: Any,
        *,
        time: float | None = None,
        n_samples: int | None = None,
        ax: Any = None,
        **styles: Any,
    ) -> Self:
        """Draw the forgetting of fitted recursive models.

        Parameters
        ----------
        model : fitted RecursiveARX, pipeline or search that ends in one, or dict of them by label
            Parameters with factors of their own have a line each; those that share one, one.
        time : float or None, default=None
            Instant of the weights in s, for forgetting that varies. None means the last.
        n_samples : int or None, default=None
            Length of the past to draw, in samples. None means four of the longest memory horizon
            that is not infinite, and no more than the models have seen; 256 where all are infinite.
        ax : sequence of two Axes or None, default=None
            Where to draw. None makes a figure.
        **styles : dict
            Keywords of :meth:`plot` whose names end in ``_kw``.

        Returns
        -------
        display : ForgettingProfileDisplay

        Raises
        ------
        sklearn.exceptions.NotFittedError
            If a model is not fitted.
        TypeError
            If a model has no forgetting factor.
        ValueError
            If ``time`` comes before the first instant of a model.
        """
        models = model if isinstance(model, Mapping) else {"": model}
        factors: dict[str, Any] = {}
        steps, seen = set(), 0
        for label, given in models.items():
            fitted = _recursive(given)
            steps.add(float(fitted.dt_))
            path, names = _path(fitted, time), list(fitted.parameter_names_)
            seen = max(seen, len(getattr(fitted, "coef_path_", ())))
            for name, factor in _by_parameter(path, names).items():
                prefix = ", ".join(filter(None, (str(label), name)))
                text = _factor_text(factor)
                factors[f"{prefix}: {text}" if prefix else text] = factor
        if n_samples is None:
            horizons = np.concatenate([np.atleast_1d(_horizon(f)) for f in factors.values()])
            finite = horizons[np.isfinite(horizons)]
            n_samples = int(np.ceil(SHOWN * finite.max())) + 1 if finite.size else 256
            n_samples = min(n_samples, seen or n_samples)
        return cls.from_factors(
            factors,
            n_samples,
            dt=steps.pop() if len(steps) == 1 else None,
            ax=ax,
            **styles,
        )

    def plot(
        self,
        ax: Any = None,
        *,
        line_kw: dict[str, Any] | None = None,
        horizon_kw: dict[str, Any] | None = None,
    ) -> Self:
        """Draw.

        Parameters
        ----------
        ax : sequence of two Axes or None, default=None
            Where to draw. None makes a figure.
        line_kw : dict or None, default=None
            Keywords of matplotlib for the weights.
        horizon_kw : dict or None, default=None
            Keywords of matplotlib for the memory horizons.

        Returns
        -------
        self : ForgettingProfileDisplay
        """
        narrow = letters_across(figure_size(SIZE, 1)[0]) < NARROW
        shape, ratios = ((2, 1), None) if narrow else ((1, 2), (1.3, 1))
        self.axes_ = self._take_axes(
            ax, "weights, and memory horizon", shape, figsize=SIZE, width_ratios=ratios
        )
        if self._own and narrow:
            letter = mpl.rcParams["font.size"] / 10.0
            self.figure_.set_figheight(max(self.figure_.get_figheight(), HEIGHT * letter))
        self._draw_weights(self.axes_[0])
        self._draw_horizons(self.axes_[1])
        self._restyle(
            {"line": line_kw, "horizon": horizon_kw}, line=self.lines_, horizon=self.horizons_
        )
        self._legend_of_panels()
        return self

    def _style(self, position: int) -> dict[str, Any]:
        dashes = STYLES[position % len(STYLES)]
        return {"color": series_colour(position), "ls": dashes}

    def _draw_weights(self, panel: Any) -> None:
        self.lines_: dict[str, Any] = {}
        for position, (label, weights) in enumerate(self.weights.items()):
            (self.lines_[label],) = panel.plot(
                np.arange(weights.size),
                weights,
                lw=scaled(1.6),
                label=label,
                **self._style(position),
            )
        panel.axhline(np.exp(-1), color=GREY, lw=scaled(0.8), ls=":", zorder=1)
        longest = max(weights.size for weights in self.weights.values())
        panel.text(longest, np.exp(-1), "1/e ", color=dimmed(), ha="right", va="bottom")
        panel.set_xlim(0, max(longest - 1, 1))
        panel.set_ylim(0, 1.05)
        panel.set_xlabel("age $t - k$, samples")
        panel.set_ylabel(r"weight $\beta(t, k)$")
        panel.grid(alpha=0.3)
        self.seconds_ax_: Any = None
        if self.dt is not None:
            self.seconds_ax_ = seconds_axis(panel, self.dt, "age, s")

    def _draw_horizons(self, panel: Any) -> None:
        horizons = {label: _horizon(path) for label, path in self.forgetting.items()}
        finite = [h[np.isfinite(h)] for h in horizons.values() if np.isfinite(h).any()] or [DECADES]
        shortest = min(h.min() for h in finite)
        # A factor that varies comes as near to 1 as it likes.
        longest = max(np.percentile(h, MOSTLY) for h in finite)
        # Never less than a decade, which would have no tick with a name.
        bottom, top = max(min(shortest / 1.5, longest / 4), 1.01), 4.0 * longest
        curve = np.geomspace(bottom, top, 200)
        (self.curve_,) = panel.plot(1 - 1 / curve, curve, color=GREY, lw=scaled(1.0), zorder=1)
        self.horizons_: dict[str, Any] = {}
        for position, (label, horizon) in enumerate(horizons.items()):
            ends = np.minimum([horizon.min(), horizon.max()], top)
            constant = ends[0] == ends[1]
            at = ends[:1] if constant else np.geomspace(ends[0], ends[1], 100)
            (self.horizons_[label],) = panel.plot(
                np.where(at < top, 1 - 1 / at, 1.0),
                at,
                color=self._style(position)["color"],
                marker="^" if at[0] == top else "o" if constant else None,
                ls="none" if constant else "-",
                lw=scaled(4.0),
                ms=sized(7),
                markeredgecolor=foreground(),
                markeredgewidth=0.6,
                clip_on=False,
                zorder=3 if constant else 2,
            )
            if at[-1] == top:
                panel.annotate("∞", (1.0, top), (6, 0), textcoords="offset points", va="center")
        panel.set_yscale("log")
        panel.set_ylim(curve[0], top)
        panel.set_xlim(right=1.0)
        panel.set_xlabel(r"forgetting factor $\lambda$")
        panel.set_ylabel("memory horizon $N_0$, samples")
        panel.grid(alpha=0.3)


def _checked(label: Any, path: np.ndarray) -> np.ndarray:
    if path.ndim > 1 or path.size == 0:
        raise ValueError(
            f"The forgetting factor {label!r} is a number or an array over time; got the shape "
            f"{path.shape}."
        )
    if not ((path > 0) & (path <= 1)).all():
        raise ValueError(
            f"A forgetting factor lies above 0 and up to 1; {label!r} has "
            f"{path[~((path > 0) & (path <= 1))].ravel()[0]:g}."
        )
    return path


def _weights(path: np.ndarray, n_samples: int) -> np.ndarray:
    """Weights at the last instant, the newest measurement first."""
    if path.ndim == 0:
        return np.asarray(path ** np.arange(n_samples))
    latest = path[::-1][: n_samples - 1]
    return np.concatenate([[1.0], np.cumprod(latest)])[: min(n_samples, path.size)]


def _horizon(path: Any) -> np.ndarray:
    """N0, infinite where it is longer than any recording."""
    gone = 1.0 - np.atleast_1d(np.asarray(path, dtype=float))
    return np.where(gone * LONGEST > 1, 1 / np.maximum(gone, 1 / LONGEST), np.inf)


def _factor_text(factor: Any) -> str:
    """The factor as the legend shows it."""
    if np.ndim(factor):
        return f"λ = {np.min(factor):.4g} to {np.max(factor):.4g}"
    horizon = float(_horizon(factor)[0])
    samples = "∞" if np.isinf(horizon) else f"{horizon:.4g}"
    return f"λ = {float(factor):.5g}, $N_0$ = {samples}"


def _recursive(estimator: Any) -> Any:
    """The fitted recursive model at the end of searches and pipelines."""
    model = fitted_end(estimator)
    if not hasattr(model, "forgetting_"):
        raise TypeError(
            "ForgettingProfileDisplay.from_estimator draws fitted RecursiveARX models, or "
            f"pipelines and searches that end in one; got {type(model).__name__}. Forgetting "
            "factors alone: from_factors."
        )
    return model


def _path(model: Any, time: float | None) -> np.ndarray:
    """Forgetting factors up to an instant, as (n_instants, n_params), (n_instants,) or less."""
    forgetting = np.asarray(model.forgetting_, dtype=float)
    n_params = len(model.parameter_names_)
    over_time = forgetting.ndim == 2 or (forgetting.ndim == 1 and forgetting.size != n_params)
    if time is None or not over_time:
        return forgetting if over_time or forgetting.ndim == 0 else forgetting[None]
    known = int(np.sum(np.asarray(model.time_path_) <= time))
    if known == 0:
        raise ValueError(
            f"time={time:g} s is before the first instant of the model, {model.time_path_[0]:g} s."
        )
    return forgetting[:known]


def _by_parameter(path: np.ndarray, names: list[str]) -> dict[str, Any]:
    """Factors of their own, each with the names of the parameters that share it."""
    if path.ndim < 2:
        return {"": path if path.ndim else float(path)}
    groups: dict[bytes, list[str]] = {}
    for name, column in zip(names, path.T, strict=True):
        groups.setdefault(column.tobytes(), []).append(name)
    found = {}
    for shared in groups.values():
        column = path[:, names.index(shared[0])]
        label = "" if len(shared) == len(names) else ", ".join(map(parameter_symbol, shared))
        found[label] = float(column[0]) if len(column) == 1 else column
    return found
