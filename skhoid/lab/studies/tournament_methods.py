"""The methods of the tournament, each with its one knob.

Open it to enter another method: an estimator that gives operator parameters over time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
import pandas as pd
from sklearn.pipeline import make_pipeline

from ... import Decimator, DelayShift, operator_parameters
from ...exceptions import did_you_mean
from .tournament_conditions import Points

MEMORY = (0.64, 1.28, 2.56, 5.12, np.inf)  # s
LONGER = (1.28, 2.56, 5.12, 10.24, np.inf)  # s
FINITE = (1.28, 2.56, 5.12, 10.24, 40.96)  # s
LONGER = (1.28, 2.56, 5.12, 10.24, np.inf)  # s, of recursions that also estimate the noise
WALK = (0.01, 0.025, 0.05, 0.1, 0.2)  # s^-1/2, of ln K_e and ln K_edot
FIR_STEP, FIR_LENGTH, FIR_EVERY = 0.04, 1.0, 32  # s, s, and steps
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
    make : callable
        ``make(dt, nk, setting)`` returns an estimator; ``nk`` is the total input delay in samples
        of ``dt`` seconds, with that of zero-order hold. With ``told="schedule"`` also
        ``schedule``, the share of the change of K_edot as a function of time, or None without one.
    knob : str or None, default=None
        What is tuned.
    settings : tuple, default=(None,)
        Values of the knob that are tried. All methods that have a knob try as many.
    estimates_delay : bool, default=False
        Whether tau_e is estimated; methods that do not estimate it are told.
    told : {"", "start", "delay", "schedule"}, default="delay"
        What the method is told of the truth: nothing, the delay, or what share of the change has
        happened at each instant.
    slow : bool, default=False
        Whether it runs on fewer replications.
    module : str, default="arx"
        Part of skhoid that it lives in.
    package : str or None, default=None
        Optional package that it needs.
    channels : tuple of str, default=("e",)
        Columns of X, as of :func:`skhoid.make_tracking_runs`.
    read : callable, default=operator_parameters
        Operator parameters over time of the fitted estimator.

    Examples
    --------
    >>> from skhoid.lab.studies import TOURNAMENT_METHODS
    >>> method = TOURNAMENT_METHODS["rls"]
    >>> method.causal, method.knob, len(method.settings)
    (True, 'memory_time', 5)
    >>> method.make(0.01, 29, 2.56)
    RecursiveARX(memory_time=2.56, nk=29, store_covariance=True)
    """

    name: str
    label: str
    causal: bool
    make: Callable[..., Any]
    knob: str | None = None
    settings: tuple[Any, ...] = (None,)
    estimates_delay: bool = False
    told: str = "delay"
    slow: bool = False
    module: str = "arx"
    package: str | None = None
    channels: tuple[str, ...] = ("e",)
    read: Callable[[Any], pd.DataFrame] = operator_parameters

    def estimator(self, dt: float, nk: int, setting: Any, truth: pd.DataFrame | None = None) -> Any:
        """An estimator with a setting of its knob.

        Parameters
        ----------
        dt : float
            Sampling time in s.
        nk : int
            Total input delay in samples.
        setting : object
            One of ``settings``.
        truth : DataFrame or None, default=None
            True parameters over time, for a method that is told what changes.

        Returns
        -------
        estimator : estimator
            Not fitted.
        """
        if not self.is_oracle or truth is None:
            return self.make(dt, nk, setting)
        K_edot = truth["K_edot"]
        way = K_edot.to_numpy(float) - K_edot.iloc[0]
        largest = way[np.abs(way).argmax()]
        if abs(largest) <= 1e-9 * abs(K_edot.iloc[0]):
            return self.make(dt, nk, setting)
        schedule = Points(tuple(truth.index), tuple(way / largest))
        return self.make(dt, nk, setting, schedule=schedule)

    @property
    def is_oracle(self) -> bool:
        """Whether it is told what nobody knows; then it is shown, but not ranked."""
        return self.told == SCHEDULE

    def missing(self) -> str | None:
        """Why the method cannot take part here.

        Returns
        -------
        reason : str or None
            None if it can.
        """
        if self.package is not None and find_spec(self.package) is None:
            return f"{self.name} needs the package {self.package}, which is not installed."
        if find_spec(f"skhoid.{self.module}") is None:
            return f"{self.name} is not part of this version of skhoid."
        return None


def _from(module: str, name: str) -> Any:
    """A class of skhoid, imported when it is used."""
    return getattr(import_module(f"skhoid.{module}"), name)


def _rls(dt: float, nk: int, setting: Any, **options: Any) -> Any:
    kind = _from("arx.recursive", "RecursiveARX")
    return kind(nk=nk, memory_time=setting, store_covariance=True, **options)


def _rls_variable(dt: float, nk: int, setting: Any) -> Any:
    return _rls(dt, nk, setting, forgetting="variable")


def _rls_auto(dt: float, nk: int, setting: Any) -> Any:
    return _rls(dt, nk, None, forgetting="auto")


def _rls_smooth(dt: float, nk: int, setting: Any) -> Any:
    return _rls(dt, nk, setting, smooth=True)


def _arx(dt: float, nk: int, setting: Any) -> Any:
    return _from("arx.batch", "ARXRegressor")(nk=nk)


def _fir(dt: float, nk: int, setting: Any) -> Any:
    """At 25 Hz, an answer of 1 s after the delay; solved for every 1.28 s."""
    kind = _from("tracking.recursive_fir", "RecursiveFIR")
    factor = max(1, round(FIR_STEP / dt))
    taps = round(FIR_LENGTH / (factor * dt))
    model = kind(taps, memory_time=setting, every=FIR_EVERY, store_covariance=True)
    return make_pipeline(Decimator(factor), DelayShift(nk * dt), model)


def _read_fir(model: Any) -> pd.DataFrame:
    return operator_parameters(model, method="fit")


def _kalman(dt: float, nk: int, setting: Any, **options: Any) -> Any:
    kind = _from("tracking.operator_kalman", "OperatorKalman")
    return kind(process_noise=setting, **options)


def _box_jenkins(dt: float, nk: int, setting: Any) -> Any:
    kind = _from("tracking.box_jenkins", "RecursiveBoxJenkins")
    return kind(nk=nk, memory_time=setting, store_covariance=True)


def _delay_bank(dt: float, nk: int, setting: Any, **options: Any) -> Any:
    kind = _from("tracking.delay_bank", "DelayBankARX")
    return kind(memory_time=setting, store_covariance=True, **options)


def _iv(dt: float, nk: int, setting: Any) -> Any:
    kind = _from("tracking.recursive_iv", "RecursiveIV")
    return kind(nk=nk, memory_time=setting, store_covariance=True)


def _wavelet(dt: float, nk: int, setting: Any) -> Any:
    return _from("tracking.wavelet_operator", "WaveletOperator")(time_smoothing=setting)


def _sigmoid(dt: float, nk: int, setting: Any) -> Any:
    return _from("tracking.sigmoid_operator", "SigmoidOperator")()


def _lpv(dt: float, nk: int, setting: Any, schedule: Any = None) -> Any:
    """With the true progress of K_edot as a function of time; without a change a batch ARX."""
    if schedule is None:
        return _arx(dt, nk, setting)
    return _from("tracking.lpv_arx", "LPVARX")(nk=nk, scheduling="time", basis=schedule)


def _windowed(dt: float, nk: int, setting: Any) -> Any:
    return _from("tracking.windowed_operator", "WindowedOperator")(window=setting)


_ALL = (
    TournamentMethod(
        "rls", "recursive least squares, λ", True, _rls, "memory_time", MEMORY,
        module="arx.recursive",
    ),
    TournamentMethod(
        "rls_variable", "recursive least squares, variable λ", True, _rls_variable, "memory_time",
        (0.64, 1.28, 2.56, 5.12, 20.48), module="arx.recursive",
    ),
    TournamentMethod(
        "rls_auto", "recursive least squares, λ by likelihood", True, _rls_auto,
        module="arx.recursive",
    ),
    TournamentMethod(
        "box_jenkins", "recursive Box-Jenkins", True, _box_jenkins, "memory_time", LONGER,
        module="tracking.box_jenkins",
    ),
    TournamentMethod(
        "iv", "recursive instrumental variables", True, _iv, "memory_time", LONGER,
        module="tracking.recursive_iv", channels=("e", "f_t"),
    ),
    TournamentMethod(
        "fir", "regularised recursive FIR at 25 Hz", True, _fir, "memory_time", FINITE, slow=True,
        module="tracking.recursive_fir", read=_read_fir,
    ),
    TournamentMethod(
        "ukf", "unscented Kalman filter of the operator", True, _kalman, "process_noise", WALK,
        estimates_delay=True, told="", module="tracking.operator_kalman",
    ),
    TournamentMethod(
        "ekf", "extended Kalman filter of the operator", True, partial(_kalman, method="ekf"),
        "process_noise", WALK, estimates_delay=True, told="", module="tracking.operator_kalman",
    ),
    TournamentMethod(
        "dual_ekf", "dual extended Kalman filter", True, partial(_kalman, method="dual_ekf"),
        "process_noise", WALK, estimates_delay=True, told="", module="tracking.operator_kalman",
    ),
    TournamentMethod(
        "delay_bank", "bank of recursions over delays", True, _delay_bank, "memory_time", MEMORY,
        estimates_delay=True, told="", module="tracking.delay_bank",
    ),
    TournamentMethod(
        "rls_smooth", "recursive least squares, smoothed", False, _rls_smooth, "memory_time",
        MEMORY, module="arx.recursive",
    ),
    TournamentMethod(
        "ukf_smooth", "unscented Kalman filter, smoothed", False, partial(_kalman, smooth=True),
        "process_noise", WALK, estimates_delay=True, told="", module="tracking.operator_kalman",
    ),
    TournamentMethod(
        "windowed", "maximum likelihood in sliding windows", False, _windowed, "window",
        (4.0, 7.0, 12.0, 20.0, 35.0), estimates_delay=True, told="", slow=True,
        module="tracking.windowed_operator",
    ),
    TournamentMethod(
        "wavelet", "Morlet wavelets with the target as instrument", False, _wavelet,
        "time_smoothing", (0.75, 1.5, 3.0, 6.0, 12.0), estimates_delay=True, told="", slow=True,
        module="tracking.wavelet_operator", package="pywt", channels=("e", "f_t"),
    ),
    TournamentMethod(
        "sigmoid", "maximum likelihood with a sigmoid", False, _sigmoid,
        estimates_delay=True, told="", slow=True, module="tracking.sigmoid_operator",
    ),
    TournamentMethod(
        "delay_viterbi", "bank of recursions, most probable delays", False,
        partial(_delay_bank, path="viterbi"), "memory_time", MEMORY, estimates_delay=True, told="",
        module="tracking.delay_bank",
    ),
    TournamentMethod(
        "lpv", "oracle: batch ARX, linear in the true change", False, _lpv, told=SCHEDULE,
        module="tracking.lpv_arx",
    ),
    TournamentMethod("arx", "batch ARX, nothing changes", False, _arx, module="arx.batch"),
)  # fmt: skip

TOURNAMENT_METHODS: dict[str, TournamentMethod] = {method.name: method for method in _ALL}
"""Methods by name."""


def available_methods(
    names: Sequence[str] | None = None, *, causal: bool | None = None
) -> tuple[list[TournamentMethod], list[str]]:
    """The methods that can take part, and notes on those that cannot.

    Parameters
    ----------
    names : sequence of str or None, default=None
        Names of methods; None means all.
    causal : bool or None, default=None
        Only causal methods, or only offline ones.

    Returns
    -------
    methods : list of TournamentMethod
        In the order of the registry.
    notes : list of str
        Why others are left out.

    Raises
    ------
    ValueError
        If a name is not known, or no method is left.

    Examples
    --------
    >>> from skhoid.lab.studies import available_methods
    >>> methods, notes = available_methods(["rls", "rls_smooth"], causal=True)
    >>> [method.name for method in methods]
    ['rls']
    """
    wanted: Iterable[str] = TOURNAMENT_METHODS if names is None else names
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
