"""VAF of each run, against the noise ceiling."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd

from ._comparison import ComparisonBaseDisplay, beyond, exceeding, percent, say_instead
from ._roles import ROLES, foreground, scaled, sized, veil

MOST_NAMED = 16  # runs that get a tick label each
MOST_SAID = 4
MANY = 100  # runs, whose marks are small
LONG = 4  # letters of a label; longer ones stand upright where there are many
LOWEST = -20.0  # percent; runs below it are named at the edge
PARTS = {"validation": "simulated", "estimation": "remnant"}


@dataclass(kw_only=True, eq=False, repr=False)
class RunComparisonDisplay(ComparisonBaseDisplay):
    """VAF by run, in validation and estimation, with the noise ceiling.

    Runs whose residual power exceeds chance are ringed in red. A run far below zero is named at
    the lower edge. The ceiling is that of the validation runs together.

    Make it with :meth:`from_comparison` or :meth:`from_estimator`.

    Parameters
    ----------
    by_run : DataFrame
        ``Comparison.by_run``.
    vaf : float
        Of the validation runs together, in percent.
    noise_ceiling : float
        In percent; NaN if it is not known.
    noise_ceiling_interval : (float, float)
        Its 95 % interval.
    false_alarm : float, default=0.01
        Rate of false alarms of what is marked.

    Attributes
    ----------
    ax_ : Axes
        The panel.
    figure_ : Figure
        The figure that holds it.
    lines_ : dict of Line2D
        VAF by run, ``"validation"`` and, if there are any, ``"estimation"``.
    exceeding_ : Line2D or None
        Rings around runs that exceed chance.
    ceiling_ : Line2D or None
        The ceiling.

    Examples
    --------
    >>> from skhoid import ARXRegressor, compare, make_tracking_runs, select_runs
    >>> from skhoid.plotting import RunComparisonDisplay
    >>> X, y = make_tracking_runs(
    ...     "C1", n_runs=5, remnant_intensity=0.15, channels=["e", "f_t"], random_state=0
    ... )
    >>> estimation, validation = select_runs(X, y, first=2), select_runs(X, y, last=3)
    >>> model = ARXRegressor(nk=29).fit(*estimation)
    >>> display = RunComparisonDisplay.from_estimator(model, *validation, estimation=estimation)
    >>> [len(line.get_ydata()) for line in display.lines_.values()]
    [3, 2]
    """

    by_run: pd.DataFrame
    vaf: float
    noise_ceiling: float
    noise_ceiling_interval: tuple[float, float]
    false_alarm: float = 0.01

    def plot(
        self,
        ax: Any = None,
        *,
        marker_kw: dict[str, Any] | None = None,
        ceiling_kw: dict[str, Any] | None = None,
    ) -> Self:
        """Draw.

        Parameters
        ----------
        ax : Axes or None, default=None
            Where to draw. None makes a figure.
        marker_kw : dict or None, default=None
            Keywords of matplotlib for the dots of the runs.
        ceiling_kw : dict or None, default=None
            Keywords of matplotlib for the noise ceiling.

        Returns
        -------
        self : RunComparisonDisplay
        """
        styles = {"marker": marker_kw, "ceiling": ceiling_kw}
        (self.ax_,) = self._take_axes(ax, "the VAF of the runs", figsize=(6.4, 4.2))
        self.lines_: dict[str, Any] = {}
        self.exceeding_: Any = None
        self.ceiling_: Any = None
        parts = [self.by_run[self.by_run["data"] == name] for name in PARTS]
        table = pd.concat(parts, ignore_index=True)
        if not np.isfinite(table["vaf"].to_numpy(dtype=float)).any():
            say_instead(self.ax_, "VAF by run: not available.")
            return self
        n_validation = len(parts[0])
        # A gap between validation and estimation.
        at = np.arange(len(table)) + np.where(np.arange(len(table)) < n_validation, 0.0, 0.6)
        self._draw_levels(n_validation)
        self._draw_runs(table, at)
        self._name_runs(table, at)
        self.ax_.set_ylabel("VAF, %")
        self.ax_.set_title(self._title_text(table), fontsize="medium")
        self.ax_.grid(alpha=0.3, axis="y")
        self._restyle(styles, marker=self.lines_, ceiling=self.ceiling_)
        self._legend_of_panels()
        return self

    def _draw_levels(self, n_validation: int) -> None:
        """The ceiling and the VAF of all validation runs, over these runs only."""
        span = np.array([-0.5, n_validation - 0.5])
        if not np.isnan(self.noise_ceiling):
            low, high = self.noise_ceiling_interval
            if np.isfinite([low, high]).all():
                self.ax_.fill_between(
                    span, low, high, color=ROLES["ceiling"].colour, alpha=veil(0.2), lw=0
                )
            (self.ceiling_,) = self.ax_.plot(
                span,
                np.repeat(self.noise_ceiling, 2),
                **ROLES["ceiling"].style(1.6),
                label=f"noise ceiling {percent(self.noise_ceiling)}, 95 % interval",
            )
        self.ax_.plot(
            span,
            np.repeat(self.vaf, 2),
            color=ROLES["simulated"].colour,
            lw=scaled(1.2),
            ls="--",
            label=f"validation runs together {percent(self.vaf)}",
        )

    def _draw_runs(self, table: pd.DataFrame, at: np.ndarray) -> None:
        vaf = table["vaf"].to_numpy(dtype=float)
        below = vaf < LOWEST
        size = 6.0 if len(table) <= MANY else 2.5
        for name, role in PARTS.items():
            colour = ROLES[role].colour
            rows = (table["data"] == name).to_numpy()
            if rows.any():
                (self.lines_[name],) = self.ax_.plot(
                    at[rows], vaf[rows], color=colour, marker="o", ms=size, ls="none", label=name
                )
        raised = exceeding(table)
        if raised.any():
            (self.exceeding_,) = self.ax_.plot(
                at[raised],
                vaf[raised],
                ls="none",
                marker="o",
                ms=sized(2) * size,
                mfc="none",
                mec=ROLES["misfit"].colour,
                mew=scaled(1.8),
                label=beyond(self.false_alarm),
            )
        if below.any():
            self.ax_.set_ylim(LOWEST, 100.0)
            lowest = np.flatnonzero(below)[np.argsort(vaf[below], kind="stable")][:MOST_NAMED]
            for x, value, red in zip(at[lowest], vaf[lowest], raised[lowest], strict=True):
                colour = ROLES["misfit"].colour if red else foreground()
                self.ax_.annotate(
                    f"{value:.0f} %",
                    (x, LOWEST),
                    xytext=(0, 18),
                    textcoords="offset points",
                    ha="center",
                    fontsize="small",
                    color=colour,
                    arrowprops={"arrowstyle": "->", "color": colour},
                )
        else:
            self.ax_.margins(y=0.15)

    def _name_runs(self, table: pd.DataFrame, at: np.ndarray) -> None:
        names = table["run"].tolist()
        every = -(-len(names) // MOST_NAMED)
        upright = len(names) > 6 and max(map(len, names)) > LONG
        self.ax_.set_xticks(at[::every], names[::every], rotation=90 if upright else 0)
        self.ax_.set_xlim(at[0] - 0.7, at[-1] + 0.7)
        self.ax_.set_xlabel("run")

    def _title_text(self, table: pd.DataFrame) -> str:
        if table["p"].isna().all():
            return "Too few runs to test one against the others"
        raised = table.loc[exceeding(table), "run"].tolist()
        if not raised:
            return "No run differs from the others by more than chance"
        more = f" and {len(raised) - MOST_SAID} more" if len(raised) > MOST_SAID else ""
        runs = "run" if len(raised) == 1 else "runs"
        return f"Beyond chance: {runs} {', '.join(raised[:MOST_SAID])}{more}"
