"""The loss of every candidate delay, and the delay over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator, StrMethodFormatter

from ..arx.searches import DelaySearchCV
from ..preprocessing.base import as_fitted
from ._axes import with_unit
from ._checks import check_search
from ._display import Display
from ._roles import BLUE, VERMILION, outlined, scaled, sized, veil

WORTHLESS = 100.0  # percent; with more, the model is worse than none at all
MAX_NAMED = 25  # candidates that get a tick label of their own


@dataclass(kw_only=True, eq=False, repr=False)
class DelayLossDisplay(Display):
    """Loss of each candidate delay, or the best delay over time.

    The lower axis is in seconds and the upper one in samples. With several inputs whose delays
    differ, candidates stand side by side, named by their delays in samples.

    Make it with :meth:`from_estimator`.

    Parameters
    ----------
    nk : list of int or tuple
        Candidates in samples.
    loss : ndarray of shape (n_candidates,)
        Loss of each; NaN leaves a gap.
    best_index : int
        Position of the chosen candidate.
    dt : float
        Sampling time of the model's grid in seconds.
    criterion : {"one_step", "vaf"}, default="one_step"
        What the loss is.
    std : ndarray of shape (n_candidates,) or None, default=None
        Standard deviation of the loss over folds.
    n_folds : int, default=1
        Number of folds.
    window_time, nk_path : ndarray of shape (n_windows,) or None, default=None
        Centres of sliding windows in seconds, and the best candidate in each, in samples.
    unit : str or None, default=None
        Unit of the output.

    Attributes
    ----------
    ax_ : Axes
        The panel.
    samples_ax_ : SecondaryAxis or None
        Its second axis, in samples; None where candidates stand side by side.
    figure_ : Figure
        The figure that holds it.
    line_ : Line2D
        The loss, or the delay over time.
    best_ : Line2D
        The mark of the best delay.
    band_ : FillBetweenPolyCollection or None
        One standard deviation over folds to either side.

    Examples
    --------
    >>> from skhoid import DelaySearchCV, load_human_tracking
    >>> from skhoid.plotting import DelayLossDisplay
    >>> X, y = load_human_tracking(1)
    >>> search = DelaySearchCV(nk=range(1, 21)).fit(X, y)
    >>> display = DelayLossDisplay.from_estimator(search, unit="px")
    >>> display.ax_.get_ylabel()
    'mean squared one-step error, px²'
    """

    nk: Sequence[Any]
    loss: np.ndarray
    best_index: int
    dt: float
    criterion: str = "one_step"
    std: np.ndarray | None = None
    n_folds: int = 1
    window_time: np.ndarray | None = None
    nk_path: np.ndarray | None = None
    unit: str | None = None

    @classmethod
    def from_estimator(
        cls,
        search: DelaySearchCV,
        *,
        kind: str = "loss",
        unit: str | None = None,
        ax: Any = None,
        **styles: Any,
    ) -> Self:
        """Draw a fitted search.

        Parameters
        ----------
        search : DelaySearchCV
            Fitted.
        kind : {"loss", "path"}, default="loss"
            The loss of every candidate, or the delay over time, which needs a search with
            ``window=``.
        unit : str or None, default=None
            Unit of the output, for the axis of the one-step loss.
        ax : Axes or None, default=None
            Where to draw. None makes a figure.
        **styles : dict
            Keywords of :meth:`plot` whose names end in ``_kw``.

        Returns
        -------
        display : DelayLossDisplay
        """
        check_search(search, DelaySearchCV, cls.__name__)
        results = search.cv_results_
        n_folds = sum(name.startswith("split") for name in results)
        display = cls(
            nk=results["nk"],
            loss=search.loss_,
            best_index=search.best_index_,
            dt=search.dt_,
            criterion=as_fitted(search).criterion,
            std=results["std_test_score"] if n_folds > 1 else None,
            n_folds=n_folds,
            window_time=getattr(search, "window_time_", None),
            nk_path=getattr(search, "nk_path_", None),
            unit=unit,
        )
        return display.plot(ax, kind=kind, **styles)

    def plot(
        self,
        ax: Any = None,
        *,
        kind: str = "loss",
        line_kw: dict[str, Any] | None = None,
        band_kw: dict[str, Any] | None = None,
        best_kw: dict[str, Any] | None = None,
    ) -> Self:
        """Draw.

        Parameters
        ----------
        ax : Axes or None, default=None
            Where to draw. None makes a figure.
        kind : {"loss", "path"}, default="loss"
            The loss of every candidate, or the delay over time.
        line_kw : dict or None, default=None
            Keywords of matplotlib for the curve.
        band_kw : dict or None, default=None
            Keywords of matplotlib for the band.
        best_kw : dict or None, default=None
            Keywords of matplotlib for the mark of the best delay.

        Returns
        -------
        self : DelayLossDisplay
        """
        styles = {"line": line_kw, "band": band_kw, "best": best_kw}
        if kind not in ("loss", "path"):
            raise ValueError(f"kind must be 'loss' or 'path'; got {kind!r}.")
        if kind == "path" and self.nk_path is None:
            raise ValueError(
                "kind='path' draws the delay over time, which the search has not estimated: fit "
                "DelaySearchCV(..., window=<seconds>)."
            )
        shows = "the loss over the delay, or the delay over time"
        (self.ax_,) = self._take_axes(ax, shows, figsize=(6.4, 4.2))
        self.samples_ax_: Any = None
        self.band_: Any = None
        if kind == "path":
            self._draw_path()
        elif (samples := self._delays_in_samples()) is None:
            self._draw_loss(np.arange(len(self.nk)))
            self.line_.set_linestyle("none")  # neighbours are not near each other
            self._name_candidates()
        else:
            self._draw_loss(samples * self.dt)
            self.ax_.set_xlabel("delay, s")
            self.samples_ax_ = self.ax_.secondary_xaxis("top", functions=self._to_samples())
            self.samples_ax_.set_xlabel("delay, samples")
            self.samples_ax_.xaxis.set_major_locator(MaxNLocator("auto", integer=True))
        self.ax_.set_title(self._best_text(), fontsize="medium")
        self._restyle(styles, line=self.line_, band=self.band_, best=self.best_)
        self._legend_of_panels()
        return self

    def _delays_in_samples(self) -> np.ndarray | None:
        """One delay per candidate, or None if inputs have delays of their own."""
        table = np.array([np.atleast_1d(nk) for nk in self.nk], dtype=float)
        if np.all(table == table[:, :1]):
            return table[:, 0]
        return None

    def _draw_loss(self, at: np.ndarray) -> None:
        order = np.argsort(at, kind="stable")
        at, loss = at[order], np.asarray(self.loss, dtype=float)[order]
        (self.line_,) = self.ax_.plot(at, loss, color=BLUE, marker=".", ms=sized(6), lw=scaled(1.2))
        if self.std is not None:
            std = np.where(loss < WORTHLESS, np.asarray(self.std, dtype=float)[order], np.nan)
            self.band_ = self.ax_.fill_between(
                at,
                loss - std,
                loss + std,
                color=BLUE,
                alpha=veil(0.2),
                lw=0,
                label=f"± 1 standard deviation over {self.n_folds} folds",
            )
        position = int(np.flatnonzero(order == self.best_index)[0])
        (self.best_,) = self.ax_.plot(
            at[position],
            loss[position],
            color=VERMILION,
            marker="*",
            ms=sized(15),
            ls="none",
            label="best",
            zorder=3,
            **outlined(),
        )
        if self.criterion == "vaf":
            self.ax_.set_ylabel("100 − cross-validated VAF, %")
            self._scale_vaf_loss(loss[~np.isnan(loss)])
        else:
            squared = f"{self.unit}²" if self.unit else None
            self.ax_.set_ylabel(with_unit("mean squared one-step error", squared))
        self.ax_.grid(alpha=0.3)

    def _scale_vaf_loss(self, loss: np.ndarray) -> None:
        lowest, highest = loss.min(), loss.max()
        if 0 < 10 * lowest < highest:
            self.ax_.set_yscale("log")
            self.ax_.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            self.ax_.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
            self.ax_.yaxis.set_minor_locator(NullLocator())
            self.ax_.set_ylim(bottom=lowest / 1.5)
        if lowest < WORTHLESS < highest:
            self.ax_.set_ylim(top=1.05 * WORTHLESS)

    def _name_candidates(self) -> None:
        names = [str(nk) for nk in self.nk]
        every = -(-len(names) // MAX_NAMED)
        self.ax_.set_xticks(range(0, len(names), every), names[::every], rotation=90)
        self.ax_.set_xlabel("delay of each input, samples")

    def _draw_path(self) -> None:
        time, delay = np.asarray(self.window_time), np.asarray(self.nk_path) * self.dt
        best = float(np.max(self.nk[self.best_index])) * self.dt
        self.best_ = self.ax_.axhline(
            best, color=VERMILION, ls="--", lw=scaled(1.2), label="all data"
        )
        (self.line_,) = self.ax_.plot(
            time, delay, color=BLUE, marker=".", ms=sized(8), lw=scaled(1.2), label="sliding window"
        )
        self.ax_.set_xlabel("time, s")
        self.ax_.set_ylabel("delay, s")
        self.samples_ax_ = self.ax_.secondary_yaxis("right", functions=self._to_samples())
        self.samples_ax_.set_ylabel("delay, samples")
        self.samples_ax_.yaxis.set_major_locator(MaxNLocator("auto", integer=True))
        self.ax_.grid(alpha=0.3)
        self.ax_.margins(y=0.15)

    def _to_samples(self) -> tuple[Any, Any]:
        return (lambda seconds: seconds / self.dt), (lambda samples: samples * self.dt)

    def _best_text(self) -> str:
        nk = self.nk[self.best_index]
        if not isinstance(nk, tuple):
            return f"Best delay: {nk * self.dt:.3g} s, {nk} sample{'s' * (nk != 1)}"
        seconds = ", ".join(f"{k * self.dt:.3g}" for k in nk)
        return f"Best delays: ({seconds}) s, {nk} samples"
