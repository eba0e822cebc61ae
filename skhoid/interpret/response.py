"""A frequency response at lines with its uncertainty, and where it crosses over."""

from __future__ import annotations

from dataclasses import dataclass, replace
from numbers import Integral
from typing import Any

import numpy as np
import pandas as pd

from .._sklearn import DT, HasMethods, checked
from ..human import ControlledElement, HumanOperator, LinearElement
from ..human.operator import find_last_crossings, find_phase_margin, warn_no_crossover
from ..human.variation import as_floats, evaluate
from ..model import OperatorRegressor
from ..pipelines import taken_apart
from ..runs import run_name
from .arx_channel import ARXChannel, arx_response, describe_response, is_arx
from .linear_part import LinearPart

LONGEST_DELAY, DELAY_STEP = 1.0, 0.005  # s


def find_aligning_delay(omega: np.ndarray, response: np.ndarray) -> float:
    """The delay, up to 1 s, without which the phases of neighbouring lines agree best."""
    phasors = _normalise(np.atleast_2d(response))
    steps = np.nan_to_num(phasors[:, 1:] * phasors[:, :-1].conj()).sum(axis=0)
    candidates = np.arange(0.0, LONGEST_DELAY + DELAY_STEP / 2, DELAY_STEP)
    turns = np.exp(1j * np.outer(candidates, np.diff(omega)))
    return float(candidates[np.argmax((turns @ steps).real)])


def unwrap_phase(omega: np.ndarray, response: np.ndarray, delay: float) -> np.ndarray:
    """Phase in rad, without jumps after a delay is removed; runs follow their mean."""
    turn = omega * delay
    together = np.nan_to_num(_normalise(np.atleast_2d(response))).sum(axis=0)
    known = together != 0
    phase = np.full(omega.shape, np.nan)
    if known.any():
        phase[known] = np.unwrap(np.angle((together * np.exp(1j * turn))[known])) - turn[known]
        phase -= 2 * np.pi * np.ceil(phase[known][0] / (2 * np.pi) - 0.5)
    return phase + np.angle(response * np.exp(-1j * phase))


def _normalise(response: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore", invalid="ignore"):
        return response / np.abs(response)


def find_crossover_at_lines(
    omega: np.ndarray, response: np.ndarray, delay: float, interpolate: bool
) -> tuple[float, float]:
    """Crossover frequency (rad/s) and phase margin (deg) of one open loop at lines."""
    known = np.isfinite(response) & (response != 0)
    omega, response = omega[known], response[known]
    gain = np.log(np.abs(response))
    down = np.flatnonzero((gain[:-1] >= 0) & (gain[1:] < 0))
    if down.size == 0:
        return np.nan, np.nan
    pair = slice(down[-1], down[-1] + 2)
    omega, response, gain = omega[pair], response[pair], gain[pair]
    if not interpolate:
        nearest = np.argmin(np.abs(np.abs(response) - 1.0))
        return float(omega[nearest]), float(find_phase_margin(response[nearest]))
    part = gain[0] / (gain[0] - gain[1])
    at = omega[0] * (omega[1] / omega[0]) ** part
    # The delay's share of the phase is linear in omega and needs no interpolation.
    rest = response * np.exp(1j * omega * delay)
    turn = np.angle(rest[1] / rest[0])
    phase = np.angle(rest[0]) + part * turn - at * delay
    return float(at), float(find_phase_margin(np.exp(1j * phase)))


@checked(
    controlled_element=[HasMethods("frequency_response")],
    dt=DT,
    nk=[Integral, None],
    time=["array-like", None],
)
def crossover_path(
    theta: Any,
    controlled_element: ControlledElement,
    *,
    dt: float | None = None,
    nk: int | None = None,
    time: Any = None,
) -> pd.DataFrame:
    """Crossover frequency and phase margin over time, from a path of ARX parameters.

    At every instant, the last downward crossing of one by H_OL = H_ARX(j omega; theta(t)) H_CE(j
    omega, t) is found on a grid of 160 frequencies, from 0.1 rad/s to Nyquist, and refined by
    bisection to rounding.

    Parameters
    ----------
    theta : array-like of shape (n_instants, n_params), or fitted ARX model
        [a_1, a_2, b_0 ... b_{nb-1}] of the operator at each instant. A model, alone or at the
        end of a pipeline or search, supplies its parameters over time (or its constant ones for
        each of ``time``) and the next two arguments.
    controlled_element : ControlledElement
        Evaluated at the same instants.
    dt : float or None, default=None
        Sampling time of the model in seconds; needed with an array.
    nk : int or None, default=None
        Input delay in samples; needed with an array.
    time : array-like of shape (n_instants,) or None, default=None
        Instants in seconds. None means 0, dt, 2 dt ...

    Returns
    -------
    path : DataFrame with the columns ``omega_c`` (rad/s) and ``phase_margin`` (deg)
        Its index is ``time``. NaN where the open loop does not cross one, with a warning, and
        where ``theta`` is NaN.

    Examples
    --------
    >>> from skhoid import ControlledElement, Sigmoid
    >>> from skhoid import crossover_path
    >>> theta = [[-1.91212, 0.92427, 0.04428, -0.04318]] * 2
    >>> element = ControlledElement(K_c=Sigmoid(90, 60, rate=0.5, time=40.96), omega_b=6.0)
    >>> crossover_path(theta, element, dt=0.01, nk=29, time=[0.0, 81.92]).round(2)
           omega_c  phase_margin
    time
    0.00      1.57         75.94
    81.92     0.96         82.65
    """
    na, delay = 2, 0.0
    if is_arx(theta):
        arx = ARXChannel.of(theta, None, "crossover_path")
        dt, nk, na, delay = arx.dt, arx.nk, arx.na, arx.shift
        time = arx.time if arx.time is not None else [0.0] if time is None else time
        theta = np.broadcast_to(arx.theta, (len(time), arx.theta.shape[-1]))
    if dt is None or nk is None:
        raise ValueError("An array of parameters needs dt (s) and nk (samples) of its model.")
    theta = as_floats(theta, "theta")
    if theta.ndim != 2:
        raise ValueError(f"theta must have the shape (n_instants, n_params); got {theta.shape}.")
    instants = dt * np.arange(len(theta)) if time is None else as_floats(time, "time")
    if instants.shape != (len(theta),):
        raise ValueError(
            f"time holds {instants.size} instants but theta {len(theta)}; give one time per "
            "instant."
        )
    grid = np.geomspace(min(0.1, 0.01 * np.pi / dt), np.pi / dt, 160)
    K_c = evaluate(controlled_element.K_c, instants)
    omega_b = evaluate(controlled_element.omega_b, instants)

    def open_loop(w: np.ndarray, rows: slice | np.ndarray) -> np.ndarray:
        s = 1j * w
        element = K_c[rows, None] / (s * (s + omega_b[rows, None]))
        return arx_response(theta[rows], w, dt, na=na, nk=nk, delay=delay) * element

    omega_c, margin = find_last_crossings(open_loop, grid, len(theta))
    lost = np.isnan(omega_c) & np.isfinite(theta).all(axis=1)
    warn_no_crossover(int(lost.sum()), len(theta), "instants")
    return pd.DataFrame(
        {"omega_c": omega_c, "phase_margin": margin}, index=pd.Index(instants, name="time")
    )


@dataclass(frozen=True, eq=False, repr=False)
class FrequencyResponse:
    """Frequency response at a number of lines, for one system or several runs.

    Made by :meth:`of` from models, and by :func:`fourier_coefficients` from recordings.
    ``response * controlled_element`` is the open loop (freeze an element that varies,
    ``element.at(t)``); covariances are propagated to first order, factors taken as independent.

    Parameters
    ----------
    omega : array-like of shape (n_lines,)
        Frequencies in rad/s, increasing.
    response : array-like of complex, shape (n_lines,) or (n_runs, n_lines)
        H(j omega).
    runs : list of labels or None, default=None
        Labels of the runs.
    input, output : str, default="e" and "u"
        Names of the signals.
    covariance : ndarray of shape (..., n_lines, 2, 2) or None, default=None
        Covariance of the real and imaginary parts at each line.
    coherence : ndarray of the shape of ``response`` or None, default=None
        Share of the power at each line that the forcing functions explain, 0 to 1.
    coefficients : (ndarray, ndarray) or None, default=None
        Fourier coefficients of input and output from which the response was made.
    delay : float or None, default=None
        Known delay in seconds, for unwrapping and interpolation where lines are sparse. None
        estimates one from the response.
    dt : float or None, default=None
        Sampling time in seconds of a discrete-time model, which ends at Nyquist, pi / dt.
    dof : int or None, default=None
        Degrees of freedom of a covariance from few samples; intervals then use Student's t.

    References
    ----------
    Van Grootheest, thesis, Appendix H.

    Examples
    --------
    >>> from skhoid import ControlledElement, HumanOperator
    >>> from skhoid import FrequencyResponse
    >>> operator = FrequencyResponse.of(HumanOperator(), [0.5, 1.0, 2.0, 4.0])
    >>> operator.magnitude.round(3)
    array([0.092, 0.098, 0.118, 0.187])
    >>> open_loop = operator * ControlledElement()
    >>> open_loop.crossover(interpolate=False).round(1)
         omega_c  phase_margin
    run
    0        2.0          70.8
    """

    omega: np.ndarray
    response: np.ndarray
    runs: list[Any] | None = None
    input: str = "e"
    output: str = "u"
    covariance: np.ndarray | None = None
    coherence: np.ndarray | None = None
    coefficients: tuple[np.ndarray, np.ndarray] | None = None
    delay: float | None = None
    dt: float | None = None
    dof: int | None = None

    # NumPy arrays hand the product over to __rmul__.
    __array_ufunc__ = None

    def __post_init__(self) -> None:
        omega = np.asarray(self.omega, dtype=float)
        response = np.asarray(self.response, dtype=complex)
        object.__setattr__(self, "omega", omega)
        object.__setattr__(self, "response", response)
        if omega.ndim != 1 or omega.size == 0 or not np.all(np.isfinite(omega) & (omega > 0)):
            raise ValueError(f"omega must be a list of positive frequencies in rad/s; got {omega}.")
        if np.any(np.diff(omega) <= 0):
            raise ValueError(f"omega must increase; got {omega}. Sort omega and response together.")
        if response.ndim not in (1, 2) or response.shape[-1] != omega.size:
            raise ValueError(
                f"response has the shape {response.shape}; with {omega.size} lines it must be "
                f"({omega.size},) or (n_runs, {omega.size})."
            )
        n_runs = len(response) if response.ndim == 2 else None
        if self.runs is not None and len(self.runs) != n_runs:
            raise ValueError(f"runs names {len(self.runs)} runs, but the response holds {n_runs}.")
        expected = {"covariance": (*response.shape, 2, 2), "coherence": response.shape}
        for name, shape in expected.items():
            value = getattr(self, name)
            if value is not None and np.shape(value) != shape:
                raise ValueError(f"{name} has the shape {np.shape(value)}; it must be {shape}.")

    def __repr__(self) -> str:
        runs = f"runs={len(self.response)}, " if self.response.ndim == 2 else ""
        return (
            f"FrequencyResponse({self.output}/{self.input}, {runs}lines={self.omega.size}, "
            f"{self.omega[0]:.3g} to {self.omega[-1]:.3g} rad/s)"
        )

    @classmethod
    def of(
        cls, system: Any, omega: Any, t: float = 0.0, *, input: str | None = None
    ) -> FrequencyResponse:
        """Frequency response of a model.

        Parameters
        ----------
        system : object with ``frequency_response(omega, t)``, or fitted model
            Physics, or an ARX model, alone or at the end of a pipeline or search: with its delay
            ``nk`` and that of a DelayShift before it, NaN above Nyquist, and with the covariance
            that follows from ``covariance_`` (Eqs. H.11-H.17). Of an OperatorRegressor it is the
            response of its operator, without its effects, with the covariance by the delta method.
        omega : array-like of shape (n_lines,)
            Frequencies in rad/s.
        t : float, default=0.0
            Time in s at which a varying system is frozen.
        input : str or None, default=None
            Name of the input, for a model with several or a HumanOperator ("e", "f_t" or "x").
        """
        lines = np.atleast_1d(np.asarray(omega, dtype=float))
        if is_arx(system):
            return cls(lines, **describe_response(system, lines, input))
        if isinstance(taken_apart(system)[1], OperatorRegressor):
            part = LinearPart.of(system, input, "FrequencyResponse.of")
            return cls(lines, **part.describe_response(lines))
        if not hasattr(system, "frequency_response"):
            raise TypeError(
                "FrequencyResponse.of needs an object with frequency_response(omega, t), or a "
                "fitted ARX model or OperatorRegressor, alone or in a pipeline; got "
                f"{type(system).__name__}."
            )
        if isinstance(system, HumanOperator):
            name = "e" if input is None else input
            response = system.frequency_response(lines, t, name)
            return cls(lines, response, delay=system.tau_e, input=name)
        if input is not None:
            raise ValueError(
                f"A {type(system).__name__} has one input; input={input!r} is for an operator or "
                "a model with several."
            )
        element = isinstance(system, (ControlledElement, LinearElement))
        names: dict[str, Any] = {"input": "u", "output": "x"} if element else {}
        return cls(lines, system.frequency_response(lines, t), delay=0.0, **names)

    @property
    def labels(self) -> list[Any]:
        """Labels of the runs, counted from 0 where they have none."""
        if self.runs is not None:
            return [run_name(run) if isinstance(run, tuple) else run for run in self.runs]
        return list(range(len(np.atleast_2d(self.response))))

    @property
    def nyquist(self) -> float | None:
        """Nyquist frequency pi / dt in rad/s of a discrete-time model."""
        return None if self.dt is None else float(np.pi / self.dt)

    @property
    def magnitude(self) -> np.ndarray:
        """``|H|``, of the shape of ``response`` (Eq. H.3)."""
        return np.abs(self.response)

    @property
    def phase(self) -> np.ndarray:
        """Phase in degrees without jumps of 360 degrees, of the shape of ``response``.

        A delay of 0.3 s alone turns the phase by 110 degrees between the last two lines of the
        thesis's forcing function, so the delay (known, or the one up to 1 s that aligns
        neighbouring lines best) is removed before unwrapping and then restored. Runs are unwrapped
        together: each is within 180 degrees of their mean, whose lowest line is in (-180, 180].
        """
        return np.degrees(unwrap_phase(self.omega, self.response, self._delay()))

    @property
    def magnitude_sd(self) -> np.ndarray | None:
        """Standard deviation of ``|H|`` by Eq. H.9, or None without a covariance."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return self._sd(self.response / self.magnitude)

    @property
    def phase_sd(self) -> np.ndarray | None:
        """Standard deviation of the phase in degrees by Eq. H.10, or None without a covariance."""
        with np.errstate(divide="ignore", invalid="ignore"):
            sd = self._sd(1j * self.response / self.magnitude**2)
        return None if sd is None else np.degrees(sd)

    @property
    def complex_sd(self) -> np.ndarray | None:
        """Total standard deviation sqrt(C_1 + C_2) in the complex plane (Eq. H.7).

        The thesis calls it that of the magnitude, which is ``magnitude_sd``.
        """
        if self.covariance is None:
            return None
        return np.sqrt(self.covariance[..., 0, 0] + self.covariance[..., 1, 1])

    @property
    def complex_phase_sd(self) -> np.ndarray | None:
        """Angle in degrees that ``complex_sd`` spans, ``arctan(sd / |H|)`` or 180 (Eq. H.8)."""
        if self.complex_sd is None:
            return None
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = self.complex_sd / self.magnitude
        return np.where(ratio > 1, 180.0, np.degrees(np.arctan(ratio)))

    def _sd(self, direction: np.ndarray) -> np.ndarray | None:
        """Standard deviation along a direction of the complex plane, one at each line."""
        if self.covariance is None:
            return None
        row = np.stack([direction.real, direction.imag], axis=-1)
        variance = np.einsum("...i,...ij,...j->...", row, self.covariance, row)
        return np.sqrt(np.maximum(variance, 0.0))

    def _delay(self) -> float:
        if self.delay is not None:
            return self.delay
        return find_aligning_delay(self.omega, self.response)

    def select_run(self, run: Any) -> FrequencyResponse:
        """Response of one run, of shape (n_lines,).

        Parameters
        ----------
        run : label
            One of ``labels``.
        """
        if self.response.ndim == 1 or run not in self.labels:
            raise ValueError(f"There is no run {run!r} in {self!r}; the runs are {self.labels}.")
        at = self.labels.index(run)
        return replace(
            self,
            response=self.response[at],
            runs=None,
            covariance=None if self.covariance is None else self.covariance[at],
            coherence=None if self.coherence is None else self.coherence[at],
            coefficients=None,
        )

    def mean(self, *, average: str = "response", standard_error: bool = False) -> FrequencyResponse:
        """Mean over the runs, with the spread of the runs as its covariance.

        Parameters
        ----------
        average : {"response", "coefficients"}, default="response"
            ``"response"`` averages real and imaginary parts (Eqs. H.1-H.4). ``"coefficients"``
            averages Fourier coefficients of input and output before dividing, which still works
            where remnant is as large as the input; all runs must then begin at the same phase of
            the same forcing function.
        standard_error : bool, default=False
            False gives the standard deviation of single runs (n - 1, Eqs. H.5-H.8), True that of
            the mean, sqrt(n) smaller.

        Returns
        -------
        mean : FrequencyResponse
            Of shape (n_lines,), so that :attr:`complex_sd` is Eq. H.7, :attr:`complex_phase_sd` Eq.
            H.8, :attr:`magnitude_sd` and :attr:`phase_sd` Eqs. H.9 and H.10. Where Fourier
            coefficients are known, its ``coherence`` is that of the ensemble,
            ``|mean(U E*)|^2 / (mean(|U|^2) mean(|E|^2))``. No covariance of a single run.
        """
        if self.response.ndim == 1:
            raise ValueError("mean() averages over runs, but this is a single response.")
        if average not in ("response", "coefficients"):
            raise ValueError(f"average must be 'response' or 'coefficients'; got {average!r}.")
        if average == "coefficients" and self.coefficients is None:
            raise ValueError(
                "average='coefficients' needs the Fourier coefficients of input and output, which "
                "only a response of fourier_coefficients with one input has; use 'response'."
            )
        n_runs = len(self.response)
        mean = self.response.mean(axis=0)
        scatter = self.response - mean
        if average == "coefficients" and self.coefficients is not None:
            E, U = self.coefficients
            mean = U.mean(axis=0) / E.mean(axis=0)
            scatter = (U - mean * E) / E.mean(axis=0)
        covariance = coherence = None
        if n_runs > 1:
            parts = np.stack([scatter.real, scatter.imag], axis=-1)
            covariance = np.einsum("rki,rkj->kij", parts, parts) / (n_runs - 1)
            covariance /= n_runs if standard_error else 1
            if self.coefficients is not None:
                E, U = self.coefficients
                power = np.mean(np.abs(U) ** 2, axis=0) * np.mean(np.abs(E) ** 2, axis=0)
                coherence = np.abs(np.mean(U * E.conj(), axis=0)) ** 2 / power
        return replace(
            self,
            response=mean,
            runs=None,
            covariance=covariance,
            coherence=coherence,
            coefficients=None,
            dof=n_runs - 1,
        )

    def to_frame(self) -> pd.DataFrame:
        """Tidy table with one row per run and line.

        Returns
        -------
        table : DataFrame
            Index levels ``run`` and ``omega`` (rad/s), or ``omega`` alone; columns ``magnitude``,
            ``phase`` (deg), and where known ``magnitude_sd``, ``phase_sd`` (deg) and ``coherence``.
        """
        columns = {
            name: np.ravel(values)
            for name in ("magnitude", "phase", "magnitude_sd", "phase_sd", "coherence")
            if (values := getattr(self, name)) is not None
        }
        index: pd.Index = pd.Index(self.omega, name="omega")
        if self.response.ndim == 2:
            index = pd.MultiIndex.from_product([self.labels, index], names=["run", "omega"])
        return pd.DataFrame(columns, index=index)

    def crossover(self, interpolate: bool = True) -> pd.DataFrame:
        """Crossover frequency and phase margin of an open loop.

        The last downward crossing counts: between the highest pair of neighbouring lines where the
        lower has ``|H| >= 1`` and the upper ``|H| < 1``.

        Parameters
        ----------
        interpolate : bool, default=True
            Interpolate ``log |H|`` and the phase, without the delay's part, linearly in log omega.
            False takes the line of the pair where ``|H|`` is nearest 1 (Eqs. 5.9-5.10).

        Returns
        -------
        table : DataFrame with the columns ``omega_c`` (rad/s) and ``phase_margin`` (deg)
            One row per run. NaN, with a warning, where a run does not cross.
        """
        rows = [
            find_crossover_at_lines(self.omega, values, self._delay(), interpolate)
            for values in np.atleast_2d(self.response)
        ]
        table = pd.DataFrame(
            rows,
            columns=["omega_c", "phase_margin"],
            index=pd.Index(self.labels, name="run"),
        )
        warn_no_crossover(int(table["omega_c"].isna().sum()), len(table), "responses")
        return table

    def closed_loop(self) -> FrequencyResponse:
        """Response H / (1 + H) of the closed loop, with unity feedback, for this open loop."""
        slope = 1.0 / (1.0 + self.response) ** 2
        return replace(
            self,
            response=self.response / (1.0 + self.response),
            covariance=_turn(self.covariance, slope),
            coherence=None,
            coefficients=None,
            delay=None,
        )

    def _at_own_lines(self, system: Any) -> FrequencyResponse:
        """Another response, which must be at the same lines, or a model at them."""
        if not isinstance(system, FrequencyResponse):
            return FrequencyResponse.of(system, self.omega)
        same = system.omega.shape == self.omega.shape
        if not same or not np.allclose(system.omega, self.omega, rtol=1e-6, atol=0):
            raise ValueError(
                f"The responses are at different lines: {self!r} and {system!r}. Evaluate the "
                "model at the lines of the other: FrequencyResponse.of(model, response.omega)."
            )
        return system

    def __mul__(self, other: Any) -> FrequencyResponse:
        if not hasattr(other, "frequency_response") and not isinstance(other, FrequencyResponse):
            factor = np.asarray(other)
            if factor.dtype.kind not in "iufc":
                return NotImplemented
            return self._times(factor)
        other = self._at_own_lines(other)
        if self.response.ndim == other.response.ndim == 2 and self.labels != other.labels:
            raise ValueError(
                f"The responses hold different runs: {self.labels} and {other.labels}."
            )
        first, second = (self, other) if other.input == self.output else (other, self)
        chained = second.input == first.output
        delays = (self.delay, other.delay)
        product = self._times(other.response)
        added = _turn(other.covariance, self.response)
        if added is not None:
            own = product.covariance
            total = added if own is None else own + added
            product = replace(product, covariance=total, coherence=None, coefficients=None)
        known = [d for d in (self.dt, other.dt) if d is not None]
        freedom = [d for d in (self.dof, other.dof) if d is not None]
        return replace(
            product,
            runs=self.runs if self.response.ndim == 2 else other.runs,
            input=first.input if chained else self.input,
            output=second.output if chained else self.output,
            delay=None if None in delays else sum(d for d in delays if d is not None),
            dt=max(known, default=None),
            dof=min(freedom, default=None),
        )

    __rmul__ = __mul__

    def _times(self, factor: np.ndarray) -> FrequencyResponse:
        """Product with known complex numbers."""
        response = self.response * factor
        coefficients = self.coefficients
        if coefficients is not None:
            coefficients = (coefficients[0], coefficients[1] * factor)
        covariance = _turn(self.covariance, np.broadcast_to(factor, response.shape))
        same = response.shape == self.response.shape
        return replace(
            self,
            response=response,
            runs=self.runs if same else None,
            covariance=covariance,
            coherence=self.coherence if same else None,
            coefficients=coefficients if same else None,
        )


def _turn(covariance: np.ndarray | None, factor: np.ndarray) -> np.ndarray | None:
    """Covariance of (Re, Im) after multiplication by known complex numbers."""
    if covariance is None:
        return None
    turn = np.empty((*factor.shape, 2, 2))
    turn[..., 0, 0] = turn[..., 1, 1] = factor.real
    turn[..., 1, 0], turn[..., 0, 1] = factor.imag, -factor.imag
    return turn @ covariance @ np.swapaxes(turn, -1, -2)
