"""The response of a fitted ARX model to one input, and its covariance (Section H.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from sklearn.utils.validation import check_is_fitted

from ..pipelines import taken_apart
from ..preprocessing import Decimator, DelayShift, RunInTrimmer
from ..preprocessing.base import as_fitted
from ..runs.roles import columns_of_role


@dataclass(frozen=True)
class ARXChannel:
    """The part of an ARX model that responds to one input.

    ``theta`` is [a_1 ... a_na, b_0 ...], or a path of them with its ``time``; ``shift`` is the
    delay in seconds that DelayShift steps add to ``nk``, ``dt_recording`` the sampling time
    before decimation. ``delay_path`` and ``delay_sd`` are the delay in seconds and its standard
    deviation, at each time, of a model that estimates them.
    """

    theta: np.ndarray
    covariance: np.ndarray | None
    na: int
    nk: int
    dt: float
    dt_recording: float
    shift: float
    time: np.ndarray | None
    input: str
    output: str
    delay_path: np.ndarray | None = None
    delay_sd: Any = np.nan

    @property
    def delay(self) -> float:
        """Total delay in seconds, with the sample that zero-order hold takes."""
        return self.shift + self.nk * self.dt

    @property
    def delays(self) -> Any:
        """The same over time where it varies."""
        return self.delay if self.delay_path is None else self.shift + self.delay_path

    @classmethod
    def of(cls, estimator: Any, name: str | None, purpose: str) -> ARXChannel:
        """Read it; ``purpose`` says in errors what needs the model."""
        steps, model = taken_apart(estimator)
        if not _has_arx_form(model):
            if hasattr(model, "fit"):
                check_is_fitted(model)  # a search without a model yet
            raise TypeError(
                f"{purpose} takes a fitted ARX model, or a pipeline or search that ends in one; "
                f"got {type(model).__name__}."
            )
        check_is_fitted(model)
        orders, chosen = model.orders_, _find_position(model, name)
        first = orders.na + sum(orders.nb[:chosen])
        of_input = [*range(orders.na), *range(first, first + orders.nb[chosen])]
        theta, time = getattr(model, "coef_path_", None), None
        covariance = getattr(model, "covariance_path_", None)
        if theta is None:
            theta, covariance = model.coef_, getattr(model, "covariance_", None)
        else:
            time = np.asarray(model.time_path_, dtype=float)
        if covariance is not None:
            covariance = np.asarray(covariance)[..., of_input, :][..., of_input]
        return cls(
            theta=np.asarray(theta)[..., of_input],
            covariance=covariance,
            na=orders.na,
            nk=orders.nk[chosen],
            dt=model.dt_,
            dt_recording=model.recorded_dt,
            shift=find_delay_before(steps, model, chosen, purpose),
            time=time,
            input=model.inputs_[chosen],
            output=model.output_name,
            delay_path=getattr(model, "delay_path_", getattr(model, "delay_", None)),
            delay_sd=getattr(model, "delay_sd_path_", getattr(model, "delay_sd_", np.nan)),
        )


def is_arx(estimator: Any) -> bool:
    """Whether it is an ARX model, alone or at the end of pipelines and searches."""
    return _has_arx_form(taken_apart(estimator)[1])


def _has_arx_form(model: Any) -> bool:
    return hasattr(model, "to_transfer_function")


def _find_position(model: Any, name: str | None) -> int:
    names = model.inputs_
    if name is not None:
        if name not in names:
            raise ValueError(
                f"input={name!r} is not an input of the model; its inputs are {names}."
            )
        return names.index(name)
    if len(names) == 1:
        return 0
    errors = columns_of_role(names, "e", as_fitted(model).roles)
    if len(errors) != 1:
        raise ValueError(f"The model has the inputs {names}; choose one with input=.")
    return errors[0]


def find_delay_before(steps: list[Any], model: Any, chosen: int, purpose: str) -> float:
    """Delay in seconds that the steps before a model give one of its inputs."""
    total = 0.0
    for step in steps:
        if step in (None, "passthrough") or isinstance(step, (Decimator, RunInTrimmer)):
            continue
        if not isinstance(step, DelayShift):
            raise ValueError(
                f"{purpose} cannot account for {type(step).__name__}, which changes the input "
                f"{model.inputs_[chosen]!r}. Use the last step of the pipeline alone, "
                "pipeline[-1], with its transformed input."
            )
        total += step.delay_ * (model.input_positions[chosen] in step.shifted_columns)
    return total


def arx_response(
    theta: Any, omega: Any, dt: float, *, na: int, nk: int = 0, delay: float = 0.0
) -> np.ndarray:
    """Frequency response from ARX parameters, one set or a path of them.

    H(j omega) = (b_0 + b_1 z^-1 + ... + b_{nb-1} z^-(nb-1)) / (1 + a_1 z^-1 + ... + a_na z^-na)
    times z^-nk e^(-j omega delay), with z = e^(j omega dt) (Eq. H.14, with the delay).

    Parameters
    ----------
    theta : array-like of shape (..., n_params)
        [a_1 ... a_na, b_0 ... b_{nb-1}]; leading axes, such as instants, are kept.
    omega : array-like of shape (n_lines,) or (..., n_lines)
        Frequencies in rad/s.
    dt : float
        Sampling time of the model in seconds.
    na : int
        Number of output lags; the other parameters belong to the input.
    nk : int, default=0
        Input delay in samples.
    delay : float, default=0.0
        Further delay in seconds, such as that of a :class:`~skhoid.DelayShift`.

    Returns
    -------
    H : ndarray of complex, shape (..., n_lines)
        NaN above the Nyquist frequency pi / dt.

    References
    ----------
    Van Grootheest, thesis, Eq. H.14. The printed equation has a spurious (i) and ends in b_{n_b}.

    Examples
    --------
    >>> from skhoid.interpret import arx_response
    >>> abs(arx_response([-0.9, 0.1], [0.0, 10.0], dt=0.01, na=1)).round(3)
    array([1.   , 0.726])
    """
    omega, theta = _check_below_nyquist(omega, dt), np.asarray(theta, dtype=float)
    return differentiate_response(theta, omega, dt, na, nk * dt + delay)[0]


def arx_response_covariance(
    theta: Any, covariance: Any, omega: Any, dt: float, *, na: int, nk: float = 0
) -> np.ndarray:
    """Covariance of the real and imaginary parts of an ARX frequency response.

    By Gauss's approximation C = J P J', with J the real and imaginary parts of the gradient
    dH/da_i = -H z^-i / A and dH/db_i = z^-(nk+i) / A (Eqs. H.11-H.17).

    Parameters
    ----------
    theta : array-like of shape (..., n_params)
        [a_1 ... a_na, b_0 ... b_{nb-1}].
    covariance : array-like of shape (..., n_params, n_params)
        Covariance P of ``theta``.
    omega : array-like of shape (n_lines,)
        Frequencies in rad/s.
    dt : float
        Sampling time of the model in seconds.
    na : int
        Number of output lags.
    nk : float, default=0
        Input delay in samples.

    Returns
    -------
    C : ndarray of shape (..., n_lines, 2, 2)
        [[C_1, C_12], [C_12, C_2]] of each line; NaN above the Nyquist frequency.

    Examples
    --------
    >>> import numpy as np
    >>> from skhoid.interpret import arx_response_covariance
    >>> P = np.diag([1e-4, 1e-6])
    >>> arx_response_covariance([-0.9, 0.1], P, [1.0, 10.0], dt=0.01, na=1).shape
    (2, 2, 2)
    """
    omega, theta = _check_below_nyquist(omega, dt), np.asarray(theta, dtype=float)
    _, gradient = differentiate_response(theta, omega, dt, na, nk * dt)
    parts = np.stack([gradient.real, gradient.imag], axis=-2)
    P = np.asarray(covariance, dtype=float)[..., None, :, :]
    return parts @ P @ np.swapaxes(parts, -1, -2)


def _check_below_nyquist(omega: Any, dt: float) -> np.ndarray:
    omega = np.asarray(omega, dtype=float)
    return np.where(omega * dt <= np.pi * (1 + 1e-9), omega, np.nan)


def describe_response(model: Any, omega: np.ndarray, name: str | None) -> dict[str, Any]:
    """Content of a FrequencyResponse from a fitted ARX model, alone or at the end of a pipeline."""
    arx = ARXChannel.of(model, name, "FrequencyResponse.of")
    if arx.time is not None:
        raise ValueError(
            "The model's parameters vary in time: use arx_response(model.coef_path_, ...) or "
            "crossover_path from skhoid.interpret."
        )
    covariance = arx.covariance
    if covariance is not None:
        covariance = arx_response_covariance(
            arx.theta, covariance, omega, arx.dt, na=arx.na, nk=arx.delay / arx.dt
        )
    return {
        "response": arx_response(arx.theta, omega, arx.dt, na=arx.na, delay=arx.delay),
        "covariance": covariance,
        "input": arx.input,
        "output": arx.output,
        "delay": arx.delay,
        "dt": arx.dt,
    }


def differentiate_response(
    theta: np.ndarray, omega: np.ndarray, dt: float, na: int, delay: float
) -> tuple[np.ndarray, np.ndarray]:
    """H(j omega) e^(-j omega delay), of shape (..., n_lines), and dH/dtheta (Eqs. H.14-H.17).

    ``theta`` (..., n_params) is [a_1 ... a_na, b_0 ...]; ``omega`` (rad/s) may have leading axes.
    """
    n_b = theta.shape[-1] - na
    if n_b < 1:
        raise ValueError(
            f"theta holds {theta.shape[-1]} parameters, of which na={na} belong to the output; "
            "none is left for the input. Give [a_1 ... a_na, b_0 ... b_{nb-1}] on the last axis."
        )
    lags = np.exp(-1j * omega[..., None] * dt * np.arange(max(na + 1, n_b)))
    to_a, to_b = lags[..., 1 : na + 1], lags[..., :n_b]
    with np.errstate(divide="ignore", invalid="ignore"):
        denominator = 1 + _times(to_a, theta[..., :na])
        shares = np.exp(-1j * omega * delay) / denominator
        response = shares * _times(to_b, theta[..., na:])
        slopes = -(response / denominator)[..., None] * to_a, shares[..., None] * to_b
    return response, np.concatenate(slopes, axis=-1)


def respond(theta: np.ndarray, omega: np.ndarray, dt: float, na: int, delay: float) -> np.ndarray:
    """The response of :func:`differentiate_response` at ``omega`` of one axis."""
    n_b = theta.shape[-1] - na
    lags = np.exp(-1j * omega * dt * np.arange(max(na + 1, n_b))[:, None])
    with np.errstate(divide="ignore", invalid="ignore"):
        denominator = 1 + theta[..., :na] @ lags[1 : na + 1]
        return np.exp(-1j * omega * delay) * (theta[..., na:] @ lags[:n_b]) / denominator


def _times(lags: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    return (lags @ coefficients[..., None])[..., 0]
