"""Bode plots: frequency responses of operators and open loops, with their uncertainty."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd
from matplotlib.patches import Patch
from scipy.stats import t as student

from ..interpret import FrequencyResponse
from ..pipelines import taken_apart
from ._axes import draw_band, legend_entries, phase_ticks
from ._display import Display, check_option
from ._roles import GREY, PALETTE, ROLES, scaled, sized, veil

SYMBOLS = "osD^vPX"
MAX_MARKERS = 40  # responses with more lines than this are curves
N_POINTS = 300
CONFIDENCE = 0.95
HIGHEST = 60.0  # rad/s, of continuous-time models
LOWEST_PHASE = -540.0  # deg; below it a curve is only the delay, which turns without end


@dataclass(kw_only=True, eq=False, repr=False)
class BodeDisplay(Display):
    """Magnitude and phase over frequency, of one or several frequency responses.

    Responses at no more than 40 lines are markers with error bars, others curves with bands. The
    runs of a response that holds several are averaged, and the bars are those of the mean. The 95 %
    intervals of the magnitude are symmetric on its logarithmic axis. The phase axis ends at -540
    degrees or the lowest marker. A response called "truth" has the colour and line of the truth.

    Make it with :meth:`from_responses` or :meth:`from_estimator`.

    Parameters
    ----------
    responses : dict {label: FrequencyResponse}
        What to draw, each of shape (n_lines,).
    view : {"operator", "open_loop"}, default="operator"
        ``"open_loop"`` marks crossover frequency and phase margin.

    Attributes
    ----------
    %(panels)
    magnitude_, phase_ : dict {label: Line2D}
        The curves or markers: the main artists.
    crossover_ : DataFrame or None
        Crossover frequency and phase margin by label, in the open-loop view.

    Examples
    --------
    >>> import numpy as np
    >>> from skhoid import HumanOperator
    >>> from skhoid import FrequencyResponse
    >>> from skhoid.plotting import BodeDisplay
    >>> omega = np.geomspace(0.1, 30, 200)
    >>> operators = {
    ...     f"$T_L$ = {T_L} s": FrequencyResponse.of(HumanOperator(T_L=T_L), omega)
    ...     for T_L in (0.4, 1.2)
    ... }
    >>> display = BodeDisplay.from_responses(operators)
    >>> display.axes_[1].get_ylabel()
    'phase, deg'
    """

    responses: Mapping[str, FrequencyResponse]
    view: str = "operator"

    @classmethod
    def from_responses(
        cls,
        responses: Any,
        *,
        controlled_element: Any = None,
        view: str = "operator",
        ax: Any = None,
        **kwargs: Any,
    ) -> Self:
        """Draw frequency responses.

        Parameters
        ----------
        responses : FrequencyResponse, list of them, or dict {label: FrequencyResponse}
            In a list each goes by its ``label``, or by its place.
        controlled_element : ControlledElement or None, default=None
            Multiplies every response, for ``view="open_loop"``. None takes them as they are.
        view : {"operator", "open_loop"}, default="operator"
            ``"open_loop"`` marks crossover frequency and phase margin.
        """
        if controlled_element is not None and view == "operator":
            raise ValueError(
                "controlled_element makes open loops of the responses; say view='open_loop' too."
            )
        named: dict[str, FrequencyResponse] = {}
        for label, response in _named(responses).items():
            if not isinstance(response, FrequencyResponse):
                raise TypeError(
                    f"BodeDisplay draws FrequencyResponse; {label!r} is a "
                    f"{type(response).__name__}. FrequencyResponse.of(model, omega) makes one."
                )
            if controlled_element is not None:
                response = response * controlled_element
            if response.response.ndim == 2:
                n_runs = len(response.response)
                if n_runs > 1:
                    response = response.mean(standard_error=True)
                    label = f"{label}, mean of {n_runs} runs"
                else:
                    response = response.select_run(response.labels[0])
            named[label] = response
        return cls(responses=named, view=view).plot(ax, **kwargs)

    @classmethod
    def from_estimator(
        cls,
        model: Any,
        omega: Any = None,
        *,
        controlled_element: Any = None,
        input: str | None = None,
        label: str | None = None,
        compare: Any = None,
        ax: Any = None,
        **kwargs: Any,
    ) -> Self:
        """Draw the frequency response of a fitted ARX model, alone or in a pipeline or search.

        Parameters
        ----------
        model : fitted estimator
            As :meth:`FrequencyResponse.of <skhoid.interpret.FrequencyResponse.of>` takes it.
        omega : array-like of shape (n_lines,) or None, default=None
            Frequencies in rad/s. None means 300 from 0.1 rad/s to Nyquist (60 rad/s without one).
        controlled_element : ControlledElement or None, default=None
            Draws the open loop with it instead of the operator.
        input : str or None, default=None
            Name of the input of a model with several.
        label : str or None, default=None
            Name in the legend. None means the name of the class.
        compare : FrequencyResponse, list or dict of them, or None, default=None
            Other responses of the operator, or models of it, drawn first.
        """
        _, last = taken_apart(model)
        if omega is None:
            highest = np.pi / last.dt_ if hasattr(last, "dt_") else HIGHEST
            omega = np.geomspace(min(0.1, highest / 100), highest, N_POINTS)
        found = FrequencyResponse.of(model, omega, input=input)
        named = {
            name: other
            if isinstance(other, FrequencyResponse)
            else FrequencyResponse.of(other, omega)
            for name, other in ({} if compare is None else _named(compare)).items()
        }
        return cls.from_responses(
            {**named, label or type(last).__name__: found},
            controlled_element=controlled_element,
            view="operator" if controlled_element is None else "open_loop",
            ax=ax,
            **kwargs,
        )

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        check_option("view", self.view, ("operator", "open_loop"))
        self._take_axes(ax, "magnitude and phase", (2, 1), sharex=True, figsize=(6.4, 7.0))
        self.magnitude_: dict[str, Any] = {}
        self.phase_: dict[str, Any] = {}
        top, bottom = self.axes_
        for panel in (top, bottom):
            panel.set_xscale("log")
            panel.grid(alpha=0.3)
        top.set_yscale("log")
        phase_ticks(bottom.yaxis)
        if self.view == "open_loop":
            top.axhline(1.0, color=GREY, lw=scaled(0.8))
            bottom.axhline(-180.0, color=GREY, lw=scaled(0.8))
        reference = self._phase_reference()
        for number, (label, response) in enumerate(self.responses.items()):
            self._draw(number, label, response, reference)
        self._limit()
        self._draw_nyquist()
        self.crossover_ = self._draw_crossovers() if self.view == "open_loop" else None
        top.set_ylabel("magnitude")
        bottom.set_ylabel("phase, deg")
        bottom.set_xlabel("frequency, rad/s")
        if self._own or top.get_shared_x_axes().joined(top, bottom):
            top.tick_params(labelbottom=False)
        self._restyle(kwargs, self.magnitude_, self.phase_)
        entries = legend_entries(self.axes_)
        if any(r.phase_sd is not None for r in self.responses.values()):
            what = f"{100 * CONFIDENCE:g} % intervals"
            entries[what] = Patch(color=GREY, alpha=0.4, lw=0)
        self._legend(list(entries.values()), list(entries))
        return self

    def _phase_reference(self) -> tuple[np.ndarray, np.ndarray] | None:
        """The best known curve, towards which sparse and noisy responses unwrap."""
        curves = [r for r in self.responses.values() if r.omega.size > MAX_MARKERS]
        if not curves:
            return None
        known = [r for r in curves if r.delay is not None]
        curve = (known or curves)[0]
        finite = np.isfinite(curve.phase)
        return curve.omega[finite], curve.phase[finite]

    def _draw(self, number: int, label: str, response: FrequencyResponse, reference: Any) -> None:
        colour = self._colour(label)
        omega, magnitude, phase = response.omega, response.magnitude, response.phase
        if reference is not None:
            nearest = np.interp(np.log(omega), np.log(reference[0]), reference[1])
            turns = np.round((phase - nearest) / 360)
            # A curve moves as a whole; markers, which may be noise, each on its own.
            phase = phase - 360 * (turns if self._sparse(response) else np.nanmedian(turns))
        freedom = np.inf if response.dof is None else max(response.dof, 1)
        z = student.ppf(0.5 + CONFIDENCE / 2, freedom)
        bounds = []
        if response.magnitude_sd is not None and response.phase_sd is not None:
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                factor = np.exp(z * response.magnitude_sd / magnitude)
                bounds.append((magnitude / factor, magnitude * factor))
            spread = np.minimum(z * response.phase_sd, 180.0)
            bounds.append((phase - spread, phase + spread))
        lines = []
        for panel, values, bound in zip(
            self.axes_, (magnitude, phase), bounds or (None, None), strict=True
        ):
            if self._sparse(response):
                style = {"ls": "none", "marker": SYMBOLS[number % len(SYMBOLS)], "ms": sized(5)}
                if bound is not None:
                    panel.vlines(omega, *bound, color=colour, lw=scaled(1.2), alpha=0.6)
            else:
                true = label == ROLES["truth"].word
                style = {"ls": ROLES["truth"].line if true else "-", "lw": scaled(1.4)}
                if bound is not None:
                    draw_band(panel, omega, *bound, colour, alpha=veil(0.2))
            lines += panel.plot(omega, values, color=colour, label=label, **style)
        self.magnitude_[label], self.phase_[label] = lines

    def _colour(self, label: str) -> str:
        """That of the truth for what is called so, else of a place among the others."""
        truth = ROLES["truth"]
        if label == truth.word:
            return truth.colour
        others = [name for name in self.responses if name != truth.word]
        known = len(others) < len(self.responses)
        colours = [colour for colour in PALETTE if not (known and colour == truth.colour)]
        return colours[others.index(label) % len(colours)]

    @staticmethod
    def _sparse(response: FrequencyResponse) -> bool:
        return response.omega.size <= MAX_MARKERS

    def _limit(self) -> None:
        """Keep the responses in view, whatever the size of their intervals."""
        values, phases = (
            np.concatenate([line.get_ydata() for line in lines.values()])
            for lines in (self.magnitude_, self.phase_)
        )
        values, phases = values[np.isfinite(values)], phases[np.isfinite(phases)]
        if values.size:
            self.ax_.set_ylim(values.min() / 2.5, values.max() * 2.5)
            marks = [v.get_ydata() for v in self.phase_.values() if v.get_marker() != "None"]
            lowest = np.nanmin(np.concatenate([[LOWEST_PHASE], *marks]))
            low = max(phases.min(), lowest)
            ends = 90 * np.floor(low / 90 - 0.1), 90 * np.ceil(phases.max() / 90 + 0.1)
            self.axes_[1].set_ylim(*ends)

    def _draw_nyquist(self) -> None:
        known = [r.nyquist for r in self.responses.values() if r.nyquist is not None]
        for frequency in set(known):
            for panel in self.axes_:
                panel.axvline(frequency, color=GREY, ls="--", lw=scaled(1.0))
        if known:  # the others stand below it, their lines say enough
            look: dict[str, Any] = {"rotation": 90, "ha": "right", "va": "top", "color": GREY}
            look |= {"textcoords": "offset points", "fontsize": "small", "annotation_clip": True}
            place = ("data", "axes fraction")
            self.axes_[1].annotate("Nyquist", (max(known), 0.97), (-3, 0), xycoords=place, **look)

    def _draw_crossovers(self) -> Any:
        rows = {}
        top, bottom = self.axes_
        for label, response in self.responses.items():
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # the legend says it
                rows[label] = response.crossover().iloc[0]
            omega_c, margin = rows[label]
            colour = self._colour(label)
            if np.isnan(omega_c):
                bottom.plot([], [], color=colour, ls="none", label=f"{label}: no crossover")
                continue
            for panel in (top, bottom):
                panel.axvline(omega_c, color=colour, ls=":", lw=scaled(1.0))
            text = f"{label}: $\\omega_c$ = {omega_c:.2f} rad/s, $\\varphi_m$ = {margin:.0f}°"
            look: dict[str, Any] = {"color": colour, "lw": scaled(3.0), "alpha": 0.6}
            ends = [-180.0, -180.0 + margin]
            bottom.plot([omega_c] * 2, ends, solid_capstyle="butt", label=text, **look)
        return pd.DataFrame(rows).T


def _named(responses: Any) -> dict[str, FrequencyResponse]:
    """Responses by label."""
    if isinstance(responses, FrequencyResponse):
        responses = [responses]
    if not isinstance(responses, Mapping):
        labels = [getattr(r, "label", None) or f"response {i}" for i, r in enumerate(responses, 1)]
        responses = dict(zip(labels, responses, strict=True))
    if not responses:
        raise ValueError("There are no responses to draw.")
    return {str(label): response for label, response in responses.items()}
