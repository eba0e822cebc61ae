"""The linear part of a fitted model: its poles and its step response, with standard errors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from sklearn.utils.validation import check_is_fitted

from .._sklearn import checked
from ..human import LinearElement
from ..human.variation import as_floats
from ..model import OperatorRegressor
from ..pipelines import taken_apart
from .arx_channel import ARXChannel, find_delay_before

MOVED = 1e-3  # standard errors, by which parameters are moved for derivatives
SETTLED = 5.0  # time constants, after which a step response is within 1 % of its end
LONGEST, N_TIMES = 10.0, 201  # s and instants of a step response, by default
ON_POINT = 1e-9  # of z: a pole so near 0 is a delay, one so near 1 an integral

Place = Callable[[np.ndarray], tuple[LinearElement, float]]


@dataclass(frozen=True)
class LinearPart:
    """An element behind a delay in s, for any values ``theta`` of a model's own parameters.

    ``covariance`` is NaN where one of them has no standard error, as after it was moved by hand.
    """

    place: Place
    theta: np.ndarray
    covariance: np.ndarray
    input: str
    output: str

    @classmethod
    def of(cls, model: Any, name: str | None, purpose: str) -> LinearPart:
        """Read it; ``purpose`` says in errors what needs the model."""
        steps, last = taken_apart(model)
        if isinstance(last, OperatorRegressor):
            check_is_fitted(last)
            return cls._of_operator(last, find_delay_before(steps, last, 0, purpose), purpose)
        arx = ARXChannel.of(model, name, purpose)
        if arx.time is not None:
            raise ValueError(f"{purpose} needs constant parameters; those of this model vary.")
        order = max(arx.na, arx.theta.size - arx.na - 1)

        def place(theta: np.ndarray) -> tuple[LinearElement, float]:
            sides = theta[arx.na :], np.r_[1.0, theta[: arx.na]]
            top, bottom = (tuple(np.pad(side, (0, order + 1 - side.size))) for side in sides)
            return LinearElement(top, bottom, arx.dt), arx.delay

        unknown = np.full((arx.theta.size, arx.theta.size), np.nan)
        covariance = unknown if arx.covariance is None else arx.covariance
        return cls(place, arx.theta, covariance, arx.input, arx.output)

    @classmethod
    def _of_operator(cls, model: OperatorRegressor, shift: float, purpose: str) -> LinearPart:
        core: Any = model.simulation_.spec.core
        table = model.parameter_table_
        names = [p.name for p in core.parameters]
        given = 0.0 if model.delay is None else float(model.delay)

        def place(theta: np.ndarray) -> tuple[LinearElement, float]:
            values = dict(zip(names, theta.tolist(), strict=True))
            if model.controller_ is None:
                element = make_operator(values)
            else:
                element = make_controller(values, model.dt_, core.last)
            return element, shift + values.get("tau_e", given)

        if model.controller_ not in (None, "pi", "pid"):
            raise ValueError(
                f"{purpose} takes a model that answers the error alone; a controller "
                f"{model.controller_!r} answers the measurement too."
            )
        own = model.covariance_.columns.get_indexer(names)
        covariance = model.covariance_.to_numpy()[np.ix_(own, own)]
        known = all(np.isfinite(table[name].sd) for name in names)
        return cls(
            place=place,
            theta=np.array([table[name].value for name in names]),
            covariance=covariance if known else np.full_like(covariance, np.nan),
            input=str(model.inputs_[0]),
            output=model.output_name,
        )

    def differentiate(
        self, measure: Callable[[LinearElement, float], np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """What is measured of the part, and its derivatives to ``theta`` on a last axis."""
        value = measure(*self.place(self.theta))
        slopes = np.zeros((*value.shape, self.theta.size), dtype=value.dtype)
        for i, sd in enumerate(np.sqrt(np.diag(self.covariance))):
            if sd > 0:
                move = MOVED * sd * np.eye(self.theta.size)[i]
                up, down = (measure(*self.place(self.theta + m)) for m in (move, -move))
                slopes[..., i] = (up - down) / (2 * MOVED * sd)
        return value, slopes

    def propagate(self, slopes: np.ndarray) -> np.ndarray:
        """Standard errors of what has these derivatives; NaN where they are not known."""
        variance = np.einsum("...i,ij,...j->...", slopes, self.covariance, slopes)
        return np.sqrt(np.maximum(variance, 0.0))

    def describe_response(self, omega: np.ndarray) -> dict[str, Any]:
        """Content of a FrequencyResponse."""

        def measure(element: LinearElement, delay: float) -> np.ndarray:
            return element.frequency_response(omega) * np.exp(-1j * omega * delay)

        response, slopes = self.differentiate(measure)
        parts = np.stack([slopes.real, slopes.imag], axis=-2)
        covariance = parts @ self.covariance @ np.swapaxes(parts, -1, -2)
        element, delay = self.place(self.theta)
        return {
            "response": response,
            "covariance": covariance if np.isfinite(covariance).all() else None,
            "input": self.input,
            "output": self.output,
            "delay": delay,
            "dt": element.dt,
        }


def make_operator(values: dict[str, float]) -> LinearElement:
    """(K_edot s + K_e) omega_nm^2 / (s^2 + 2 zeta_nm omega_nm s + omega_nm^2) (Eqs. 3-5)."""
    square = values["omega_nm"] ** 2
    return LinearElement(
        (values["K_edot"] * square, values["K_e"] * square),
        (1.0, 2 * values["zeta_nm"] * values["omega_nm"], square),
    )


def make_controller(values: dict[str, float], dt: float, last: float) -> LinearElement:
    """K_e + K_i sum of e + K_edot differences of e, filtered, as a model of one simulates them."""
    top, bottom = np.array([values["K_e"]]), np.ones(1)
    actions = [(values["K_i"] * dt * np.array([last, 1 - last]), np.array([1.0, -1.0]))]
    if "K_edot" in values:
        lag = np.array([values["T_f"] + dt, -values["T_f"]])
        actions.append((values["K_edot"] * np.array([1.0, -1.0]), lag))
    for numerator, denominator in actions:
        top = np.polyadd(np.polymul(top, denominator), np.polymul(numerator, bottom))
        bottom = np.polymul(bottom, denominator)
    return LinearElement(tuple(top), tuple(bottom), dt=dt)


@checked(input=[str, None])
def pole_table(model: Any, *, input: str | None = None) -> pd.DataFrame:
    """Poles of the linear part of a fitted model, as natural frequencies and damping.

    Parameters
    ----------
    model : fitted OperatorRegressor or ARX model
        Alone, or at the end of a pipeline or search. Its effects are not in the poles.
    input : str or None, default=None
        Name of the input, for a model with several.

    Returns
    -------
    poles : DataFrame
        A row for each pole, slowest first, without those that are delays (z = 0). ``real`` and
        ``imag`` are in rad/s, or of z for a discrete-time model (``attrs["plane"]`` is "s" or
        "z"). ``frequency`` (rad/s) is ``|s|``, ``damping`` -Re(s)/``|s|`` and ``time_constant``
        (s) -1/Re(s), with s = ln(z)/dt. ``sd_frequency`` and so on are standard errors by the
        delta method, NaN where a parameter was moved by hand, or poles coincide.

    See Also
    --------
    operator_parameters : The operator's own parameters of an ARX model.

    Examples
    --------
    >>> from skhoid import ARXRegressor, make_tracking_runs
    >>> from skhoid.interpret import pole_table
    >>> X, y = make_tracking_runs("C1", 2, remnant_intensity=0.01, random_state=1)
    >>> model = ARXRegressor(nk=29).fit(X, y)
    >>> pole_table(model)[["frequency", "damping", "time_constant"]].round(2)
       frequency  damping  time_constant
    0      11.98     0.43           0.20
    1      11.98     0.43           0.20
    """
    part = LinearPart.of(model, input, "pole_table")
    element, _ = part.place(part.theta)
    coefficients, slopes = part.differentiate(lambda element, _: np.array(element.denominator))
    poles = element.poles.astype(complex)
    if element.dt is not None:
        poles = poles[np.abs(poles) > ON_POINT]
    with np.errstate(divide="ignore", invalid="ignore"):
        s = poles if element.dt is None else np.log(poles) / element.dt
        s = np.where(np.abs(poles - 1) < ON_POINT, 0, s) if element.dt else s  # an integral
        order = np.lexsort((s.imag, np.abs(s)))
        poles, s = poles[order], s[order]
        frequency = np.abs(s)
        damping = -s.real / frequency
        columns = {
            "frequency": frequency,
            "damping": damping,
            "time_constant": np.where(s.real == 0, np.inf, -1 / s.real),
        }
        # dp = -sum dc_k p^(n-k) / P'(p), and of it ds.
        powers = np.vander(poles, coefficients.size)
        ds = -(powers @ slopes) / np.polyval(np.polyder(coefficients), poles)[:, None]
        if element.dt is not None:
            ds = ds / (poles * element.dt)[:, None]
        of_frequency = (s.conj()[:, None] * ds).real / frequency[:, None]
        of_damping = -(ds.real + damping[:, None] * of_frequency) / frequency[:, None]
        of_time = ds.real / s.real[:, None] ** 2
        for name, of in zip(list(columns), (of_frequency, of_damping, of_time), strict=True):
            columns[f"sd_{name}"] = part.propagate(of)
    frame = pd.DataFrame({"real": poles.real, "imag": poles.imag, **columns})
    frame.attrs = {
        "plane": "s" if element.dt is None else "z",
        "units": {"frequency": "rad/s", "damping": "", "time_constant": "s"},
    }
    return frame


@checked(time=["array-like", None], input=[str, None])
def step_response(model: Any, time: Any = None, *, input: str | None = None) -> pd.DataFrame:
    """Response of the linear part of a fitted model to a step of one in its input at 0 s.

    Parameters
    ----------
    model : fitted OperatorRegressor or ARX model
        Alone, or at the end of a pipeline or search. Its effects are not in the response.
    time : array-like of shape (n_instants,) or None, default=None
        Instants in s. None means 201 up to five times the slowest time constant after the delay,
        10 s at most.
    input : str or None, default=None
        Name of the input, for a model with several.

    Returns
    -------
    response : DataFrame with the columns ``output`` and ``sd``
        Its index is ``time``. ``sd`` is the standard error by the delta method, NaN where a
        parameter was moved by hand.

    Examples
    --------
    >>> from skhoid import ARXRegressor, make_tracking_runs
    >>> from skhoid.interpret import step_response
    >>> X, y = make_tracking_runs("C1", 2, remnant_intensity=0.01, random_state=1)
    >>> model = ARXRegressor(nk=29).fit(X, y)
    >>> step_response(model, [0.2, 0.4, 2.0])["output"].round(3).tolist()
    [0.0, 0.314, 0.089]
    """
    part = LinearPart.of(model, input, "step_response")
    element, delay = part.place(part.theta)
    if time is None:
        slow = pole_table(model, input=input)["time_constant"].max()
        settled = SETTLED * slow if np.isfinite(slow) and slow > 0 else LONGEST
        time = np.linspace(0.0, min(delay + settled, LONGEST), N_TIMES)
    instants = np.atleast_1d(as_floats(time, "time"))
    dt = element.dt or max(np.ptp(instants), 1e-9) / (4 * N_TIMES)
    n = int(max(instants.max(), 0.0) / dt) + 2

    def measure(element: LinearElement, delay: float) -> np.ndarray:
        answer = element.answer(np.ones(n), dt)
        return np.interp(instants - delay, dt * np.arange(n), answer, left=0.0)

    output, slopes = part.differentiate(measure)
    index = pd.Index(instants, name="time")
    return pd.DataFrame({"output": output, "sd": part.propagate(slopes)}, index=index)
