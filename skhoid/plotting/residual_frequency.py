"""Where in frequency the model fails: spectra, and measured against modelled response."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from scipy.stats import norm

from ._axes import phase_ticks, plain_logarithmic
from ._comparison import ComparisonBaseDisplay, beyond, exceeding, say_instead
from ._roles import ROLES, scaled, sized

# Single lines and harmonics are marks; bins pooled over a band make a curve.
MARKS = {"excited": "o", "odd": "^", "even": "v"}
HARMONICS = {"odd": "odd harmonics", "even": "even harmonics"}
CONFIDENCE = 0.95
SHOWN = 1e-5  # of the highest density of the output, down to which spectra are drawn
EDGE = 1.3
NO_RESPONSE = "Measured response: not available, it needs the target f_t."

DRAWN = {  # by the beginnings of the names of lines
    "measured": ("output", "measured"),
    "simulated": ("model",),
    "residual": ("residual",),
    "remnant": ("noise",),
}


@dataclass(kw_only=True, eq=False, repr=False)
class ResidualFrequencyDisplay(ComparisonBaseDisplay):
    """The residual over frequency, and the response measured and modelled.

    Above, spectra of the measured output, of the residual and of what does not repeat (noise):
    residual above the noise is structure that a better model could explain. Marks are single
    lines or harmonics of a periodic target, curves what lies between. Below, magnitude (and
    phase) of the response from the error to the output, with 95 % intervals. The axis ends where
    the output holds next to nothing.

    Make it with :meth:`from_comparison` or :meth:`from_estimator`.

    Parameters
    ----------
    by_frequency : DataFrame
        ``Comparison.by_frequency``.
    unit : str or None, default=None
        Unit of the output.
    false_alarm : float, default=0.01
        Rate of false alarms of what is marked.

    Attributes
    ----------
    axes_ : ndarray of Axes, shape (2,) or (3,)
        Spectra, magnitude and, if drawn, phase.
    figure_ : Figure
        The figure that holds them.
    lines_ : dict of Line2D
        Spectra by name (``"output"``, ``"residual"``, ``"noise"``), and marks of the residual by
        kind.
    exceeding_ : Line2D or None
        Marks around what exceeds chance.
    gain_, phase_ : dict of Line2D
        ``"measured"`` and ``"model"``; empty where there is no measured response.

    Examples
    --------
    >>> from skhoid import ARXRegressor, compare, make_tracking_runs
    >>> from skhoid.plotting import ResidualFrequencyDisplay
    >>> X, y = make_tracking_runs(
    ...     "C1", n_runs=3, remnant_intensity=0.15, channels=["e", "f_t"], random_state=0
    ... )
    >>> model = ARXRegressor(nk=29).fit(X, y)
    >>> display = ResidualFrequencyDisplay.from_comparison(compare(model, X, y))
    >>> list(display.gain_)
    ['measured', 'model']
    """

    by_frequency: pd.DataFrame
    unit: str | None = None
    false_alarm: float = 0.01

    def plot(
        self,
        ax: Any = None,
        *,
        phase: bool = False,
        measured_kw: dict[str, Any] | None = None,
        simulated_kw: dict[str, Any] | None = None,
        residual_kw: dict[str, Any] | None = None,
        remnant_kw: dict[str, Any] | None = None,
    ) -> Self:
        """Draw.

        Parameters
        ----------
        ax : sequence of two or three Axes or None, default=None
            Where to draw spectra, magnitude and phase. None makes a figure.
        phase : bool, default=False
            Draw the phase too, in a figure made here; of given Axes, the third is the phase.
        measured_kw : dict or None, default=None
            Keywords of matplotlib for the spectrum and response of the measured output.
        simulated_kw : dict or None, default=None
            Keywords of matplotlib for the response of the model.
        residual_kw : dict or None, default=None
            Keywords of matplotlib for the spectrum of the residual.
        remnant_kw : dict or None, default=None
            Keywords of matplotlib for the spectrum of the noise.

        Returns
        -------
        self : ResidualFrequencyDisplay
        """
        styles = {
            "measured": measured_kw,
            "simulated": simulated_kw,
            "residual": residual_kw,
            "remnant": remnant_kw,
        }
        self.axes_ = self._take_axes(
            ax,
            "spectra, magnitude and, if wanted, phase",
            (3 if phase else 2, 1),
            allowed=(2, 3),
            sharex=True,
            figsize=(6.4, 7.6 if phase else 6.0),
            height_ratios=[2, 1.5, 1.5] if phase else [1.2, 1],
        )
        self.lines_, self.exceeding_ = draw_spectra(
            self.axes_[0], self.by_frequency, self.unit, self.false_alarm
        )
        if (self.by_frequency["kind"] == "excited").any():
            self.axes_[0].set_title("dots: excited lines, curves: between them", fontsize="small")
        self.gain_: dict[str, Any] = {}
        self.phase_: dict[str, Any] = {}
        measured = self.by_frequency[self.by_frequency["measured_gain"].notna()]
        below = self.axes_[1:]
        if measured.empty:
            for panel in below:
                say_instead(panel, NO_RESPONSE)
        else:
            self.gain_ = _draw_gain(below[0], measured)
            if len(below) == 2:
                self.phase_ = _draw_phase(below[1], measured)
        lowest = self.axes_[-1] if self.gain_ else self.axes_[0]
        for panel in self.axes_ if self._own else []:
            panel.tick_params(labelbottom=panel is lowest)
        lowest.set_xlabel("frequency, rad/s")
        drawn = {**self.lines_, **self.gain_, **{f"{k} phase": v for k, v in self.phase_.items()}}
        for role, names in DRAWN.items():
            some = [line for name, line in drawn.items() if name.startswith(names)]
            self._restyle(styles, **{role: some})
        self._legend_of_panels()
        return self


def draw_spectra(
    panel: Axes, by_frequency: pd.DataFrame, unit: str | None, false_alarm: float
) -> tuple[dict[str, Any], Any]:
    """Spectra of output, residual and noise; the marks of what exceeds chance."""
    table = by_frequency[by_frequency["omega"] > 0]
    if table.empty or not (table["psd_residual"] > 0).any():
        say_instead(panel, "Where in frequency: not available, no run is long enough.")
        return {}, None
    panel.set_xscale("log")
    panel.set_yscale("log")
    lines: dict[str, Any] = {}
    marked = table["kind"].isin(list(MARKS)).to_numpy()
    curve = table[~marked]
    noise = table[table["psd_noise"] > 0]
    if len(noise):
        (lines["noise"],) = panel.plot(
            noise["omega"],
            noise["psd_noise"],
            color=ROLES["remnant"].colour,
            lw=scaled(3.0),
            alpha=0.6,
            label=ROLES["remnant"].word,
        )
    excited = table[table["kind"] == "excited"]
    for name, role in (
        ("output", ROLES["measured"]),
        ("residual", ROLES["residual"]),
    ):
        colour = role.colour
        values = curve[f"psd_{name}"].where(curve[f"psd_{name}"] > 0)
        (lines[name],) = panel.plot(curve["omega"], values, color=colour, lw=scaled(1.3))
        (lines[f"{name} lines"],) = panel.plot(
            excited["omega"],
            excited[f"psd_{name}"],
            color=colour,
            ls="none",
            marker="o",
            ms=sized(5),
        )
        panel.plot(
            [],
            [],
            color=colour,
            lw=scaled(1.3),
            marker="o" if len(excited) else None,
            label=role.word,
        )
    for kind, label in HARMONICS.items():
        rows = table[table["kind"] == kind]
        if len(rows):
            (lines[kind],) = panel.plot(
                rows["omega"],
                rows["psd_residual"],
                color=ROLES["residual"].colour,
                ls="none",
                marker=MARKS[kind],
                ms=sized(4),
                label=label,
            )
    raised = table[exceeding(table)]
    ring = None
    if len(raised):
        (ring,) = panel.plot(
            raised["omega"],
            raised["psd_residual"],
            ls="none",
            marker="o",
            ms=sized(9),
            mfc="none",
            mec=ROLES["misfit"].colour,
            mew=scaled(1.6),
            label=beyond(false_alarm),
            zorder=4,
        )
    _limit(panel, table)
    plain_logarithmic(panel.xaxis)
    panel.set_ylabel(f"PSD, {unit}² s/rad" if unit else "PSD")
    panel.grid(alpha=0.3)
    return lines, ring


def _limit(panel: Axes, table: pd.DataFrame) -> None:
    """Leave out the high frequencies that hold next to nothing of the output."""
    highest = float(table["psd_output"].max())
    held = table[(table["psd_output"] >= SHOWN * highest) | (table["kind"] == "excited")]
    if highest > 0 and len(held) > 1:
        panel.set_xlim(held["omega"].min() / EDGE, held["omega"].max() * EDGE)
        panel.set_ylim(bottom=SHOWN * highest / 2)


def _draw_gain(panel: Axes, measured: pd.DataFrame) -> dict[str, Any]:
    gain = measured["measured_gain"]
    # As wide on the logarithmic axis above as below.
    factor = np.exp(norm.ppf(0.5 + CONFIDENCE / 2) * measured["sd_gain"] / gain)
    lines = _draw_response(panel, measured, "gain", (gain / factor, gain * factor))
    panel.set_yscale("log")
    both = np.concatenate([line.get_ydata() for line in lines.values()])
    both = both[np.isfinite(both) & (both > 0)]
    # The responses stay in view, however wide their intervals.
    panel.set_ylim(both.min() / 2.5, both.max() * 2.5)
    plain_logarithmic(panel.yaxis)
    panel.set_ylabel("response, magnitude")
    return lines


def _draw_phase(panel: Axes, measured: pd.DataFrame) -> dict[str, Any]:
    spread = norm.ppf(0.5 + CONFIDENCE / 2) * np.minimum(measured["sd_phase"], 180.0)
    phase = measured["measured_phase"]
    lines = _draw_response(panel, measured, "phase", (phase - spread, phase + spread))
    phase_ticks(panel.yaxis)
    panel.set_ylabel("response, phase, deg")
    return lines


def _draw_response(panel: Axes, measured: pd.DataFrame, part: str, interval: Any) -> dict[str, Any]:
    panel.set_xscale("log")
    panel.vlines(
        measured["omega"], *interval, color=ROLES["measured"].colour, lw=scaled(1.2), alpha=0.6
    )
    (found,) = panel.plot(
        measured["omega"],
        measured[f"measured_{part}"],
        color=ROLES["measured"].colour,
        marker="o",
        ms=sized(5),
        ls="none",
        label=f"measured, {100 * CONFIDENCE:g} % interval",
    )
    (model,) = panel.plot(
        measured["omega"],
        measured[f"model_{part}"],
        color=ROLES["simulated"].colour,
        lw=scaled(1.4),
        label=ROLES["simulated"].word,
    )
    plain_logarithmic(panel.xaxis)
    panel.grid(alpha=0.3)
    return {"measured": found, "model": model}
