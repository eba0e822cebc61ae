"""Memory of recursive models: what a horizon costs and gains, and the weights of the past."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import FixedLocator, LogLocator, NullLocator, StrMethodFormatter

from ._axes import (
    MARKERS,
    draw_band,
    letters_across,
    note_outside,
    parameter_symbol,
    seconds_axis,
)
from ._display import Display, check_option, figure_size, fitted_end, page_width
from ._roles import (
    GREY,
    background,
    dimmed,
    foreground,
    scaled,
    series_colour,
    sized,
    star,
    veil,
)
from ._study import REPLICATION, cell_text, check_table, ordered, refuse_mixtures

NAME = "MemoryHorizonDisplay"
LABELS = {
    "gain": "gain in VAF over\nno forgetting, points",
    "score": "cross-validated VAF, %",
    "vaf_validation": "VAF of validation, %",
    "vaf_estimation": "VAF of estimation, %",
    "overfit_difference": "VAF of estimation −\nvalidation, points",
    "overfit_ratio": "VAF of estimation /\nvalidation",
    "tradeoff_ratio": "VAF of validation /\nthat of no forgetting",
}
LOWER_IS_BETTER = ("overfit_difference", "overfit_ratio")
WITHOUT = {"gain": 0.0, "tradeoff_ratio": 1.0}  # values of no forgetting
KEYS = ["condition", "form", "remnant_intensity", "memory_horizon"]
VAF = ["vaf_estimation", "vaf_validation"]
FEW = 3  # conditions, up to which each has a row
MARGIN = 0.08  # of the range, above and below
MOST_TICKS, LETTERS = 14, 5  # names of horizons, and letters that one takes
AFAR = 1.5  # octaves from the longest horizon to the infinite one
REACH = 3.0  # times the distance of best and median, within which limits hold the values
# The weights of the past
STYLES = ("-", "--", "-.", ":")
LONGEST = 1e6  # samples; a longer horizon is as good as infinite
DECADES = np.array([10.0, 1000.0])  # samples, shown where all horizons are infinite
MOSTLY = 90  # percent of the horizons of a factor that varies are inside the panel
SIZE = (6.4, 3.4)  # inches
NARROW = 66  # letters across a figure, below which the panels are below each other
HEIGHT = 6.0  # inches of a narrow figure, of a font of 10 points
SHOWN = 4  # memory horizons of the past, by default


@dataclass(kw_only=True, eq=False, repr=False)
class MemoryHorizonDisplay(Display):
    """Tracking ability against noise sensitivity: VAF over memory horizon (Figs. 13, J.1-J.5).

    Values over the memory horizon N0 in samples on a logarithmic axis, with the infinite one (no
    forgetting) at its end. An asterisk marks the setting of each line with the best VAF of
    validation.

    Of a :class:`skhoid.RecursiveARXCV`, a point for each setting, with one standard deviation over
    splits to either side. Settings with one horizon per parameter stand at the shortest and are
    joined with those of the same ratios. Of a study, a panel for each condition and form of
    forgetting and a line for each remnant intensity, of means over the replications; a dashed line
    is at the horizon with the best mean of all cells of the form.

    Panels of one condition have the same limits. These leave out values that are far worse than the
    median of their line, as those of a few samples' memory are; a note counts them.

    Make it with :meth:`from_estimator` or :meth:`from_table`.

    Parameters
    ----------
    results : DataFrame
        One row per setting: ``panel`` and ``line`` (what they are called), ``memory_horizon`` in
        samples (the shortest of the parameters), ``best``, whether it is so in its line, and a
        column for each kind of value, with standard deviations (``sd_gain``) where known.
    kind : str, default="gain"
        The column that is drawn, see the class methods.
    n_splits : int, default=1
        Number of splits; with one there are no deviations.
    n_runs : str, default=""
        Number of runs that each model pools, as text.
    dt : float or None, default=None
        Sampling time of the fitted grid in s, for an axis in seconds.
    best_overall : dict {form: float} or None, default=None
        The horizon with the best mean VAF of validation over all cells of a form of forgetting;
        ``results`` has a column ``form`` then.
    beside : int, default=1
        Panels of one condition, which stand beside each other.

    Attributes
    ----------
    %(panels)
    seconds_ax_ : SecondaryAxis or None
        An upper axis in seconds; None where the sampling time is not one for all.
    lines_, bands_, best_ : dict of Artist
        Values, the main artists, standard deviations and marks of the best, by (panel, line).
    infinite_ : float
        Where an infinite horizon stands on the axis.
    notes_ : dict of Text
        Count of values outside, by panel.

    References
    ----------
    Van Grootheest, thesis, Eqs. 31-32 and J.1-J.6, Fig. 13 and Appendix J.

    Examples
    --------
    >>> from skhoid import RecursiveARXCV, make_tracking_runs
    >>> from skhoid.plotting import MemoryHorizonDisplay
    >>> X, y = make_tracking_runs("C4", n_runs=3, remnant_intensity=0.15, random_state=0)
    >>> search = RecursiveARXCV([64, 128, 256, 512, float("inf")], nk=29).fit(X, y)
    >>> display = MemoryHorizonDisplay.from_estimator(search)
    >>> display.ax_.get_ylabel()
    'gain in VAF over\\nno forgetting, points'
    """

    results: pd.DataFrame
    kind: str = "gain"
    n_splits: int = 1
    n_runs: str = ""
    dt: float | None = None
    best_overall: Mapping[str, float | None] | None = None
    beside: int = 1

    @classmethod
    def from_estimator(
        cls, search: Any, *, kind: str = "gain", ax: Any = None, **kwargs: Any
    ) -> Self:
        """Draw fitted searches.

        Parameters
        ----------
        search : RecursiveARXCV, pipeline that ends in one, or dict of them by label
            Fitted.
        kind : {"gain", "score", "overfit_difference", "overfit_ratio"}, default="gain"
            Gain of the cross-validated VAF over that without forgetting (Eqs. 31-32); that VAF
            itself (Fig. J.2); VAF of training less validation (Eqs. J.1-J.2), or their ratio
            (Eqs. J.3-J.4).
        %(keywords)

        %(display)
        """
        given = search if isinstance(search, Mapping) else {"": search}
        searches = {str(label): _fitted_search(s) for label, s in given.items()}
        steps = {float(s.dt_) for s in searches.values()}
        pooled = np.concatenate([np.atleast_1d(s.n_runs_pooled_) for s in searches.values()])
        few, many = int(pooled.min()), int(pooled.max())
        n_splits = min(_n_splits(s.cv_results_) for s in searches.values())
        tables = [part for label, s in searches.items() for part in _lines(label, _table(s))]
        results = pd.concat(tables).assign(panel="")
        return cls(
            results=results.assign(
                line=results["line"].replace("", f"mean over {n_splits} splits")
            ),
            kind=kind,
            n_splits=n_splits,
            n_runs=str(few) if few == many else f"{few} to {many}",
            dt=steps.pop() if len(steps) == 1 else None,
        ).plot(ax, **kwargs)

    @classmethod
    def from_table(
        cls, table: pd.DataFrame, *, kind: str = "gain", ax: Any = None, **kwargs: Any
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
            ``"tradeoff_ratio"`` (Eqs. J.5-J.6). Ratios are those of means.
        %(keywords)

        %(display)
        """
        check_table(table, [*KEYS, *VAF, REPLICATION], NAME)
        refuse_mixtures(table, KEYS, NAME)
        means = _means_of_study(table)
        means["best"] = means["vaf_validation"].notna() & (
            means.groupby(KEYS[:3])["vaf_validation"].transform("max") == means["vaf_validation"]
        )
        overall = {form: _best_horizon(means, form) for form in ordered(means["form"])}
        panels = {
            f"{condition}, {cell_text('form', form)}": (condition, form)
            for condition in ordered(means["condition"])
            for form in overall
        }
        parts = [
            means[(means["condition"] == condition) & (means["form"] == form)].assign(panel=panel)
            for panel, (condition, form) in panels.items()
        ]
        results = pd.concat(parts).sort_values("remnant_intensity", kind="stable")
        lines = [cell_text("remnant_intensity", P_n) for P_n in results["remnant_intensity"]]
        results["panel"] = pd.Categorical(results["panel"], panels)
        return cls(
            results=results.assign(line=lines),
            kind=kind,
            best_overall=overall,
            beside=len(overall),
        ).plot(ax, **kwargs)

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        """Draw.

        Parameters
        ----------
        %(keywords)

        %(self)
        """
        check_option("kind", self.kind, [kind for kind in LABELS if kind in self.results])
        if not np.isfinite(self.results[self.kind]).any():
            raise ValueError(
                f"There is no value of {self.kind!r} to draw. A gain is one over no forgetting: "
                "put float('inf') among the memory horizons. A ratio needs a VAF above 0."
            )
        panels = self._begin(ax)
        lines = list(dict.fromkeys(self.results["line"]))
        for name, panel in panels.items():
            self.infinite_ = _horizon_axis(panel, self.results["memory_horizon"].to_numpy(float))
            if name:
                panel.set_title(name, fontsize="medium")
            rows = self.results[self.results["panel"] == name]
            forms = rows["form"] if self.best_overall else rows[:0]
            overall = self.best_overall[forms.iloc[0]] if self.best_overall and len(forms) else None
            if overall is not None:
                at = self.infinite_ if np.isinf(overall) else overall
                panel.axvline(at, color=foreground(), ls="--", lw=scaled(1.0), zorder=1.5)
            for position, line in enumerate(lines):
                self._draw(panel, (name, line), rows[rows["line"] == line], position)
            panel.grid(alpha=0.3)
        self._add_seconds()
        self._label(panels)
        names = list(panels)
        for first in range(0, len(names), self.beside):
            self._limit(panels, names[first : first + self.beside])
        self._restyle(kwargs, self.lines_)
        self._explain()
        return self

    def _begin(self, ax: Any) -> dict[str, Axes]:
        """Panels by name, with nothing in them yet."""
        column = self.results["panel"]
        names = [*column.cat.categories] if hasattr(column, "cat") else [*dict.fromkeys(column)]
        n_conditions = len(names) // self.beside
        across = 2 if n_conditions > FEW else 1  # conditions in a row
        self._shape = -(-n_conditions // across), across * self.beside
        size = 6.4, 4.2
        if len(names) > 1:
            width = page_width(max(6.4, 2.0 + 2.4 * self._shape[1]), self._shape[1])
            size = width, 1.4 + 2.2 * self._shape[0]
        shows, used = "one for each condition and form", range(len(names))
        panels = self._take_axes(ax, shows, self._shape, used=used, figsize=size)
        self.lines_: dict[tuple[str, str], Any] = {}
        self.bands_: dict[tuple[str, str], Any] = {}
        self.best_: dict[tuple[str, str], Any] = {}
        self.notes_: dict[str, Any] = {}
        return dict(zip(names, panels, strict=True))

    def _draw(self, panel: Axes, key: tuple[str, str], rows: pd.DataFrame, position: int) -> None:
        if self.kind in WITHOUT:
            panel.axhline(WITHOUT[self.kind], color=GREY, lw=scaled(0.8), zorder=1)
        if rows.empty:
            return
        rows = rows.sort_values("memory_horizon", kind="stable")
        colour = series_colour(position)
        places = rows["memory_horizon"].replace(np.inf, self.infinite_).to_numpy(dtype=float)
        value = rows[self.kind].to_numpy(dtype=float)
        mark: dict[str, Any] = {"marker": MARKERS[position % len(MARKERS)], "ms": sized(3.5)}
        (self.lines_[key],) = panel.plot(
            places, value, color=colour, lw=scaled(1.2), label=key[1], zorder=2.5, **mark
        )
        deviation = self._deviation(rows)
        if deviation.any():
            edges = value - deviation, value + deviation
            self.bands_[key] = draw_band(panel, places, *edges, colour, alpha=veil(0.15))
        best = rows["best"].to_numpy(dtype=bool)
        if best.any():
            first = int(np.argmax(best))
            (self.best_[key],) = panel.plot(
                places[first],
                value[first],
                color=colour,
                **star(15 if len(self.axes_) == 1 else 11),
            )

    def _deviation(self, rows: pd.DataFrame) -> np.ndarray:
        """Standard deviations over splits; zero where there are none."""
        if self.n_splits < 2 or f"sd_{self.kind}" not in rows:
            return np.zeros(len(rows))
        return np.nan_to_num(rows[f"sd_{self.kind}"].to_numpy(dtype=float))

    def _limit(self, panels: dict[str, Axes], names: list[str]) -> None:
        """One range for panels beside each other, which holds what is not far worse than usual."""
        sign = -1.0 if self.kind in LOWER_IS_BETTER else 1.0
        held = [WITHOUT[self.kind]] if self.kind in WITHOUT else []
        here = self.results[self.results["panel"].isin(names)]
        for _, rows in here.groupby(["panel", "line"], sort=False, observed=True):
            value, deviation = sign * rows[self.kind].to_numpy(dtype=float), self._deviation(rows)
            known = np.isfinite(value)
            value, deviation = value[known], deviation[known]
            if value.size:
                best, median = value.max(), np.median(value)
                held += (sign * value[value >= best - REACH * (best - median)]).tolist()
                better = value >= median
                for edge in (value + deviation, value - deviation) if deviation.any() else ():
                    held += (sign * edge[better]).tolist()
        margin = MARGIN * max(max(held) - min(held), 1e-6 * abs(max(held))) if held else 0.0
        for name in names if margin > 0 else []:
            panels[name].set_ylim(min(held) - margin, max(held) + margin)
            # Worse values leave at the bottom, or at the top; the note stands there.
            corner = ("top" if sign < 0 else "bottom", "left")
            shown = here.loc[here["panel"] == name, self.kind].to_numpy(dtype=float)
            if note := note_outside(panels[name], shown[np.isfinite(shown)], corner):
                self.notes_[name] = note

    def _add_seconds(self) -> None:
        """An upper axis in seconds, where one sampling time is that of all."""
        self.seconds_ax_: Any = None
        horizons = self.results["memory_horizon"].to_numpy(dtype=float)
        finite = horizons[np.isfinite(horizons)]
        if self.dt is not None and finite.size:
            self.seconds_ax_ = seconds_axis(self.ax_, self.dt, "memory horizon $T_0$, s")
            first, last = finite.min() * self.dt, finite.max() * self.dt
            powers = LogLocator(subs=(1.0, 2.0, 5.0)).tick_values(first, last)
            inside = powers[(powers >= first) & (powers <= last)]
            self.seconds_ax_.xaxis.set_major_locator(FixedLocator(inside))
            self.seconds_ax_.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
            self.seconds_ax_.xaxis.set_minor_locator(NullLocator())

    def _label(self, panels: dict[str, Axes]) -> None:
        columns = self._shape[1]
        for number, panel in enumerate(panels.values()):
            if self._own and number < len(panels) - columns:
                panel.set_xlabel("")
                panel.tick_params(labelbottom=False)
            panel.tick_params(labelleft=not self._own or number % self.beside == 0)
            if number % (columns if self._own else self.beside) == 0:
                panel.set_ylabel(LABELS[self.kind])
        if self._own:
            self.figure_.align_ylabels(self.axes_)

    def _explain(self) -> None:
        found = {line.get_label(): line for line in self.lines_.values()}
        if self.bands_:
            over = f"± 1 standard deviation over {self.n_splits} splits"
            found[over] = Rectangle((0, 0), 1, 1, color=GREY, alpha=0.4, lw=0)
        found[self._best_text()] = Line2D([], [], color=background(), **star(12))
        known = {form: N0 for form, N0 in (self.best_overall or {}).items() if N0 is not None}
        if known:
            each = ", ".join(
                f"{_horizon_text(N0)} ({cell_text('form', form)})" for form, N0 in known.items()
            )
            dashes = Line2D([], [], color=foreground(), ls="--", lw=scaled(1.0))
            found[f"best of all cells: $N_0$ = {each}"] = dashes
        wide = self.figure_.get_figwidth() > 8
        self._legend([*found.values()], [*found], columns=-(-len(found) // 2) if wide else None)

    def _best_text(self) -> str:
        if len(self.axes_) > 1:
            return "best $N_0$ of the line"
        chosen = self.results[self.results["best"]]
        text = "best"
        if len(chosen) == 1:
            text += f": $N_0$ = {_horizon_text(float(chosen['memory_horizon'].iloc[0]))}"
        if self.n_runs:
            text += f" ({self.n_runs} run{'s' * (self.n_runs != '1')} per model)"
        return text


def _horizon_text(horizon: float) -> str:
    return "∞" if np.isinf(horizon) else f"{horizon:g}"


def _horizon_axis(panel: Axes, horizons: np.ndarray) -> float:
    """A logarithmic axis of samples with infinity at its end; return where that stands."""
    horizons = np.unique(horizons)
    finite = horizons[np.isfinite(horizons)]
    infinite = float(finite[-1] * 2**AFAR) if finite.size else 2.0
    panel.set_xscale("log", base=2)
    inches = panel.get_window_extent().width / panel.figure.dpi
    ticks = _apart(finite, infinite, min(MOST_TICKS, letters_across(inches) // LETTERS))
    names = [f"{tick:g}" for tick in ticks]
    if finite.size < horizons.size:
        ticks, names = [*ticks, infinite], [*names, "∞"]
        if finite.size:
            middle = finite[-1] * 2 ** (AFAR / 2)
            panel.axvline(middle, color=GREY, lw=scaled(0.8), ls=":", zorder=1)
    panel.set_xticks(ticks, names, fontsize="small")
    panel.xaxis.set_minor_locator(NullLocator())
    panel.set_xlim(min([*finite, infinite]) / 1.5, max([*ticks, *finite]) * 1.5)
    panel.set_xlabel("memory horizon $N_0$, samples")
    return infinite


def _apart(horizons: np.ndarray, last: float, most: int) -> list[float]:
    """Horizons that are far enough apart for a name each."""
    ticks: list[float] = []
    for horizon in horizons:
        gap = np.log2(last / horizons[0]) / max(most, 1)
        ends = np.log2(last / horizon) < 0.5 * gap  # too near to infinity's own name
        if not ticks or (np.log2(horizon / ticks[-1]) > 0.99 * gap and not ends):
            ticks.append(float(horizon))
    return ticks


def _fitted_search(estimator: Any) -> Any:
    """The fitted search at the end of a pipeline."""
    search = fitted_end(estimator)
    results = getattr(search, "cv_results_", {})
    if "memory_horizon" not in results or "gain" not in results:
        raise TypeError(
            "MemoryHorizonDisplay.from_estimator draws a fitted RecursiveARXCV, or a pipeline that "
            f"ends in one; got {type(search).__name__}."
        )
    return search


def _n_splits(results: Mapping[str, Any]) -> int:
    return sum(name.startswith("split") and name.endswith("_test_score") for name in results)


def _table(search: Any) -> pd.DataFrame:
    """Settings of a search, with deviations over splits."""
    results = search.cv_results_
    horizons = [np.atleast_1d(np.asarray(h, dtype=float)) for h in results["memory_horizon"]]
    splits = range(_n_splits(results))
    test = np.array([results[f"split{i}_test_score"] for i in splits], dtype=float)
    train = np.array([results[f"split{i}_train_score"] for i in splits], dtype=float)
    without = [i for i, h in enumerate(horizons) if np.isinf(h).all()]
    base = test[:, without[-1:]] if without else np.nan
    with np.errstate(divide="ignore", invalid="ignore"):
        # The ratio to a VAF of 0 or less says nothing.
        split_ratios = np.where(test > 0, train / test, np.nan)
    table = pd.DataFrame(
        {
            "memory_horizon": [h.min() for h in horizons],
            "ratios": [_ratios(h) for h in horizons],
            "best": np.arange(len(horizons)) == search.best_index_,
            "gain": np.asarray(results["gain"], dtype=float),
            "score": np.asarray(results["mean_test_score"], dtype=float),
            "overfit_difference": np.asarray(results["overfit_difference"], dtype=float),
            "overfit_ratio": np.asarray(results["overfit_ratio"], dtype=float),
            "sd_gain": np.std(test - base, axis=0),
            "sd_score": np.std(test, axis=0),
            "sd_overfit_difference": np.std(train - test, axis=0),
            "sd_overfit_ratio": np.std(split_ratios, axis=0),
        }
    )
    return table.sort_values("memory_horizon", kind="stable")


def _ratios(horizons: np.ndarray) -> str:
    """Horizons of parameters in units of the shortest."""
    shortest = horizons.min()
    if np.isinf(shortest) or (horizons == shortest).all():
        return ""
    parts = []
    for horizon in horizons:
        ratio = horizon / shortest
        parts.append("∞" if np.isinf(ratio) else "$N_0$" if ratio == 1 else f"{ratio:g} $N_0$")
    return f"({', '.join(parts)})"


def _lines(label: str, table: pd.DataFrame) -> list[pd.DataFrame]:
    """Settings of a search with the same ratios, each with no forgetting at its end, and a name."""
    infinite = np.isinf(table["memory_horizon"])
    kinds = list(dict.fromkeys(table["ratios"][~infinite])) or [""]
    several = len(kinds) > 1
    found = []
    for ratios in kinds:
        kind = (ratios or "one $N_0$") if several else ratios if not label else ""
        name = ", ".join(filter(None, (label, kind)))
        found.append(table[infinite | (table["ratios"] == ratios)].assign(line=name))
    return found


def _means_of_study(table: pd.DataFrame) -> pd.DataFrame:
    """Means over the replications, and what follows from them."""
    groups = table.groupby(KEYS, sort=False)
    means = groups[VAF].mean().assign(n=groups.size()).reset_index()
    cell = KEYS[:3]
    without = means.loc[np.isinf(means["memory_horizon"]), [*cell, "vaf_validation"]]
    base = means[cell].merge(without, on=cell, how="left")["vaf_validation"].to_numpy(dtype=float)
    estimation, validation = (means[name].to_numpy(dtype=float) for name in VAF)
    with np.errstate(divide="ignore", invalid="ignore"):
        # The ratio to a VAF of 0 says nothing.
        ratio = np.where(validation > 0, estimation / validation, np.nan)
        to_base = np.where(base > 0, validation / base, np.nan)
    return means.assign(
        gain=validation - base,
        overfit_difference=estimation - validation,
        overfit_ratio=ratio,
        tradeoff_ratio=to_base,
    )


def _best_horizon(means: pd.DataFrame, form: Any) -> float | None:
    """The horizon with the best mean over the cells of a form, of those that all cells have."""
    cells = means[means["form"] == form].pivot_table(
        index="memory_horizon", columns=["condition", "remnant_intensity"], values="vaf_validation"
    )
    complete = cells.dropna()
    return None if complete.empty else float(complete.mean(axis=1).idxmax())


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
    %(panels)
    lines_ : dict of Line2D
        Weights by label: the main artists.
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
        **kwargs: Any,
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
        %(keywords)

        %(display)
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
        ).plot(ax, **kwargs)

    @classmethod
    def from_estimator(
        cls,
        model: Any,
        *,
        time: float | None = None,
        n_samples: int | None = None,
        ax: Any = None,
        **kwargs: Any,
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
        %(keywords)

        %(display)

        Raises
        ------
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
        dt = steps.pop() if len(steps) == 1 else None
        return cls.from_factors(factors, n_samples, dt=dt, ax=ax, **kwargs)

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        """Draw.

        Parameters
        ----------
        %(keywords)

        %(self)
        """
        narrow = letters_across(figure_size(SIZE, 1)[0]) < NARROW
        self._take_axes(
            ax,
            "weights, and memory horizon",
            (2, 1) if narrow else (1, 2),
            figsize=SIZE,
            width_ratios=None if narrow else (1.3, 1),
            least_height=HEIGHT if narrow else 0.0,
        )
        self._draw_weights(self.axes_[0])
        self._draw_horizons(self.axes_[1])
        self._restyle(kwargs, self.lines_)
        self._legend_of_panels()
        return self

    def _style(self, position: int) -> dict[str, Any]:
        dashes = STYLES[position % len(STYLES)]
        return {"color": series_colour(position), "ls": dashes}

    def _draw_weights(self, panel: Any) -> None:
        self.lines_: dict[str, Any] = {}
        for position, (label, weights) in enumerate(self.weights.items()):
            look = self._style(position)
            (self.lines_[label],) = panel.plot(weights, lw=scaled(1.6), label=label, **look)
        panel.axhline(np.exp(-1), color=GREY, lw=scaled(0.8), ls=":", zorder=1)
        longest = max(weights.size for weights in self.weights.values())
        panel.text(longest, np.exp(-1), "1/e ", color=dimmed(), ha="right", va="bottom")
        panel.set_xlim(0, max(longest - 1, 1))
        panel.set_ylim(0, 1.05)
        panel.set_xlabel("age $t - k$, samples")
        panel.set_ylabel(r"weight $\beta(t, k)$")
        panel.grid(alpha=0.3)
        self.seconds_ax_ = None if self.dt is None else seconds_axis(panel, self.dt, "age, s")

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
