"""Parameters of the human operator over time, or of several models side by side."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from ..human import HumanOperator
from ..human.conversion import NAMES, UNITS, operator_parameters
from ._axes import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SKY,
    VERMILLION,
    given_axes,
    with_unit,
)

SYMBOLS = {
    "K_e": "$K_e$",
    "T_L": "$T_L$",
    "K_edot": r"$K_{\dot e}$",
    "omega_nm": r"$\omega_{nm}$",
    "zeta_nm": r"$\zeta_{nm}$",
    "tau_e": r"$\tau_e$",
}
COLOURS = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY, GREY)
SHOWN = (2.0, 98.0)  # percentiles of the estimates that limits always hold
FEW = 20  # estimates, below which limits hold all
MARGIN = 0.12  # of the range, above and below
EXACT = 1e-9  # s; a delay known better is no estimate
CROWDED = 50  # letters in one row of labels
DEVIATION = "± 1 standard deviation"
FINE = 1000  # instants at which a true operator is drawn


class OperatorParametersDisplay:
    """Operator parameters over time, or of batch models side by side (Figs. 15 and 17).

    One panel each for K_e, T_L, K_edot, omega_nm and zeta_nm, with one standard deviation to
    either side and the true values where they are known. The delay is in the title, or in a panel
    where it varies or has a standard deviation. Where only batch models are given they are
    points, otherwise horizontal lines.

    Limits hold the true values and, of 20 estimates and more, the central 96 %: T_L = K_edot / K_e
    has no bounds where K_e comes near zero. A note in the panel counts the estimates outside.

    Make it with :meth:`from_estimator` or :meth:`from_frame`.

    Parameters
    ----------
    frames : dict of DataFrame
        Results of ``operator_parameters``, by label.
    truth : DataFrame or None, default=None
        True values in the same columns, over ``time`` or in one row.

    Attributes
    ----------
    axes_ : ndarray of Axes, shape (n_panels,)
        The panels.
    figure_ : Figure
        The figure that holds them.
    names_ : list of str
        The parameter in each panel.
    lines_ : dict of Line2D
        Estimates by (label, parameter).
    bands_ : dict of Collection
        Standard deviations by (label, parameter): areas, or the bars of points.
    truth_ : dict of Line2D
        True values by parameter.
    notes_ : dict of Text
        Counts of estimates outside the panel, by parameter.

    See Also
    --------
    skhoid.human.conversion.operator_parameters : The figures in the panels.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import lfilter
    >>> from skhoid import ARXRegressor, HumanOperator
    >>> from skhoid import zoh_parameters
    >>> from skhoid.plotting import OperatorParametersDisplay
    >>> a1, a2, b0, b1 = zoh_parameters(HumanOperator(), dt=0.01)
    >>> e = np.random.default_rng(0).standard_normal(2000)
    >>> u = lfilter(29 * [0] + [b0, b1], [1, a1, a2], e)
    >>> model = ARXRegressor(na=2, nb=2, nk=29, dt=0.01).fit(e[:, None], u)
    >>> display = OperatorParametersDisplay.from_estimator(model, truth=HumanOperator())
    >>> display.names_
    ['K_e', 'T_L', 'K_edot', 'omega_nm', 'zeta_nm']
    """

    def __init__(self, *, frames: Mapping[str, pd.DataFrame], truth: Any = None) -> None:
        self.frames = frames
        self.truth = truth

    @classmethod
    def from_estimator(
        cls, model: Any, truth: Any = None, *, ax: Any = None, **options: Any
    ) -> OperatorParametersDisplay:
        """Convert fitted ARX models and draw.

        Parameters
        ----------
        model : fitted model, pipeline or search, or dict of them by label
            See ``operator_parameters``.
        truth : HumanOperator, DataFrame, Series or None, default=None
            True values, see :meth:`from_frame`.
        ax : sequence of Axes or None, default=None
            Where to draw, see :meth:`plot`.
        **options : dict
            Options of ``operator_parameters``: ``method``, ``input``, ``band``, ``pade_order``.

        Returns
        -------
        display : OperatorParametersDisplay
        """
        models = model if isinstance(model, Mapping) else {"estimate": model}
        frames = {label: operator_parameters(m, **options) for label, m in models.items()}
        return cls.from_frame(frames, truth, ax=ax)

    @classmethod
    def from_frame(
        cls, frame: Any, truth: Any = None, *, ax: Any = None
    ) -> OperatorParametersDisplay:
        """Draw parameters that have been computed.

        Parameters
        ----------
        frame : DataFrame, or dict of them by label
            Results of ``operator_parameters``.
        truth : HumanOperator, DataFrame, Series or None, default=None
            True values: an operator, whose functions of time are evaluated, or a frame with
            columns of the same names, such as the ``truth.parameters`` of make_tracking_runs, or a
            row of one.
        ax : sequence of Axes or None, default=None
            Where to draw, see :meth:`plot`.

        Returns
        -------
        display : OperatorParametersDisplay

        Raises
        ------
        TypeError
            If a frame or the truth is something else.
        ValueError
            If columns are missing, or the truth varies and no estimate does.
        """
        frames = dict(frame) if isinstance(frame, Mapping) else {"estimate": frame}
        for label, table in frames.items():
            if not isinstance(table, pd.DataFrame):
                raise TypeError(
                    "OperatorParametersDisplay draws results of operator_parameters; "
                    f"{label!r} is a {type(table).__name__}."
                )
            missing = [name for name in NAMES if name not in table]
            if missing:
                raise ValueError(f"The frame {label!r} has no column {missing[0]!r}.")
        return cls(frames=frames, truth=_truth(truth, frames)).plot(ax)

    def plot(self, ax: Any = None) -> OperatorParametersDisplay:
        """Draw.

        Parameters
        ----------
        ax : sequence of Axes or None, default=None
            Five panels, or six with one for the delay. None makes a figure.

        Returns
        -------
        self : OperatorParametersDisplay
        """
        tables = list(self.frames.values())
        self._times = [t.index.to_numpy(dtype=float) for t in tables if _over_time(t)]
        self.names_ = [name for name in NAMES if name != "tau_e"]
        if self._delay() is None:
            self.names_.append("tau_e")
        n = len(self.names_)
        own = ax is None
        if own:
            size = (6.8, 0.9 + 1.4 * n)
            _, ax = plt.subplots(n, figsize=size, sharex=True, layout="constrained")
        self.axes_ = np.array(given_axes(ax, (n,), f"one for each of {', '.join(self.names_)}"))
        self.figure_ = self.axes_[0].figure
        self.lines_: dict[tuple[str, str], Any] = {}
        self.bands_: dict[tuple[str, str], Any] = {}
        self.truth_: dict[str, Any] = {}
        self.notes_: dict[str, Any] = {}
        for name, panel in zip(self.names_, self.axes_, strict=True):
            for position, label in enumerate(self.frames):
                if self._times:
                    self._draw_over_time(panel, name, label, COLOURS[position % len(COLOURS)])
                else:
                    self._draw_point(panel, name, label, position)
            self._draw_truth(panel, name)
            self._limit(panel, name)
            panel.set_ylabel(with_unit(SYMBOLS[name], UNITS[name]), fontsize="large")
            panel.grid(alpha=0.3)
        self._finish(own)
        return self

    def _delay(self) -> float | None:
        """The delay that all estimates share and take as exact, in s."""
        tables = self.frames.values()
        delays = np.concatenate([table["tau_e"] for table in tables])
        delays = delays[np.isfinite(delays)]
        uncertain = any((_deviation(table, "tau_e") > EXACT).any() for table in tables)
        if uncertain or delays.size == 0 or np.ptp(delays) > EXACT:
            return None
        return float(delays[0])

    def _draw_over_time(self, panel: Any, name: str, label: str, colour: str) -> None:
        table = self.frames[label]
        time, value, deviation = table.index, table[name].to_numpy(), _deviation(table, name)
        if not _over_time(table):
            # A batch model holds over the whole time that others span.
            time = [min(t.min() for t in self._times), max(t.max() for t in self._times)]
            value, deviation = np.repeat(value, 2), np.repeat(deviation, 2)
        dashes = "-" if _over_time(table) else "--"
        (line,) = panel.plot(time, value, color=colour, lw=1.2, ls=dashes, label=label)
        self.lines_[label, name] = line
        if np.isfinite(deviation).any():
            first = name == self.names_[0] and not self.bands_
            self.bands_[label, name] = panel.fill_between(
                time,
                value - deviation,
                value + deviation,
                color=colour,
                alpha=0.25,
                lw=0,
                label=DEVIATION if first else None,
            )

    def _draw_point(self, panel: Any, name: str, label: str, position: int) -> None:
        table = self.frames[label]
        value, deviation = table[name].iloc[0], np.nan_to_num(_deviation(table, name))
        point, _, bars = panel.errorbar(
            [position],
            [value],
            deviation[:1],
            color=BLUE,
            marker="o",
            ms=5,
            ls="none",
            capsize=4,
            label=f"estimate {DEVIATION}" if position == 0 else None,
        )
        self.lines_[label, name], self.bands_[label, name] = point, bars[0]
        if np.isnan(value):
            middle = panel.get_xaxis_transform()
            panel.text(
                position, 0.5, "none", transform=middle, color=GREY, ha="center", va="center"
            )

    def _draw_truth(self, panel: Any, name: str) -> None:
        if self.truth is None or name not in self.truth:
            return
        values = self.truth[name].to_numpy(dtype=float)
        if _over_time(self.truth):
            (line,) = panel.plot(self.truth.index, values, color=BLACK, lw=1.0, label="true")
        else:
            line = panel.axhline(values[0], color=BLACK, lw=1.0, label="true")
        self.truth_[name] = line

    def _limit(self, panel: Any, name: str) -> None:
        """Limits that hold the truth and all but extreme estimates."""
        estimates, wanted = [], []
        for table in self.frames.values():
            value = table[name].to_numpy(dtype=float)
            estimates.append(value[~np.isnan(value)])
            if (finite := value[np.isfinite(value)]).size:
                deviation = _deviation(table, name)
                deviation = deviation[np.isfinite(deviation)]
                typical = float(np.median(deviation)) if deviation.size else 0.0
                if finite.size >= FEW:
                    finite = np.clip(finite, *_central(finite))
                low, high = finite.min(), finite.max()
                wanted += [low - typical, high + typical]
        if not wanted:
            return
        if name in self.truth_:
            wanted += [self.truth[name].min(), self.truth[name].max()]
        low, high = min(wanted), max(wanted)
        margin = MARGIN * max(high - low, 0.02 * abs(high))
        panel.set_ylim(low - margin, high + margin)
        shown = np.concatenate(estimates)
        outside = int(np.sum((shown < low - margin) | (shown > high + margin)))
        if outside:
            self.notes_[name] = panel.text(
                0.99,
                0.93,
                f"{outside} of {shown.size} outside",
                transform=panel.transAxes,
                ha="right",
                va="top",
                fontsize="small",
                bbox={"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 1.5},
            )

    def _finish(self, own: bool) -> None:
        if self._times:
            for panel in self.axes_[-1:] if own else self.axes_:
                panel.set_xlabel("time, s")
        else:
            crowded = sum(map(len, self.frames)) > CROWDED
            slant: dict[str, Any] = {"rotation": 20, "ha": "right"} if crowded else {}
            for panel in self.axes_:
                panel.set_xticks(range(len(self.frames)), list(self.frames), **slant)
                panel.set_xlim(-0.5, len(self.frames) - 0.5)
        delay = self._delay()
        if delay is not None:
            self.axes_[0].set_title(f"{SYMBOLS['tau_e']} = {delay:.3g} s")
        handles, labels = self.axes_[0].get_legend_handles_labels()
        if own:
            self.figure_.align_ylabels(self.axes_)
            self.figure_.legend(handles, labels, loc="outside lower center", ncols=4)
        else:
            self.axes_[0].legend(loc="best")


def _over_time(table: pd.DataFrame) -> bool:
    return bool(table.index.name == "time")


def _deviation(table: pd.DataFrame, name: str) -> np.ndarray:
    if f"sd_{name}" not in table:
        return np.full(len(table), np.nan)
    return table[f"sd_{name}"].to_numpy(dtype=float)


def _central(values: np.ndarray) -> tuple[float, float]:
    """Percentiles that are values themselves: between two, an outlier would pull them."""
    low = np.percentile(values, SHOWN[0], method="higher")
    return float(low), float(np.percentile(values, SHOWN[1], method="lower"))


def _truth(truth: Any, frames: dict[str, pd.DataFrame]) -> pd.DataFrame | None:
    """True values over the times of the estimates, or in one row where they do not vary."""
    truth = getattr(truth, "parameters", truth)  # the third result of make_tracking_runs
    if isinstance(truth, pd.Series):
        truth = truth.to_frame().T
    times = [table.index.to_numpy(dtype=float) for table in frames.values() if _over_time(table)]
    varying = (
        "The truth varies in time and no estimate does, so its values have no place here. Give it "
        "at one instant: truth=operator.at(t), or truth=frame.loc[t]."
    )
    if truth is None:
        return None
    if isinstance(truth, pd.DataFrame):
        truth = truth[[name for name in NAMES if name in truth]]
        if (truth == truth.iloc[0]).all(axis=None):
            return truth[:1].reset_index(drop=True)
        if not times:
            raise ValueError(varying)
        return truth
    if not isinstance(truth, HumanOperator):
        raise TypeError(
            "truth must be a HumanOperator, a DataFrame or a row of one; got "
            f"{type(truth).__name__}."
        )
    index = pd.Index([0])
    if times:
        instants = np.concatenate(times)
        fine = np.linspace(instants.min(), instants.max(), FINE)
        index = pd.Index(np.union1d(instants, fine), name="time")
    elif any(callable(getattr(truth, name)) for name in NAMES):
        raise ValueError(varying)
    instants = index.to_numpy(dtype=float)
    return pd.DataFrame(truth.over_time(instants), index=index)
