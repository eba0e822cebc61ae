"""Parameters of the human operator over time, or of several models side by side."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd

from ..human import HumanOperator
from ..interpret.conversion import NAMES, UNITS, operator_parameters
from ._axes import with_unit
from ._estimates import (
    DEVIATION,
    EstimatesDisplay,
    check_references,
    deviation_of,
    in_one_row,
    times_of,
)
from ._roles import BLUE, GREY, sized

SYMBOLS = {
    "K_e": "$K_e$",
    "T_L": "$T_L$",
    "K_edot": r"$K_{\dot e}$",
    "omega_nm": r"$\omega_{nm}$",
    "zeta_nm": r"$\zeta_{nm}$",
    "tau_e": r"$\tau_e$",
}
EXACT = 1e-9  # s; a delay known better is no estimate
CROWDED = 50  # letters in one row of labels
FINE = 1000  # instants at which a true operator is drawn


@dataclass(kw_only=True, eq=False, repr=False)
class OperatorParametersDisplay(EstimatesDisplay):
    """Operator parameters over time, or of batch models side by side (Figs. 15 and 17).

    One panel each for K_e, T_L, K_edot, omega_nm and zeta_nm, with one standard deviation to
    either side and the true values where they are known. The delay is in the title, or in a panel
    where it varies or has a standard deviation. Where only batch models are given they are
    points, otherwise horizontal lines.

    Limits hold the true values and all estimates, unless those, of 20 and more, take twice the
    range of their central 96 %: T_L = K_edot / K_e has no bounds where K_e comes near zero. A note
    in the panel counts the estimates outside.

    Make it with :meth:`from_estimator` or :meth:`from_frame`.

    Parameters
    ----------
    frames : dict of DataFrame
        Results of ``operator_parameters``, by label.
    truth : DataFrame or None, default=None
        True values in the same columns, over ``time`` or in one row.
    references : DataFrame or None, default=None
        Result of :func:`skhoid.reference_fits`, drawn as orange levels over its windows.
    transition_time : float or None, default=None
        Instant to mark, in s.

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
    references_ : dict of Line2D
        References by (window, parameter).
    notes_ : dict of Text
        Counts of estimates outside the panel, by parameter.

    See Also
    --------
    skhoid.interpret.conversion.operator_parameters : The figures in the panels.

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

    @classmethod
    def from_estimator(
        cls,
        model: Any,
        truth: Any = None,
        *,
        references: pd.DataFrame | None = None,
        transition_time: float | None = None,
        ax: Any = None,
        **options: Any,
    ) -> Self:
        """Convert fitted ARX models and draw.

        Parameters
        ----------
        model : fitted model, pipeline or search, or dict of them by label
            See ``operator_parameters``.
        truth : HumanOperator, DataFrame, Series or None, default=None
            True values, see :meth:`from_frame`.
        references : DataFrame or None, default=None
            Result of :func:`skhoid.reference_fits`: batch models of constant parts of the runs.
        transition_time : float or None, default=None
            Instant to mark, in s.
        ax : sequence of Axes or None, default=None
            Where to draw, see :meth:`plot`.
        **options : dict
            Keywords of :meth:`plot` whose names end in ``_kw``, and options of
            ``operator_parameters``: ``method``, ``input``, ``band``, ``pade_order``.

        Returns
        -------
        display : OperatorParametersDisplay
        """
        styles = {name: options.pop(name) for name in list(options) if name.endswith("_kw")}
        models = model if isinstance(model, Mapping) else {"estimate": model}
        frames = {label: operator_parameters(m, **options) for label, m in models.items()}
        return cls.from_frame(
            frames, truth, references=references, transition_time=transition_time, ax=ax, **styles
        )

    @classmethod
    def from_frame(
        cls,
        frame: Any,
        truth: Any = None,
        *,
        references: pd.DataFrame | None = None,
        transition_time: float | None = None,
        ax: Any = None,
        **styles: Any,
    ) -> Self:
        """Draw parameters that have been computed.

        Parameters
        ----------
        frame : DataFrame, or dict of them by label
            Results of ``operator_parameters``.
        truth : HumanOperator, DataFrame, Series or None, default=None
            True values: an operator, whose functions of time are evaluated, or a frame with
            columns of the same names, such as the ``truth.parameters`` of make_tracking_runs, or a
            row of one.
        references : DataFrame or None, default=None
            Result of :func:`skhoid.reference_fits`: batch models of constant parts of the runs.
        transition_time : float or None, default=None
            Instant to mark, in s.
        ax : sequence of Axes or None, default=None
            Where to draw, see :meth:`plot`.
        **styles : dict
            Keywords of :meth:`plot` whose names end in ``_kw``.

        Returns
        -------
        display : OperatorParametersDisplay

        Raises
        ------
        TypeError
            If a frame or the truth is something else.
        ValueError
            If columns are missing, or truth or references need times and no estimate varies.
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
        check_references(references, NAMES, varying=bool(times_of(frames.values())))
        display = cls(
            frames=frames,
            truth=_truth(truth, frames),
            references=references,
            transition_time=transition_time,
        )
        return display.plot(ax, **styles)

    def plot(
        self,
        ax: Any = None,
        *,
        line_kw: dict[str, Any] | None = None,
        band_kw: dict[str, Any] | None = None,
        truth_kw: dict[str, Any] | None = None,
        reference_kw: dict[str, Any] | None = None,
    ) -> Self:
        """Draw.

        Parameters
        ----------
        ax : sequence of Axes or None, default=None
            Five panels, or six with one for the delay. None makes a figure.
        line_kw : dict or None, default=None
            Keywords of matplotlib for the estimates.
        band_kw : dict or None, default=None
            Keywords of matplotlib for the bands.
        truth_kw : dict or None, default=None
            Keywords of matplotlib for the truth.
        reference_kw : dict or None, default=None
            Keywords of matplotlib for the references.

        Returns
        -------
        self : OperatorParametersDisplay
        """
        styles = {
            "line": line_kw,
            "band": band_kw,
            "truth": truth_kw,
            "reference": reference_kw,
        }
        names = [name for name in NAMES if name != "tau_e"]
        self._begin([names + ["tau_e"] * (self._delay() is None)], ax)
        over_time = bool(times_of(self.frames.values()))
        for name, panel in zip(self.names_, self.axes_, strict=True):
            for position, label in enumerate(self.frames):
                if over_time:
                    self._draw_over_time(panel, name, position, label)
                else:
                    self._draw_point(panel, name, position, label)
            self._draw_known(panel, name)
            self._limit(panel, name)
            panel.set_ylabel(with_unit(SYMBOLS[name], UNITS[name]), fontsize="large")
            panel.grid(alpha=0.3)
        if over_time:
            for panel in self._bottom:
                panel.set_xlabel("time, s")
        else:
            self._name_points()
        delay = self._delay()
        if delay is not None:
            self.axes_[0].set_title(f"{SYMBOLS['tau_e']} = {delay:.3g} s")
        self._restyle(
            styles,
            line=self.lines_,
            band=self.bands_,
            truth=self.truth_,
            reference=self.references_,
        )
        self._legend_of_panels()
        return self

    def _delay(self) -> float | None:
        """The delay that all estimates share and take as exact, in s."""
        tables = self.frames.values()
        delays = np.concatenate([table["tau_e"] for table in tables])
        delays = delays[np.isfinite(delays)]
        uncertain = any((deviation_of(table, "tau_e") > EXACT).any() for table in tables)
        if uncertain or delays.size == 0 or np.ptp(delays) > EXACT:
            return None
        return float(delays[0])

    def _draw_point(self, panel: Any, name: str, position: int, label: str) -> None:
        table = self.frames[label]
        value, deviation = table[name].iloc[0], np.nan_to_num(deviation_of(table, name))
        point, _, bars = panel.errorbar(
            [position],
            [value],
            deviation[:1],
            color=BLUE,
            marker="o",
            ms=sized(5),
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

    def _name_points(self) -> None:
        crowded = sum(map(len, self.frames)) > CROWDED
        slant: dict[str, Any] = {"rotation": 20, "ha": "right"} if crowded else {}
        for panel in self.axes_:
            panel.set_xticks(range(len(self.frames)), list(self.frames), **slant)
            panel.set_xlim(-0.5, len(self.frames) - 0.5)


def _truth(truth: Any, frames: dict[str, pd.DataFrame]) -> pd.DataFrame | None:
    """True values over the times of the estimates, or in one row where they do not vary."""
    truth = getattr(truth, "parameters", truth)  # the third result of make_tracking_runs
    if isinstance(truth, pd.Series):
        truth = truth.to_frame().T
    times = times_of(frames.values())
    varying = (
        "The truth varies in time and no estimate does, so its values have no place here. Give it "
        "at one instant: truth=operator.at(t), or truth=frame.loc[t]."
    )
    if truth is None:
        return None
    if isinstance(truth, pd.DataFrame):
        truth = in_one_row(truth[[name for name in NAMES if name in truth]])
        if len(truth) > 1 and not times:
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
