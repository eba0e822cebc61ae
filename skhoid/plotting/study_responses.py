"""A study's frequency responses: what methods find at the lines, and how sure they say they are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd
from matplotlib.lines import Line2D

from ._axes import MARKERS, corner_note, phase_ticks, plain_logarithmic
from ._display import Display
from ._layout import page_width
from ._roles import PALETTE, ROLES, scaled, series_colour, sized
from ._study import (
    REPLICATION,
    cell_text,
    check_table,
    chosen_panels,
    ordered,
    refuse_mixtures,
)
from ._study_tables import RESPONSE_KEYS, ensembles

NAME = "StudyResponseDisplay"
COMPLEX = ["H_real", "H_imag"]
STATED = ["magnitude_sd", "phase_sd"]
METHODS = ("fc", "batch", "recursive")
PARTS = ("magnitude", "phase")
SDS = {
    "magnitude": {
        "spread": "magnitude_sd",
        "total": "total_sd",
        "stated": "stated_magnitude_sd",
    },
    "phase": {"spread": "phase_sd", "total": "total_phase_sd", "stated": "stated_phase_sd"},
}
N_POINTS = 300
LEAST = 0.3  # of the smallest mean, below which magnitudes are cut
SPAN = 100.0  # from the lowest standard deviation on an axis to the median
CROWDED = 200.0  # from one end of an axis to the other, from where only powers of ten have names
ROOM = 0.8  # of the smallest distance of lines, for all that belongs to one
STEP = 0.16  # of the smallest distance of lines, between what stands beside each other
Truth = Callable[[np.ndarray], Any]


@dataclass(kw_only=True, eq=False, repr=False)
class StudyResponseDisplay(Display):
    """Bode plots of a study: estimates of each method, with found and stated spread (Appendix I).

    A column of panels for each method, of one condition. Markers in the upper two, magnitude and
    phase, are means of the complex estimates over the replications (Eqs. H.1-H.4). Of the bars
    around them, the thick are standard deviations of magnitude and phase over the replications, the
    thin the total standard deviation in the complex plane that the thesis draws (Eqs. H.5-H.8),
    which is larger: it holds errors along the circle too. The pale bars beside them, without a
    marker, are what a single estimate states (Eqs. H.9-H.10; root mean square over the
    replications), to be compared with the thick ones.

    The lower two panels show the same standard deviations on axes of their own, since those of ARX
    models are too small for bars: of the magnitude, as a share of the mean, and of the phase.
    These axes leave out what is below a hundredth of the median, as deviations without remnant are.

    Make it with :meth:`from_table`.

    Parameters
    ----------
    responses : DataFrame
        One row per remnant intensity, method and line: ``remnant_intensity``, ``method``, ``omega``
        (rad/s), number of replications ``n``; of the mean ``magnitude`` and ``phase`` (deg);
        ``magnitude_sd`` and ``phase_sd`` (deg) over the replications, ``total_sd`` (Eq. H.7) and
        ``total_phase_sd`` (deg, Eq. H.8); and ``stated_magnitude_sd`` and ``stated_phase_sd``
        (deg). NaN stands for what is not known.
    truth : DataFrame or None, default=None
        ``omega`` (rad/s), ``magnitude`` and ``phase`` (deg) of the true response.
    title : str or None, default=None
        Of the figure.

    Attributes
    ----------
    axes_ : ndarray of Axes, shape (4, n_methods)
        Magnitudes, phases, and the standard deviations of both.
    ax_ : Axes
        The first of them.
    figure_ : Figure
        The figure that holds them.
    methods_ : list of str
        The method in each column.
    magnitude_, phase_ : dict of Line2D
        Means by (method, remnant intensity).
    spread_, total_, stated_ : dict of tuple of LineCollection
        Bars of magnitude and phase by the same: over the replications, total, and stated.
    sd_lines_ : dict of tuple of Line2D
        Standard deviations of magnitude (%) and phase (deg) by (kind, method, remnant intensity),
        where the kind is ``"spread"``, ``"total"`` or ``"stated"``.
    truth_ : list of Line2D
        The true response in each panel of the upper two rows.
    note_ : dict of Text
        Counts of bars of magnitude that are cut, by method.

    See Also
    --------
    BodeDisplay : Single responses and their intervals.

    Examples
    --------
    >>> import numpy as np
    >>> import pandas as pd
    >>> from skhoid import HumanOperator
    >>> from skhoid.plotting.study_responses import StudyResponseDisplay
    >>> omega = np.array([0.5, 1.0, 2.0, 5.0])
    >>> true = HumanOperator().frequency_response
    >>> rng = np.random.default_rng(0)
    >>> runs = []
    >>> for i in range(10):
    ...     H = true(omega) * (1 + 0.1 * rng.normal(size=4) + 0.1j * rng.normal(size=4))
    ...     run = {"condition": "C1", "remnant_intensity": 0.15, "replication": i, "method": "fc"}
    ...     runs.append(pd.DataFrame({**run, "omega": omega, "H_real": H.real, "H_imag": H.imag}))
    >>> table = pd.concat(runs).assign(magnitude_sd=np.nan, phase_sd=np.nan)
    >>> display = StudyResponseDisplay.from_table(table, truth=true)
    >>> display.methods_
    ['fc']
    """

    responses: pd.DataFrame
    truth: pd.DataFrame | None = None
    title: str | None = None

    @classmethod
    def from_table(
        cls,
        table: pd.DataFrame,
        *,
        condition: str | None = None,
        remnant_intensity: float | Sequence[float] | None = None,
        truth: Truth | pd.DataFrame | None = None,
        ax: Any = None,
        **styles: Any,
    ) -> Self:
        """Draw the table of a study of frequency responses.

        Parameters
        ----------
        table : DataFrame
            One row per cell, replication, method and line: ``condition``, ``remnant_intensity``,
            ``replication``, ``method``, ``omega`` (rad/s), ``H_real``, ``H_imag``, and what the
            estimate states of itself, ``magnitude_sd`` and ``phase_sd`` (rad), NaN where it does
            not.
        condition : str or None, default=None
            The condition to draw; None for the only one.
        remnant_intensity : float, list of float or None, default=None
            What to draw, one colour each; None for all.
        truth : callable, DataFrame or None, default=None
            The true response: a function of frequencies in rad/s, as ``frequency_response`` of a
            :class:`skhoid.HumanOperator` is, or a table of ``omega``, ``H_real`` and ``H_imag``.
            It also shows which turn a phase belongs to; without, phases go on from line to line,
            which a long delay between lines far apart makes slip.
        ax : array of Axes or None, default=None
            Where to draw, four rows of one for each method. None makes a figure.
        **styles : dict
            Keywords of :meth:`plot` whose names end in ``_kw``.

        Returns
        -------
        display : StudyResponseDisplay

        Raises
        ------
        TypeError
            If ``table`` is no DataFrame, or ``truth`` neither that nor a function.
        ValueError
            If a column is missing, cells would be mixed, or a choice is not in the table.
        """
        check_table(table, ["condition", *RESPONSE_KEYS, REPLICATION, *COMPLEX, *STATED], NAME)
        table = chosen_panels(table, condition, remnant_intensity, NAME)
        refuse_mixtures(table, RESPONSE_KEYS, NAME)
        omega = np.unique(table["omega"].to_numpy(dtype=float))
        if not (omega > 0).all():
            raise ValueError(f"{NAME}: omega is in rad/s and positive; got {omega.min():g}.")
        true = None if truth is None else _truth(truth, omega)
        display = cls(
            responses=ensembles(table, true),
            truth=true,
            title=str(table["condition"].iloc[0]),
        )
        return display.plot(ax, **styles)

    def plot(
        self,
        ax: Any = None,
        *,
        line_kw: dict[str, Any] | None = None,
        truth_kw: dict[str, Any] | None = None,
    ) -> Self:
        """Draw.

        Parameters
        ----------
        ax : array of Axes or None, default=None
            Where to draw, four rows of one for each method. None makes a figure.
        line_kw : dict or None, default=None
            Keywords of matplotlib for the curves and marks of the estimates.
        truth_kw : dict or None, default=None
            Keywords of matplotlib for the truth.

        Returns
        -------
        self : StudyResponseDisplay
        """
        styles = {"line": line_kw, "truth": truth_kw}
        methods = ordered(self.responses["method"])
        self.methods_ = [m for m in METHODS if m in methods]
        self.methods_ += [m for m in methods if m not in METHODS]
        columns = len(self.methods_)
        panels = self._take_axes(
            ax,
            "magnitude, phase, and their standard deviations, of each method",
            (4, columns),
            figsize=(page_width(max(6.4, 1.4 + 3.2 * columns), columns), 9.6),
            sharex=True,
        )
        self.axes_ = panels.reshape(4, columns)
        self.ax_ = panels[0]
        self.magnitude_: dict[tuple[str, float], Any] = {}
        self.phase_: dict[tuple[str, float], Any] = {}
        self.spread_: dict[tuple[str, float], tuple[Any, Any]] = {}
        self.total_: dict[tuple[str, float], tuple[Any, Any]] = {}
        self.stated_: dict[tuple[str, float], tuple[Any, Any]] = {}
        self.sd_lines_: dict[tuple[str, str, float], tuple[Any, Any]] = {}
        self.truth_: list[Any] = []
        self.note_: dict[str, Any] = {}
        self._intensities = ordered(self.responses["remnant_intensity"])
        lines = np.log(np.unique(self.responses["omega"]))
        # Beside each other: each intensity, and its stated spread.
        wide = min(STEP, ROOM / (2 * len(self._intensities)))
        wide *= np.diff(lines).min() if lines.size > 1 else 0.5
        for method, four in zip(self.methods_, self.axes_.T, strict=True):
            for panel in four:
                panel.set_xscale("log")
                panel.grid(alpha=0.3)
            for panel in (four[0], *four[2:]):
                panel.set_yscale("log")
            if self.truth is not None:
                for panel, name in zip(four[:2], PARTS, strict=True):
                    style = {**ROLES["truth"].style(1.4), "label": "truth", "zorder": 1.8}
                    self.truth_ += panel.plot(self.truth["omega"], self.truth[name], **style)
            for position, P_n in enumerate(self._intensities):
                shift = wide * (2 * position - len(self._intensities) + 0.5)
                rows = _cell(self.responses, method, P_n)
                if not rows.empty:
                    self._draw(four[:2], rows, (method, P_n), position, shift, wide)
                    self._draw_deviations(four[2:], rows, (method, P_n), position)
            four[0].set_title(cell_text("method", method), fontsize="medium")
        self._limit()
        drawn = [self.magnitude_, self.phase_, self.sd_lines_]
        self._restyle(styles, line=drawn, truth=self.truth_)
        self._label()
        return self

    def _draw(
        self,
        pair: Any,
        rows: pd.DataFrame,
        key: tuple[str, float],
        position: int,
        shift: float,
        wide: float,
    ) -> None:
        """Means with bars."""
        colour = series_colour(position)
        omega = rows["omega"].to_numpy(dtype=float)
        at, beside = omega * np.exp(shift), omega * np.exp(shift + wide)
        means, spread, total, stated = [], [], [], []
        for panel, name in zip(pair, PARTS, strict=True):
            marker = MARKERS[position % len(MARKERS)]
            means += panel.plot(
                at, rows[name], color=colour, marker=marker, ms=sized(3.5), ls="none", zorder=3
            )
            thick: dict[str, Any] = {"color": colour, "lw": scaled(2.4), "zorder": 2.6}
            thin: dict[str, Any] = {"color": colour, "lw": scaled(1.0), "ls": ":", "zorder": 2.5}
            pale: dict[str, Any] = {"color": colour, "lw": scaled(4.5), "alpha": 0.4, "zorder": 2.4}
            spread.append(_bars(panel, at, rows, name, SDS[name]["spread"], thick))
            total.append(_bars(panel, at, rows, name, SDS[name]["total"], thin))
            stated.append(_bars(panel, beside, rows, name, SDS[name]["stated"], pale))
        self.magnitude_[key], self.phase_[key] = means
        self.spread_[key], self.total_[key] = (spread[0], spread[1]), (total[0], total[1])
        if rows["stated_magnitude_sd"].notna().any():
            self.stated_[key] = stated[0], stated[1]

    def _draw_deviations(
        self, pair: Any, rows: pd.DataFrame, key: tuple[str, float], position: int
    ) -> None:
        """Standard deviations over frequency."""
        colour, omega = series_colour(position), rows["omega"]
        marker = MARKERS[position % len(MARKERS)]
        styles: dict[str, dict[str, Any]] = {
            "spread": {"ls": "-", "marker": marker, "ms": sized(3.5), "lw": scaled(1.4)},
            "total": {"ls": ":", "lw": scaled(1.0)},
            "stated": {"ls": "-", "lw": scaled(4.5), "alpha": 0.4, "zorder": 1.9},
        }
        for kind, style in styles.items():
            drawn = []
            for panel, name in zip(pair, PARTS, strict=True):
                value = rows[SDS[name][kind]]
                if name == "magnitude":
                    value = 100 * value / rows["magnitude"]
                drawn += panel.plot(omega, value.where(value > 0), color=colour, **style)
            if kind != "stated" or key in self.stated_:
                self.sd_lines_[kind, *key] = drawn[0], drawn[1]

    def _limit(self) -> None:
        """The same limits for all methods; bars of magnitude that come near zero are cut."""
        table = self.responses
        size = table["magnitude"].to_numpy(dtype=float)
        sds = ["magnitude_sd", "total_sd", "stated_magnitude_sd"]
        widest = np.nan_to_num(table[sds].to_numpy(dtype=float)).max(axis=1)
        lows, tops, phases = size - widest, size + widest, []
        wide = [table[name].fillna(0.0) for name in ("total_phase_sd", "stated_phase_sd")]
        for sd in wide:
            phases += [table["phase"] - sd, table["phase"] + sd]
        if self.truth is not None:
            size = np.append(size, self.truth["magnitude"])
            tops = np.append(tops, self.truth["magnitude"])
            phases.append(self.truth["phase"])
        bottom = max(LEAST * np.nanmin(size), 0.8 * np.nanmin(lows))
        every = pd.concat(phases)
        for magnitude, phase in self.axes_[:2].T:
            magnitude.set_ylim(bottom, 1.3 * np.nanmax(tops))
            phase.set_ylim(every.min() - 15, every.max() + 15)
            phase_ticks(phase.yaxis)
        for panels in self.axes_[2:]:
            values = [np.asarray(a.get_ydata(), dtype=float) for p in panels for a in p.lines]
            known = np.concatenate(values)
            known = known[np.isfinite(known)]
            if known.size:
                lowest = known[known >= np.median(known) / SPAN].min()
                for panel in panels:
                    panel.set_ylim(lowest / 1.4, known.max() * 1.4)
        for panel in self.axes_[[0, 2, 3]].flat:
            plain_logarithmic(panel.yaxis, CROWDED, minor_ticks=False)
        for panel in self.axes_.flat:
            plain_logarithmic(panel.xaxis, CROWDED, minor_ticks=False)
        for column, method in enumerate(self.methods_):
            cut = int(np.sum(lows[(table["method"] == method).to_numpy()] < bottom))
            if cut:
                text = f"{cut} bar{'s' * (cut > 1)} cut"
                corner = ("bottom", "right")
                self.note_[method] = corner_note(self.axes_[0, column], text, corner, 0.03)

    def _label(self) -> None:
        self.axes_[0, 0].set_ylabel("magnitude")
        self.axes_[1, 0].set_ylabel("phase, deg")
        self.axes_[2, 0].set_ylabel("sd of magnitude, %")
        self.axes_[3, 0].set_ylabel("sd of phase, deg")
        for panel in self.axes_[-1]:
            panel.set_xlabel("frequency, rad/s")
        for panel in self.axes_[:, 1:].flat if self._own else []:
            panel.tick_params(labelleft=False, which="both")
        handles: list[Any] = [
            Line2D([], [], color=series_colour(i), marker=MARKERS[i % len(MARKERS)], ls="")
            for i in range(len(self._intensities))
        ]
        labels = [f"{cell_text('remnant_intensity', P)}: mean" for P in self._intensities]
        colour = PALETTE[0]
        if self.responses["magnitude_sd"].notna().any():
            handles.append(Line2D([], [], color=colour, lw=scaled(2.4)))
            handles.append(Line2D([], [], color=colour, lw=scaled(1.0), ls=":"))
            labels += ["± 1 sd over replications", "± 1 total sd, Eqs. H.7-H.8"]
        if self.stated_:
            handles.append(Line2D([], [], color=colour, lw=scaled(4.5), alpha=0.4))
            labels.append("± 1 sd stated, Eqs. H.9-H.10")
        if self.truth_:
            handles.append(self.truth_[0])
            labels.append("truth")
        if self._own:
            if self.title:
                self.figure_.suptitle(self.title, fontsize="medium")
            self.figure_.align_ylabels(self.axes_[:, 0])
        self._legend(handles, labels)


def _cell(table: pd.DataFrame, method: str, P_n: float) -> pd.DataFrame:
    rows = table[(table["method"] == method) & (table["remnant_intensity"] == P_n)]
    return rows.sort_values("omega")


def _bars(
    panel: Any, at: np.ndarray, rows: pd.DataFrame, name: str, sd: str, style: dict[str, Any]
) -> Any:
    """Bars to either side of the means; on a logarithmic axis they end above zero."""
    middle, half = rows[name].to_numpy(dtype=float), rows[sd].to_numpy(dtype=float)
    low = middle - half
    if name == "magnitude":
        low = np.where(low > 0, low, 1e-9 * middle)
    known = np.isfinite(half)
    return panel.vlines(at[known], low[known], (middle + half)[known], **style)


def _truth(truth: Any, omega: np.ndarray) -> pd.DataFrame:
    """Magnitude and phase of the true response."""
    if isinstance(truth, pd.DataFrame):
        check_table(truth, ["omega", *COMPLEX], f"{NAME}: truth")
        truth = truth.sort_values("omega")
        lines = truth["omega"].to_numpy(dtype=float)
        H = truth["H_real"].to_numpy(dtype=float) + 1j * truth["H_imag"].to_numpy(dtype=float)
    elif callable(truth):
        lines = np.geomspace(omega[0] / 1.2, omega[-1] * 1.2, N_POINTS)
        H = np.asarray(truth(lines), dtype=complex)
    else:
        raise TypeError(
            f"truth is a function of omega or a table of it; got {type(truth).__name__}."
        )
    phase = np.degrees(np.unwrap(np.angle(H)))
    return pd.DataFrame({"omega": lines, "magnitude": np.abs(H), "phase": phase})
