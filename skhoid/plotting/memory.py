"""Memory horizons: what a horizon costs and gains."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator

from ._axes import MARKERS, draw_band, legend_entries, note_outside
from ._display import Display, check_option, fitted_end, page_width
from ._roles import GREY, background, scaled, series_colour, sized, star, veil
from ._study import cell_text, check_table, ordered

LABELS = {
    "gain": "gain in VAF over\nno forgetting, points",
    "score": "cross-validated VAF, %",
    "vaf_validation": "VAF of validation, %",
    "vaf_estimation": "VAF of estimation, %",
    "overfit_difference": "VAF of estimation −\nvalidation, points",
    "overfit_ratio": "VAF of estimation /\nvalidation",
    "tradeoff_ratio": "VAF of validation /\nthat of no forgetting",
}
DEVIATIONS = {"score": "std_test_score", "gain": "std_gain"}
LOWER_IS_BETTER = ("overfit_difference", "overfit_ratio")
WITHOUT = {"gain": 0.0, "tradeoff_ratio": 1.0}  # values of no forgetting
CELL = ["condition", "form", "remnant_intensity"]
VAF = ["vaf_estimation", "vaf_validation"]
MARGIN = 0.08  # of the range, above and below
MOST_TICKS = 6  # names of horizons
AFAR = 1.5  # octaves from the longest horizon to the infinite one
REACH = 3.0  # times the distance of best and median, within which limits hold the values


@dataclass(kw_only=True, eq=False, repr=False)
class MemoryHorizonDisplay(Display):
    """Tracking ability against noise sensitivity: VAF over memory horizon (Figs. 13, J.1-J.5).

    Values over the memory horizon N0 in samples on a logarithmic axis, with the infinite one (no
    forgetting) at its end. An asterisk marks the setting of each line with the best VAF of
    validation. Limits leave out values that are far worse than the median of their line, as those
    of a few samples' memory are; a note counts them.

    Of a :class:`skhoid.RecursiveARXCV`, a point for each setting, with one standard deviation over
    splits to either side. Settings with one horizon per parameter stand at the shortest and are
    joined with those of the same ratios. Of a study, a panel for each condition and form of
    forgetting and a line for each remnant intensity.

    Make it with :meth:`from_estimator` or :meth:`from_summary`.

    Parameters
    ----------
    results : DataFrame
        One row per setting: ``panel`` and ``line`` (what they are called), ``memory_horizon`` in
        samples, ``best``, whether it is so in its line, a column for each kind of value, and its
        standard deviation, ``sd_gain``, where known.
    kind : str, default="gain"
        The column that is drawn, see the class methods.

    Attributes
    ----------
    %(panels)
    lines_ : dict of Line2D
        Values, the main artists, by (panel, line).

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
        """
        given = search if isinstance(search, Mapping) else {"": search}
        tables = [part for label, s in given.items() for part in _lines(str(label), s)]
        return cls(results=pd.concat(tables).assign(panel=""), kind=kind).plot(ax, **kwargs)

    @classmethod
    def from_summary(
        cls, summary: pd.DataFrame, *, kind: str = "gain", ax: Any = None, **kwargs: Any
    ) -> Self:
        """Draw the summary of a study of forgetting.

        Parameters
        ----------
        summary : DataFrame
            Means by ``condition`` (if there are several), ``remnant_intensity``, ``form`` of
            forgetting and ``memory_horizon`` (samples, infinite without forgetting), as index or
            columns: ``vaf_estimation`` and ``vaf_validation`` (%), and ``gain``.
        kind : str, default="gain"
            ``"gain"`` of the VAF of validation over no forgetting (Eqs. 31-32, Fig. 13); the VAF
            itself, ``"vaf_validation"`` (Fig. J.2) or ``"vaf_estimation"`` (Fig. J.1); VAF of
            estimation less validation, ``"overfit_difference"`` (Eqs. J.1-J.2), or over it,
            ``"overfit_ratio"`` (Eqs. J.3-J.4); and VAF of validation over that of no forgetting,
            ``"tradeoff_ratio"`` (Eqs. J.5-J.6). Ratios are those of means.
        """
        means = summary.reset_index()
        means = means.assign(condition=means.get("condition", ""))
        check_table(means, [*CELL, "memory_horizon", *VAF, "gain"], cls.__name__)
        estimation, validation = (means[name].where(means[name] > 0) for name in VAF)
        means = means.assign(
            overfit_difference=means["vaf_estimation"] - means["vaf_validation"],
            overfit_ratio=estimation / validation,
            tradeoff_ratio=validation / (means["vaf_validation"] - means["gain"]),
            best=means.groupby(CELL)["vaf_validation"].transform("max") == means["vaf_validation"],
            panel=[
                ", ".join(filter(None, (condition, cell_text("form", form))))
                for condition, form in zip(means["condition"], means["form"], strict=True)
            ],
            line=[cell_text("remnant_intensity", P_n) for P_n in means["remnant_intensity"]],
        )
        # Forms side by side, and conditions below each other in their order.
        ranks = {name: ordered(means[name]) for name in CELL}
        means = means.sort_values(
            list(CELL), key=lambda column: column.map(ranks[column.name].index), kind="stable"
        )
        return cls(results=means, kind=kind).plot(ax, **kwargs)

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        check_option("kind", self.kind, [kind for kind in LABELS if kind in self.results])
        if not np.isfinite(self.results[self.kind]).any():
            raise ValueError(
                f"There is no value of {self.kind!r} to draw. A gain is one over no forgetting: "
                "put float('inf') among the memory horizons. A ratio needs a VAF above 0."
            )
        names = list(dict.fromkeys(self.results["panel"]))
        columns = min(len(names), 2 if len(names) <= 6 else 4)
        shape = -(-len(names) // columns), columns
        size = 6.4, 4.2
        if len(names) > 1:
            size = page_width(max(6.4, 2.0 + 2.4 * columns), columns), 1.4 + 2.2 * shape[0]
        shows, used = "one for each condition and form", range(len(names))
        self._take_axes(ax, shows, shape, used=used, figsize=size)
        self.lines_: dict[tuple[str, str], Any] = {}
        for number, (name, panel) in enumerate(zip(names, self.axes_, strict=True)):
            infinite = _horizon_axis(
                panel, self.results["memory_horizon"].to_numpy(float), MOST_TICKS // min(columns, 2)
            )
            panel.set_title(name, fontsize="medium")
            rows = self.results[self.results["panel"] == name]
            for position, line in enumerate(dict.fromkeys(self.results["line"])):
                of_line = rows[rows["line"] == line].sort_values("memory_horizon", kind="stable")
                if len(of_line):
                    self._draw(panel, (name, line), of_line, position, infinite)
            if self.kind in WITHOUT:
                panel.axhline(WITHOUT[self.kind], color=GREY, lw=scaled(0.8), zorder=1)
            panel.grid(alpha=0.3)
            if self._own and number < len(names) - columns:
                panel.set_xlabel("")
            if not self._own or number % columns == 0:
                panel.set_ylabel(LABELS[self.kind])
        self._limit(columns)
        self._restyle(kwargs, self.lines_)
        self._explain()
        return self

    def _draw(
        self,
        panel: Axes,
        key: tuple[str, str],
        rows: pd.DataFrame,
        position: int,
        infinite: float,
    ) -> None:
        look: dict[str, Any] = {"color": series_colour(position)}
        places = rows["memory_horizon"].replace(np.inf, infinite).to_numpy(dtype=float)
        value = rows[self.kind].to_numpy(dtype=float)
        mark: dict[str, Any] = {"marker": MARKERS[position % len(MARKERS)], "ms": sized(3.5)}
        (self.lines_[key],) = panel.plot(
            places, value, lw=scaled(1.2), label=key[1], zorder=2.5, **mark, **look
        )
        if f"sd_{self.kind}" in rows and rows[f"sd_{self.kind}"].any():
            deviation = rows[f"sd_{self.kind}"].to_numpy(dtype=float)
            edges, label = (value - deviation, value + deviation), "± 1 standard deviation"
            draw_band(panel, places, *edges, look["color"], label, alpha=veil(0.15))
        best = rows["best"].to_numpy(dtype=bool)
        panel.plot(places[best][:1], value[best][:1], **look, **star(15 if not key[0] else 11))

    def _limit(self, columns: int) -> None:
        """One range for panels beside each other, which holds what is not far worse than usual."""
        sign = -1.0 if self.kind in LOWER_IS_BETTER else 1.0
        table = self.results[np.isfinite(self.results[self.kind])]
        table = table.assign(sd=table.get(f"sd_{self.kind}", 0.0), value=sign * table[self.kind])
        names = list(dict.fromkeys(self.results["panel"]))
        for first in range(0, self.axes_.size, columns):
            row = table[table["panel"].isin(names[first : first + columns])]
            lines = row.groupby(["panel", "line"])["value"]
            best, median = lines.transform("max"), lines.transform("median")
            held = row.loc[row["value"] >= best - REACH * (best - median), self.kind].tolist()
            usual = row[row["value"] >= median]
            held += [*(usual[self.kind] - usual["sd"]), *(usual[self.kind] + usual["sd"])]
            held += [WITHOUT[self.kind]] if self.kind in WITHOUT else []
            margin = MARGIN * (max(held) - min(held)) if held else 0.0
            for name, panel in zip(
                names[first:], self.axes_[first : first + columns], strict=False
            ):
                if margin > 0:
                    panel.set_ylim(min(held) - margin, max(held) + margin)
                values = row.loc[row["panel"] == name, self.kind].to_numpy(dtype=float)
                note_outside(panel, values, ("top" if sign < 0 else "bottom", "left"))

    def _explain(self) -> None:
        found = legend_entries(self.axes_)
        best = self.results.loc[self.results["best"], "memory_horizon"].tolist()
        text = f": $N_0$ = {best[0]:g}".replace("inf", "∞") if len(best) == 1 else " of the line"
        found[f"best{text}"] = Line2D([], [], color=background(), **star(12))
        self._legend([*found.values()], [*found])


def _horizon_axis(panel: Axes, horizons: np.ndarray, most: int) -> float:
    """A logarithmic axis of samples with infinity at its end; return where that stands."""
    horizons = np.unique(horizons)
    finite = horizons[np.isfinite(horizons)]
    infinite = float(finite[-1] * 2**AFAR) if finite.size else 2.0
    panel.set_xscale("log", base=2)
    ticks = finite[:: -(-finite.size // most) or 1].tolist()
    if finite.size < horizons.size:
        ticks.append(infinite)
    panel.set_xticks(ticks, ["∞" if tick == infinite else f"{tick:g}" for tick in ticks])
    panel.tick_params(axis="x", labelsize="small")
    panel.xaxis.set_minor_locator(NullLocator())
    panel.set_xlim(min([*finite, infinite]) / 1.5, max([*ticks, *finite]) * 1.5)
    panel.set_xlabel("memory horizon $N_0$, samples")
    return infinite


def _lines(label: str, estimator: Any) -> list[pd.DataFrame]:
    """Settings of a search with the same ratios, each with no forgetting at its end, and a name."""
    search = fitted_end(estimator)
    results = getattr(search, "cv_results_", {})
    if "memory_horizon" not in results or "gain" not in results:
        raise TypeError(
            "MemoryHorizonDisplay.from_estimator draws a fitted RecursiveARXCV, or a pipeline that "
            f"ends in one; got {type(search).__name__}."
        )
    horizons = [np.atleast_1d(np.asarray(h, dtype=float)) for h in results["memory_horizon"]]
    table = pd.DataFrame(
        {
            "memory_horizon": [h.min() for h in horizons],
            "best": np.arange(len(horizons)) == search.best_index_,
            "score": results["mean_test_score"],
            **{kind: results[kind] for kind in ("gain", *LOWER_IS_BETTER)},
            **{f"sd_{kind}": results[name] for kind, name in DEVIATIONS.items()},
        }
    )
    ratios = np.array([_ratios(h) for h in horizons])
    infinite = np.isinf(table["memory_horizon"].to_numpy())
    kinds = list(dict.fromkeys(ratios[~infinite])) or [""]
    found = []
    for kind in kinds:
        of_kind = (kind or "one $N_0$") if len(kinds) > 1 else kind
        name = ", ".join(filter(None, (label, of_kind))) or "mean over splits"
        found.append(table[infinite | (ratios == kind)].assign(line=name))
    return found


def _ratios(horizons: np.ndarray) -> str:
    """Horizons of parameters in units of the shortest."""
    shortest = horizons.min()
    if np.isinf(shortest) or (horizons == shortest).all():
        return ""
    ratios = [
        "∞" if np.isinf(h) else "$N_0$" if h == shortest else f"{h / shortest:g} $N_0$"
        for h in horizons
    ]
    return f"({', '.join(ratios)})"
