"""Error path of a search: how the error falls as effects are added."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from ._axes import legend_above, with_unit, wrapped
from ._comparison import percent, say_instead
from ._display import Display
from ._effects import UNKNOWN, attributes_of, broken, step_labels, unit_of
from ._roles import BLUE, GREEN, GREY, PURPLE, VERMILION, background, foreground, scaled, sized

TAKEN = ("error_path_", "best_effects_", "verdict_", "predictions_")
LOWEST = -20.0  # percent; lower steps are cut and written
WIDTH = 1.25  # inches for each step
BESIDE = 0.9  # of a step, for the text beside the last
SMALL_GAP = 0.05  # points, below which nothing is left
LEAST_SPAN = 10.0  # points of VAF, so that a small gap looks small
BESIDE_EACH_OTHER = 0.25  # of a step, by which two values on it are off its middle
ROOM = 0.24  # of the height, for the text about the gap


@dataclass(kw_only=True, eq=False, repr=False)
class ErrorPathDisplay(Display):
    """Held-out VAF and RMSE as a staircase: one step for each effect that is added.

    Above the VAF, below the RMSE of runs that were held out of the fit. The dashed line is the
    ceiling: what any model driven by these channels can reach. The bar beside the last step
    is what is left to explain. Grey marks are the VAF on the rows of the fit. The dotted staircase
    is the VAF of the same runs in the closed loop, in which the model's own output moves x and e:
    what follows the remnant round the loop does not rise there.

    Make it with :meth:`from_estimator`.

    Parameters
    ----------
    error_path : DataFrame
        ``error_path_`` of the search: one row a step, with the columns effect, vaf, rmse,
        vaf_train, ceiling and explainable_gap, and vaf_loop where the closed loop is known.
    best_effects : list of str
        ``best_effects_`` of the search.
    verdict : str
        ``verdict_`` of the search.
    unit : str or None, default=None
        Unit of the output.

    Attributes
    ----------
    axes_ : ndarray of Axes, shape (2,)
        VAF and RMSE.
    figure_ : Figure
        The figure that holds them.
    stairs_ : dict of StepPatch
        The staircases, ``"vaf"`` and ``"rmse"``, and ``"vaf_loop"`` where it is known.
    ceilings_ : dict of StepPatch
        The ceiling in both panels; empty where it is not known.
    train_ : Line2D or None
        VAF on the rows of the fit.
    gap_ : Line2D or None
        The bar, where something is left.
    labels_ : dict of list of Text
        Values on the steps, by the names of the staircases.

    See Also
    --------
    EffectStepsDisplay : The simulations before and after.

    Examples
    --------
    >>> import pandas as pd
    >>> from skhoid.plotting import ErrorPathDisplay
    >>> path = pd.DataFrame(
    ...     {
    ...         "effect": ["baseline", "dead_zone"],
    ...         "vaf": [76.1, 86.8],
    ...         "rmse": [0.31, 0.23],
    ...         "vaf_train": [76.6, 87.0],
    ...         "ceiling": [87.0, 87.0],
    ...         "explainable_gap": [10.9, 0.2],
    ...     }
    ... )
    >>> display = ErrorPathDisplay(
    ...     error_path=path, best_effects=["dead_zone"], verdict="effects found", unit="deg"
    ... ).plot()
    >>> display.stairs_["vaf"].get_data().values.tolist()
    [76.1, 86.8]
    """

    error_path: pd.DataFrame
    best_effects: list[str]
    verdict: str
    unit: str | None = None

    @classmethod
    def from_estimator(cls, search: Any, *, ax: Any = None) -> Self:
        """Draw the path of a search.

        Parameters
        ----------
        search : fitted EffectSearchCV
            The search.
        ax : sequence of two Axes or None, default=None
            Where to draw, see :meth:`plot`. None makes a figure.

        Returns
        -------
        display : ErrorPathDisplay
        """
        taken = attributes_of(search, TAKEN, cls.__name__)
        return cls(unit=unit_of(taken.pop("predictions")), **taken).plot(ax)

    def plot(self, ax: Any = None) -> Self:
        """Draw.

        Parameters
        ----------
        ax : sequence of two Axes or None, default=None
            Where to draw VAF and RMSE. None makes a figure.

        Returns
        -------
        self : ErrorPathDisplay
        """
        # Structure that no effect explains is no step: nothing was added.
        path = self.error_path[self.error_path["effect"] != UNKNOWN]
        size = max(6.4, 1.4 + WIDTH * (len(path) + BESIDE)), 5.2
        self.axes_ = self._take_axes(ax, "VAF and RMSE", (2, 1), sharex=True, figsize=size)
        self.stairs_: dict[str, Any] = {}
        self.ceilings_: dict[str, Any] = {}
        self.labels_: dict[str, list[Any]] = {}
        self.train_: Any = None
        self.gap_: Any = None
        self.axes_[0].set_title(wrapped(self._title_text(), 72), fontsize="medium")
        if not np.isfinite(path["vaf"].to_numpy(dtype=float)).any():
            for panel, what in zip(self.axes_, ("VAF", "RMSE"), strict=True):
                say_instead(panel, f"Held-out {what}: not available.")
            return self
        vaf, ceiling = path["vaf"].to_numpy(dtype=float), path["ceiling"].to_numpy(dtype=float)
        rmse = path["rmse"].to_numpy(dtype=float)
        top, bottom = self.axes_
        self._draw_train(top, path["vaf_train"].to_numpy(dtype=float))
        in_loop = path.get("vaf_loop", pd.Series(np.nan, path.index)).to_numpy(dtype=float)
        self._draw_stairs(top, "vaf", vaf, ceiling, [percent(v) for v in vaf])
        if np.isfinite(in_loop).any():
            self._draw_in_loop(top, in_loop)
        # The power of the output, which VAF is relative to, is that of the RMSE at a VAF of 0.
        floor = rmse * np.sqrt(np.clip(100.0 - ceiling, 0.0, None) / (100.0 - vaf))
        self._draw_stairs(bottom, "rmse", rmse, floor, [f"{v:#.3g}" for v in rmse])
        self._limit(np.r_[vaf, in_loop])
        gap = path["explainable_gap"].to_numpy(dtype=float)[-1]
        self._draw_gap(top, len(path), vaf[-1], ceiling[-1], gap)
        top.set_ylabel("held-out VAF, %")
        bottom.set_ylabel(with_unit("held-out RMSE", self.unit))
        labels = [broken(label) for label in step_labels(path["effect"])]
        for panel in self.axes_:
            panel.set_xlim(-0.5, len(path) - 0.5 + BESIDE)
            panel.set_xticks(range(len(path)), labels)
            panel.grid(alpha=0.3, axis="y")
            panel.set_axisbelow(True)
        several = "vaf_loop" in self.stairs_  # of which a legend takes two rows
        legend_above(top, columns=2 if several else 3)
        top.set_title(top.get_title(), fontsize="medium", pad=38 if several else 24)
        return self

    def _title_text(self) -> str:
        found = [name for name in self.best_effects if name != UNKNOWN]
        added = [name for name in self.error_path["effect"][1:] if name != UNKNOWN]
        if not found:
            verdict = self.verdict[:1].upper() + self.verdict[1:]
            # Effects may be added without being named: none explains enough.
            return f"{verdict}; stand-ins: {', '.join(added)}" if added else verdict
        text = f"Found: {', '.join(found)}"
        return f"{text}; {self.verdict}" if len(found) < len(self.best_effects) else text

    def _ceiling(self) -> str:
        # Remnant that passes a nonlinearity lowers the ceiling seen by a model without it.
        path = self.error_path
        passed = (path["vaf"] > path["ceiling"] + SMALL_GAP).any()
        return "ceiling (a lower bound)" if passed else "ceiling"

    def _draw_stairs(
        self, panel: Axes, name: str, values: np.ndarray, ceiling: np.ndarray, labels: list[str]
    ) -> None:
        edges = np.arange(len(values) + 1) - 0.5
        colour = BLUE if name == "vaf" else PURPLE
        self.stairs_[name] = panel.stairs(
            values, edges, baseline=None, color=colour, lw=scaled(2.4), label="held-out runs"
        )
        if np.isfinite(ceiling).any():
            self.ceilings_[name] = panel.stairs(
                ceiling,
                edges,
                baseline=None,
                color=foreground(),
                lw=scaled(1.2),
                ls="--",
                label=self._ceiling(),
            )
        self._label(panel, name, values, labels, colour)

    def _draw_in_loop(self, panel: Axes, values: np.ndarray) -> None:
        edges = np.arange(len(values) + 1) - 0.5
        self.stairs_["vaf_loop"] = panel.stairs(
            values,
            edges,
            baseline=None,
            color=GREEN,
            lw=scaled(1.8),
            ls=":",
            label="in the closed loop",
        )
        labels = [percent(v) if np.isfinite(v) else "" for v in values]
        self._label(panel, "vaf_loop", values, labels, GREEN, BESIDE_EACH_OTHER)
        for label in self.labels_["vaf"]:  # beside these, whichever is higher
            label.xy = (label.xy[0] - BESIDE_EACH_OTHER, label.xy[1])

    def _label(
        self,
        panel: Axes,
        name: str,
        values: np.ndarray,
        labels: list[str],
        colour: str,
        right: float = 0.0,
    ) -> None:
        """Write the value on each step, ``right`` of its middle."""
        self.labels_[name] = []
        for i, (value, label) in enumerate(zip(values, labels, strict=True)):
            cut = name != "rmse" and value < LOWEST
            above = cut or name == "rmse"
            self.labels_[name].append(
                panel.annotate(
                    f"↓ {label}" if cut else label,
                    (i + right, LOWEST if cut else np.nan_to_num(value)),
                    xytext=(0, 4 if above else -4),
                    textcoords="offset points",
                    ha="center",
                    va="bottom" if above else "top",
                    color=colour,
                    fontsize="small",
                    visible=bool(label),
                    bbox={"facecolor": background(), "edgecolor": "none", "pad": 0.8},
                )
            )

    def _draw_train(self, panel: Axes, values: np.ndarray) -> None:
        if np.isfinite(values).any():
            (self.train_,) = panel.plot(
                values,
                color=GREY,
                marker="_",
                ms=sized(14),
                mew=scaled(1.8),
                ls="none",
                label="rows of the fit",
            )

    def _limit(self, vaf: np.ndarray) -> None:
        """Room for the values on the steps; a lost baseline does not squeeze all others."""
        top, bottom = self.axes_
        low, high = top.get_ylim()
        low = min(low, high - LEAST_SPAN)
        low, high = low - 0.16 * (high - low), high + 0.04 * (high - low)
        top.set_ylim(LOWEST if np.nanmin(vaf) < LOWEST else low, high)
        bottom.set_ylim(0.0, 1.14 * bottom.get_ylim()[1])

    def _draw_gap(self, panel: Axes, n_steps: int, vaf: float, ceiling: float, gap: float) -> None:
        """What is left, beside the last step: red where no effect of the catalogue explains it."""
        left = UNKNOWN in self.best_effects
        colour = VERMILION if left else foreground()
        edge = n_steps - 0.5
        at = vaf
        if np.isnan(ceiling):
            text = "ceiling not\nknown"
        elif gap < SMALL_GAP:
            text = "nothing left"
        else:
            text = f"{gap:.1f} points\nleft"
            at = (max(vaf, LOWEST) + ceiling) / 2
            (self.gap_,) = panel.plot(
                [edge + 0.08] * 2,
                [vaf, ceiling],
                color=colour,
                lw=scaled(3.0),
                solid_capstyle="butt",
            )
        if left:
            text += "\nnot in the\ncatalogue"
        low, high = panel.get_ylim()
        height = np.clip((at - low) / (high - low), ROOM, 1.0 - ROOM)
        panel.text(
            edge + 0.16,
            height,
            text,
            transform=panel.get_xaxis_transform(),
            va="center",
            color=colour,
            fontsize="small",
        )
