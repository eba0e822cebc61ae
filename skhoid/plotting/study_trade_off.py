"""How a study's quality of recursive models depends on the memory horizon."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd
from matplotlib.lines import Line2D

from ._axes import MARKERS, note_outside
from ._checks import check_option
from ._display import Display
from ._horizons import horizon_axis, near_best
from ._layout import page_width
from ._roles import GREY, background, foreground, outlined, scaled, series_colour, sized
from ._study import REPLICATION, cell_text, check_table, ordered, refuse_mixtures
from ._study_tables import TRADE_OFF_KEYS, VAF, best_horizon, trade_off_means

NAME = "StudyTradeOffDisplay"
LABELS = {
    "gain": "gain in VAF of validation\nover no forgetting, points",
    "vaf_validation": "VAF of validation, %",
    "vaf_estimation": "VAF of estimation, %",
    "overfit_difference": "VAF of estimation −\nvalidation, points",
    "overfit_ratio": "VAF of estimation /\nvalidation",
    "tradeoff_ratio": "VAF of validation /\nthat of no forgetting",
}
LOWER_IS_BETTER = ("overfit_difference", "overfit_ratio")
WITHOUT = {"gain": 0.0, "tradeoff_ratio": 1.0}  # values of no forgetting
FEW = 3  # conditions, up to which each has a row
MARGIN = 0.08


@dataclass(kw_only=True, eq=False, repr=False)
class StudyTradeOffDisplay(Display):
    """Tracking ability against noise sensitivity in all cells of a study (Figs. 13, J.1-J.5).

    A panel for each condition and form of forgetting, a line for each remnant intensity: means over
    the replications against the memory horizon N0 in samples on a logarithmic axis, with no
    forgetting (an infinite horizon) at its end. An asterisk marks the horizon of each line with
    the best VAF of validation; the dashed line that with the best mean of all cells of the form.

    The panels of one condition have the same limits. These leave out values that are far worse than
    the median of their line, as those of a few samples' memory are; a note counts them.

    Make it with :meth:`from_table`.

    Parameters
    ----------
    means : DataFrame
        One row per cell: ``condition``, ``form``, ``remnant_intensity``, ``memory_horizon`` in
        samples, the number of replications ``n``, and the means ``vaf_estimation``,
        ``vaf_validation`` (%), ``gain``, ``overfit_difference`` (points), ``overfit_ratio`` and
        ``tradeoff_ratio``. The ratios are those of means.

    Attributes
    ----------
    axes_ : ndarray of Axes, shape (n_rows, n_columns)
        The panels; with more than three conditions two of them share a row.
    ax_ : Axes
        The first of them.
    figure_ : Figure
        The figure that holds them.
    panels_ : list of tuple (condition, form)
        What each panel of ``axes_.flat`` shows.
    lines_ : dict of Line2D
        Values by (condition, form, remnant intensity).
    best_ : dict of Line2D
        Marks of the best horizons by the same.
    best_overall_ : dict of float
        The horizon with the best mean VAF of validation over conditions and intensities, by form.
    infinite_ : float
        Where an infinite horizon stands on the axis.
    notes_ : list of Text or None
        Count of values outside, in each panel.

    See Also
    --------
    MemoryHorizonDisplay : The same of cross-validated runs.

    References
    ----------
    Van Grootheest, thesis, Eqs. 31-32 and J.1-J.6, Fig. 13 and Appendix J.

    Examples
    --------
    >>> import pandas as pd
    >>> from skhoid.plotting.study_trade_off import StudyTradeOffDisplay
    >>> table = pd.DataFrame(
    ...     {
    ...         "condition": "C4",
    ...         "remnant_intensity": 0.15,
    ...         "replication": 0,
    ...         "form": "lambda",
    ...         "memory_horizon": [64, 256, 1024, float("inf")],
    ...         "vaf_estimation": [85.0, 82.0, 74.0, 68.0],
    ...         "vaf_validation": [75.0, 78.0, 72.0, 67.0],
    ...     }
    ... )
    >>> display = StudyTradeOffDisplay.from_table(table)
    >>> display.means["gain"].tolist(), display.best_overall_
    ([8.0, 11.0, 5.0, 0.0], {'lambda': 256.0})
    """

    means: pd.DataFrame

    @classmethod
    def from_table(
        cls, table: pd.DataFrame, *, kind: str = "gain", ax: Any = None, **styles: Any
    ) -> Self:
        """Draw the table of a study of forgetting.

        Parameters
        ----------
        table : DataFrame
            One row per cell, replication, form of forgetting and horizon: ``condition``,
            ``remnant_intensity``, ``replication``, ``form``, ``memory_horizon`` (samples,
            infinite without forgetting), ``vaf_estimation`` and ``vaf_validation`` (%).
        kind : str, default="gain"
            ``"gain"`` of the VAF of validation over no forgetting (Eqs. 31-32, Fig. 13); the VAF
            itself, ``"vaf_validation"`` (Fig. J.2) or ``"vaf_estimation"`` (Fig. J.1); VAF of
            estimation less validation, ``"overfit_difference"`` (Eqs. J.1-J.2), or over it,
            ``"overfit_ratio"`` (Eqs. J.3-J.4); and VAF of validation over that of no forgetting,
            ``"tradeoff_ratio"`` (Eqs. J.5-J.6).
        ax : array of Axes or None, default=None
            Where to draw, one for each condition and form, the forms of a condition after each
            other. None makes a figure.
        **styles : dict
            Keywords of :meth:`plot` whose names end in ``_kw``.

        Returns
        -------
        display : StudyTradeOffDisplay

        Raises
        ------
        TypeError
            If ``table`` is no DataFrame.
        ValueError
            If a column is missing, cells would be mixed, ``kind`` is not known, or there is no
            value of it.
        """
        check_table(table, [*TRADE_OFF_KEYS, *VAF, REPLICATION], NAME)
        refuse_mixtures(table, TRADE_OFF_KEYS, NAME)
        return cls(means=trade_off_means(table)).plot(ax, kind=kind, **styles)

    def plot(
        self,
        ax: Any = None,
        *,
        kind: str = "gain",
        line_kw: dict[str, Any] | None = None,
        best_kw: dict[str, Any] | None = None,
    ) -> Self:
        """Draw.

        Parameters
        ----------
        ax : array of Axes or None, default=None
            Where to draw, one for each condition and form. None makes a figure.
        kind : str, default="gain"
            What to draw, see :meth:`from_table`.
        line_kw : dict or None, default=None
            Keywords of matplotlib for the curves.
        best_kw : dict or None, default=None
            Keywords of matplotlib for the marks of the best horizons.

        Returns
        -------
        self : StudyTradeOffDisplay
        """
        styles = {"line": line_kw, "best": best_kw}
        check_option("kind", kind, LABELS)
        if not np.isfinite(self.means[kind]).any():
            raise ValueError(
                f"There is no value of {kind!r} to draw: it compares with no forgetting, and the "
                "table has no memory_horizon = inf, or with a VAF of 0."
            )
        conditions, forms = ordered(self.means["condition"]), ordered(self.means["form"])
        self.panels_ = [(condition, form) for condition in conditions for form in forms]
        beside = 2 if len(conditions) > FEW else 1  # conditions in a row
        shape = -(-len(conditions) // beside), beside * len(forms)
        self.axes_ = self._take_axes(
            ax,
            "one for each condition and form",
            shape,
            allowed=(len(self.panels_),),
            figsize=(page_width(max(6.4, 2.0 + 2.4 * shape[1]), shape[1]), 1.4 + 2.2 * shape[0]),
        )
        panels, spare = np.split(self.axes_, [len(self.panels_)])
        for panel in spare:
            panel.remove()
        if self._own:
            self.axes_ = self.axes_.reshape(shape)
        self.ax_ = panels[0]
        self.lines_: dict[tuple[Any, Any, Any], Any] = {}
        self.best_: dict[tuple[Any, Any, Any], Any] = {}
        self.best_overall_ = {form: best_horizon(self.means, form) for form in forms}
        self.notes_: list[Any] = []
        intensities = ordered(self.means["remnant_intensity"])
        horizons = self.means["memory_horizon"].to_numpy(dtype=float)
        for (condition, form), panel in zip(self.panels_, panels, strict=True):
            self.infinite_ = horizon_axis(panel, horizons)
            self._draw(panel, condition, form, intensities, kind)
            panel.set_title(f"{condition}, {cell_text('form', form)}", fontsize="medium")
        for number, condition in enumerate(conditions):
            beside_each_other = panels[number * len(forms) : (number + 1) * len(forms)]
            self._limit(beside_each_other, condition, kind)
            for form, panel in zip(forms, beside_each_other, strict=True):
                shown = self._cell(condition, form)[kind].to_numpy(dtype=float)
                # Worse values leave at the bottom, or at the top; the note stands there.
                corner = ("top" if kind in LOWER_IS_BETTER else "bottom", "left")
                self.notes_.append(note_outside(panel, shown, corner))
                panel.tick_params(labelleft=not self._own or form == forms[0])
        self._label(panels, shape, len(forms), kind)
        self._restyle(styles, line=self.lines_, best=self.best_)
        self._explain(intensities)
        return self

    def _cell(self, condition: Any, form: Any) -> pd.DataFrame:
        table = self.means
        return table[(table["condition"] == condition) & (table["form"] == form)]

    def _draw(
        self, panel: Any, condition: Any, form: Any, intensities: list[Any], kind: str
    ) -> None:
        panel.grid(alpha=0.3)
        if kind in WITHOUT:
            panel.axhline(WITHOUT[kind], color=GREY, lw=scaled(0.8), zorder=1)
        overall = self.best_overall_[form]
        if overall is not None:
            at = self.infinite_ if np.isinf(overall) else overall
            panel.axvline(at, color=foreground(), ls="--", lw=scaled(1.0), zorder=1.5)
        of_panel = self._cell(condition, form)
        for position, P_n in enumerate(intensities):
            rows = of_panel[of_panel["remnant_intensity"] == P_n].sort_values("memory_horizon")
            if rows.empty:
                continue
            colour, key = series_colour(position), (condition, form, P_n)
            at = rows["memory_horizon"].replace(np.inf, self.infinite_).to_numpy(dtype=float)
            value = rows[kind].to_numpy(dtype=float)
            marker = MARKERS[position % len(MARKERS)]
            (self.lines_[key],) = panel.plot(
                at, value, color=colour, marker=marker, ms=sized(3), lw=scaled(1.1), zorder=2.5
            )
            if rows["vaf_validation"].notna().any():
                best = int(np.nanargmax(rows["vaf_validation"]))
                (self.best_[key],) = panel.plot(
                    at[best],
                    value[best],
                    color=colour,
                    marker="*",
                    ms=sized(11),
                    zorder=4,
                    **outlined(),
                )

    def _limit(self, panels: np.ndarray, condition: Any, kind: str) -> None:
        """One range for a condition, which holds what is not far worse than usual."""
        sign = -1.0 if kind in LOWER_IS_BETTER else 1.0
        held = [WITHOUT[kind]] if kind in WITHOUT else []
        for (of, _, _), line in self.lines_.items():
            value = sign * np.asarray(line.get_ydata(), dtype=float)
            value = value[np.isfinite(value)]
            if of == condition and value.size:
                held += (sign * near_best(value)).tolist()
        if not held:
            return
        low, high = min(held), max(held)
        margin = MARGIN * max(high - low, 1e-6 * abs(high))
        if margin > 0:
            for panel in panels:
                panel.set_ylim(low - margin, high + margin)

    def _label(self, panels: np.ndarray, shape: tuple[int, int], n_forms: int, kind: str) -> None:
        last = len(panels) - shape[1]
        for number, panel in enumerate(panels):
            if self._own and number < last:
                panel.set_xlabel("")
                panel.tick_params(labelbottom=False)
            if number % (shape[1] if self._own else n_forms) == 0:
                panel.set_ylabel(LABELS[kind])
        if self._own:
            self.figure_.align_ylabels(panels)

    def _explain(self, intensities: list[Any]) -> None:
        handles = [
            Line2D([], [], color=series_colour(i), marker=MARKERS[i % len(MARKERS)], ms=sized(4))
            for i in range(len(intensities))
        ]
        labels = [cell_text("remnant_intensity", P_n) for P_n in intensities]
        handles.append(
            Line2D([], [], color=background(), marker="*", ms=sized(11), ls="none", **outlined())
        )
        labels.append("best $N_0$ of the line")
        known = {form: N0 for form, N0 in self.best_overall_.items() if N0 is not None}
        if known:
            handles.append(Line2D([], [], color=foreground(), ls="--", lw=scaled(1.0)))
            values = {form: "∞" if np.isinf(N0) else f"{N0:g}" for form, N0 in known.items()}
            each = ", ".join(f"{v} ({cell_text('form', form)})" for form, v in values.items())
            labels.append(f"best of all cells: $N_0$ = {each}")
        wide = self.figure_.get_figwidth() > 8
        self._legend(handles, labels, columns=-(-len(labels) // 2) if wide else None)
