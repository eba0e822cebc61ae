"""The response of a fitted ARX model to one input, also behind pipelines and searches."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from sklearn.utils.validation import check_is_fitted

from ..pipelines import taken_apart
from ..preprocessing import Decimator, DelayShift, RunInTrimmer
from ..preprocessing.base import as_fitted
from ..preprocessing.delay_shift import shifted_columns
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
        orders, chosen = model.orders_, _position(model, name)
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
            dt_recording=model.dt_ / (1 if model._mark is None else model._mark.factor),
            shift=delay_before(steps, model, chosen, purpose),
            time=time,
            input=model.inputs_[chosen],
            output=model._output_name,
            delay_path=getattr(model, "delay_path_", getattr(model, "delay_", None)),
            delay_sd=getattr(model, "delay_sd_path_", getattr(model, "delay_sd_", np.nan)),
        )


def is_arx(estimator: Any) -> bool:
    """Whether it is an ARX model, alone or at the end of pipelines and searches."""
    return _has_arx_form(taken_apart(estimator)[1])


def _has_arx_form(model: Any) -> bool:
    return hasattr(model, "to_transfer_function")


def _position(model: Any, name: str | None) -> int:
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


def delay_before(steps: list[Any], model: Any, chosen: int, purpose: str) -> float:
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
        total += step.delay_ * (model._columns[chosen] in shifted_columns(step))
    return total
