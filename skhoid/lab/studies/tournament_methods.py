"""The methods of the tournament, each with its one knob.

Open it to enter another method: an estimator that gives operator parameters over time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib.util import find_spec
from typing import Any

import numpy as np
import pandas as pd
from sklearn.pipeline import make_pipeline

from ... import (
    LPVARX,
    ARXRegressor,
    Decimator,
    DelayBankARX,
    DelayShift,
    OperatorKalman,
    RecursiveARX,
    RecursiveBoxJenkins,
    RecursiveFIR,
    RecursiveIV,
    SigmoidOperator,
    WaveletOperator,
    WindowedOperator,
    operator_parameters,
)
from ...exceptions import did_you_mean
from .tournament_conditions import Points

MEMORY = (0.64, 1.28, 2.56, 5.12, np.inf)  # s
LONGER = (1.28, 2.56, 5.12, 10.24, np.inf)  # s, of recursions that also estimate the noise
FINITE = (1.28, 2.56, 5.12, 10.24, 40.96)  # s
WALK = (0.01, 0.025, 0.05, 0.1, 0.2)  # s^-1/2, of ln K_e and ln K_edot
SCHEDULE = "schedule"  # what the oracle is told


@dataclass(frozen=True)
class TournamentMethod:
    """A method of the tournament.

    Parameters
    ----------
    name : str
        As in tables.
    label : str
        In a few words.
    causal : bool
        Whether estimates at an instant come from data up to it alone.
    kind : callable
        Class of the estimator, or a function that returns one. It is given ``options``, the
        setting of the knob, and ``nk``, the total input delay in samples with that of zero-order
        hold, where it is told the delay.
    options : dict, default={}
        Options of the estimator.
    knob : str or None, default=None
        What is tuned.
    settings : tuple, default=(None,)
        Values of the knob that are tried. All methods that have a knob try as many.
    told : {"", "delay", "schedule"}, default="delay"
        What the method is told of the truth: nothing, so that it estimates tau_e; the delay; or
        what share of the change has happened at each instant, too.
    slow : bool, default=False
        Whether it runs on fewer replications.
    package : str or None, default=None
        Optional package that it needs.
    channels : tuple of str, default=("e",)
        Columns of X, as of :func:`skhoid.make_tracking_runs`.
    read : callable, default=operator_parameters
        Operator parameters over time of the fitted estimator.
    """

    name: str
    label: str
    causal: bool
    kind: Callable[..., Any]
    options: Mapping[str, Any] = field(default_factory=dict)
    knob: str | None = None
    settings: tuple[Any, ...] = (None,)
    told: str = "delay"
    slow: bool = False
    package: str | None = None
    channels: tuple[str, ...] = ("e",)
    read: Callable[[Any], pd.DataFrame] = operator_parameters

    @property
    def estimates_delay(self) -> bool:
        return self.told == ""

    @property
    def is_oracle(self) -> bool:
        """Whether it is told what nobody knows; then it is shown, but not ranked."""
        return self.told == SCHEDULE

    def estimator(self, dt: float, nk: int, setting: Any, truth: pd.DataFrame | None = None) -> Any:
        """An estimator with a setting of its knob; an oracle is told the true parameters."""
        options = dict(self.options)
        if self.knob is not None:
            options[self.knob] = setting
        if not self.estimates_delay:
            options["nk"] = nk
        if self.kind is _fir:
            options["dt"] = dt
        if self.is_oracle and truth is not None:
            options["schedule"] = _schedule(truth["K_edot"])
        return self.kind(**options)

    def missing(self) -> str | None:
        """Why the method cannot take part here; None if it can."""
        if self.package is None or find_spec(self.package) is not None:
            return None
        return f"{self.name} needs the package {self.package}, which is not installed."


def _schedule(K_edot: pd.Series) -> Points | None:
    """The share of the change that has happened; None without a change."""
    way = K_edot.to_numpy(float) - K_edot.iloc[0]
    largest = way[np.abs(way).argmax()]
    if abs(largest) <= 1e-9 * abs(K_edot.iloc[0]):
        return None
    return Points(tuple(K_edot.index), tuple(way / largest))


def _fir(nk: int, memory_time: float, dt: float) -> Any:
    """At 25 Hz, an answer of 1 s after the delay; solved for every 1.28 s."""
    factor = max(1, round(0.04 / dt))
    taps = round(1.0 / (factor * dt))
    model = RecursiveFIR(taps, memory_time=memory_time, every=32, store_covariance=True)
    return make_pipeline(Decimator(factor, padding="periodic"), DelayShift(nk * dt), model)


def _lpv(nk: int, schedule: Any = None) -> Any:
    """With the true progress of K_edot as a function of time; without a change a batch ARX."""
    if schedule is None:
        return ARXRegressor(nk=nk)
    return LPVARX(nk=nk, scheduling="time", basis=schedule)


KEPT = {"store_covariance": True}
_ALL = (
    TournamentMethod(
        "rls", "recursive least squares, λ", True, RecursiveARX, KEPT, "memory_time", MEMORY,
    ),
    TournamentMethod(
        "rls_variable", "recursive least squares, variable λ", True, RecursiveARX,
        KEPT | {"forgetting": "variable"}, "memory_time", (0.64, 1.28, 2.56, 5.12, 20.48),
    ),
    TournamentMethod(
        "rls_auto", "recursive least squares, λ by likelihood", True, RecursiveARX,
        KEPT | {"forgetting": "auto"},
    ),
    TournamentMethod(
        "box_jenkins", "recursive Box-Jenkins", True, RecursiveBoxJenkins, KEPT, "memory_time",
        LONGER,
    ),
    TournamentMethod(
        "iv", "recursive instrumental variables", True, RecursiveIV, KEPT, "memory_time", LONGER,
        channels=("e", "f_t"),
    ),
    TournamentMethod(
        "fir", "regularised recursive FIR at 25 Hz", True, _fir, {}, "memory_time", FINITE,
        slow=True, read=partial(operator_parameters, method="fit"),
    ),
    TournamentMethod(
        "ukf", "unscented Kalman filter of the operator", True, OperatorKalman, {},
        "process_noise", WALK, told="",
    ),
    TournamentMethod(
        "ekf", "extended Kalman filter of the operator", True, OperatorKalman, {"method": "ekf"},
        "process_noise", WALK, told="",
    ),
    TournamentMethod(
        "dual_ekf", "dual extended Kalman filter", True, OperatorKalman, {"method": "dual_ekf"},
        "process_noise", WALK, told="",
    ),
    TournamentMethod(
        "delay_bank", "bank of recursions over delays", True, DelayBankARX, KEPT, "memory_time",
        MEMORY, told="",
    ),
    TournamentMethod(
        "rls_smooth", "recursive least squares, smoothed", False, RecursiveARX,
        KEPT | {"smooth": True}, "memory_time", MEMORY,
    ),
    TournamentMethod(
        "ukf_smooth", "unscented Kalman filter, smoothed", False, OperatorKalman,
        {"smooth": True}, "process_noise", WALK, told="",
    ),
    TournamentMethod(
        "windowed", "maximum likelihood in sliding windows", False, WindowedOperator, {},
        "window", (4.0, 7.0, 12.0, 20.0, 35.0), told="", slow=True,
    ),
    TournamentMethod(
        "wavelet", "Morlet wavelets with the target as instrument", False, WaveletOperator, {},
        "time_smoothing", (0.75, 1.5, 3.0, 6.0, 12.0), told="", slow=True, package="pywt",
        channels=("e", "f_t"),
    ),
    TournamentMethod(
        "sigmoid", "maximum likelihood with a sigmoid", False, SigmoidOperator, told="", slow=True,
    ),
    TournamentMethod(
        "delay_viterbi", "bank of recursions, most probable delays", False, DelayBankARX,
        KEPT | {"path": "viterbi"}, "memory_time", MEMORY, told="",
    ),
    TournamentMethod(
        "lpv", "oracle: batch ARX, linear in the true change", False, _lpv, told=SCHEDULE,
    ),
    TournamentMethod("arx", "batch ARX, nothing changes", False, ARXRegressor),
)  # fmt: skip

TOURNAMENT_METHODS: dict[str, TournamentMethod] = {method.name: method for method in _ALL}
"""Methods by name."""


def available_methods(
    names: Sequence[str] | None = None, *, causal: bool | None = None
) -> tuple[list[TournamentMethod], list[str]]:
    """The methods of these names and of one kind that can take part, and notes on others."""
    wanted = list(TOURNAMENT_METHODS) if names is None else list(names)
    for name in wanted:
        if name not in TOURNAMENT_METHODS:
            raise ValueError(
                f"Unknown method {name!r}; known are {', '.join(TOURNAMENT_METHODS)}."
                f"{did_you_mean(name, TOURNAMENT_METHODS)}"
            )
    chosen = [
        method
        for name, method in TOURNAMENT_METHODS.items()
        if name in wanted and causal in (None, method.causal)
    ]
    notes = [reason for method in chosen if (reason := method.missing()) is not None]
    methods = [method for method in chosen if method.missing() is None]
    if not methods:
        raise ValueError(" ".join(["No method is left to take part.", *notes]))
    return methods, notes
