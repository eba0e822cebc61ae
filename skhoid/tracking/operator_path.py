"""OperatorPath: a model of an operator whose physical parameters are known over time.

Open it to see how such a model predicts and what tables it shows.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from .._sklearn import DT
from ..arx.base import arx_parameter_table, free_run_output
from ..arx.orders import Orders
from ..arx.recursive import warn_of_times_outside
from ..arx.rls import grid_numbers
from ..exceptions import UsageError
from ..human.operator import held_filter
from ..preprocessing.grid import ModelGrid
from ..regression import DataToFit, RunRegressor, segments
from ..text import VAF_RULE, ModelSummary, estimates_table

ESTIMATED = ("K_e", "K_edot", "tau_e", "omega_nm", "zeta_nm")
SHOWN = ("K_e", "T_L", "K_edot", "tau_e", "omega_nm", "zeta_nm")
MEANINGS = {
    "K_e": "gain on the error",
    "T_L": "lead time constant",
    "K_edot": "gain on the rate of the error",
    "tau_e": "effective time delay",
    "omega_nm": "neuromuscular frequency",
    "zeta_nm": "neuromuscular damping ratio",
}
WHOLE = 1e-6  # of a number of samples, which a delay so near is
ORDERS = Orders(2, (1, 1), (0, 0))  # the delayed error, and the same a sample before


class OperatorPath(RunRegressor):
    """An operator with K_e, K_edot, tau_e, omega_nm and zeta_nm at instants of time in the run.

    ``fit`` of a subclass ends in :meth:`_set_path`. Predictions are free runs of the operator under
    zero-order hold, with the parameters of each instant; between instants of the path the
    logarithms are interpolated, outside it the nearest end holds.
    """

    time_path_: np.ndarray

    _parameter_constraints: dict = {
        "inputs": "no_validation",
        "roles": [dict, None],
        "dt": DT,
        "run": "no_validation",
    }

    def _read_operator_data(self, X: Any, y: Any) -> DataToFit:
        """Read data to fit, and refuse more than one input."""
        data = self._read_data(X, y)
        self._check_one_input()
        return data

    def _check_one_input(self) -> None:
        if len(self._columns) != 1:
            raise UsageError(
                f"{type(self).__name__} has one linear input, the error; got {self.inputs_}.",
                hint="Name it: inputs=['e'], or roles={column: 'e'}.",
                options=["input", "role"],
            )

    def _set_path(
        self,
        numbers: np.ndarray,
        values: Mapping[str, np.ndarray],
        deviations: Mapping[str, np.ndarray],
    ) -> None:
        """Set the path at instants, given by their sample numbers of the grid from time zero."""
        self._numbers = np.asarray(numbers)
        self.time_path_ = self._numbers * self.dt_
        self._path = np.stack([np.asarray(values[name], float) for name in ESTIMATED], axis=-1)
        self._path_frame = operator_frame(values, deviations, self.time_path_)

    @property
    def parameters_path_(self) -> pd.DataFrame:
        if "_path_frame" not in vars(self):
            raise AttributeError(
                f"{type(self).__name__!r} object has no attribute 'parameters_path_': it is there "
                "after fit, and not kept by partial_fit."
            )
        return self._path_frame

    @property
    def parameters_(self) -> pd.DataFrame:
        self._check_fitted()
        last = self.operator_frame().iloc[-1]
        value = last[list(SHOWN)].to_numpy(float)
        sd = last[[f"sd_{name}" for name in SHOWN]].to_numpy(float)
        output, channel = self.output_name, self.inputs_[0]
        units = [self._units.get(name) or f"[{name}]" for name in (output, channel)]
        ratio = "/".join(units)
        units = [ratio, "s", f"{ratio} s", "s", "rad/s", "-"]
        return arx_parameter_table(list(SHOWN), value, sd, units, list(MEANINGS.values()))

    def operator_frame(self) -> pd.DataFrame:
        """The table of ``operator_parameters``: the path, or one row of the latest parameters.

        Returns
        -------
        frame : DataFrame
            K_e, T_L, K_edot, tau_e, omega_nm, zeta_nm and their standard errors.
        """
        self._check_fitted()
        return self._path_frame if "_path_frame" in vars(self) else self._last_frame

    def __sklearn_is_fitted__(self) -> bool:
        return "_path" in vars(self)

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.regressor_tags.poor_score = True  # on data that no operator made
        return tags

    def _free_run(self, grid: ModelGrid, values: np.ndarray) -> np.ndarray:
        numbers = grid_numbers(grid)
        if "_numbers" in vars(self):
            warn_of_times_outside(grid, numbers, self._numbers, self.time_path_)
            at = interpolated(self._numbers, self._path, numbers)
        else:
            at = np.broadcast_to(self._path[-1], (numbers.size, len(ESTIMATED)))
        held = self._hold(grid, grid.thin_inputs(values), self._columns)
        output = operator_output(held.column(0, slice(None)).astype(float), at, grid)
        return output + self._constant_part()

    def summary_table(self) -> ModelSummary:
        facts = {
            "Model": "human operator over time, Eqs. 3-5",
            **self._signal_facts(),
            "Method": self._method_name(),
            "Runs": f"{self._n_runs}",
            **self._grid_facts(),
        }
        return ModelSummary(
            f"{type(self).__name__}: {self.output_name} from {self.inputs_[0]}",
            facts,
            estimates_table(self.parameters_),
            ["The table has the last parameters; parameters_path_ has all.", VAF_RULE],
        )

    def _constant_part(self) -> float:
        """Constant part of the output, beside what the operator makes of the error."""
        return 0.0

    def _method_name(self) -> str:
        raise NotImplementedError


def operator_frame(
    values: Mapping[str, Any], deviations: Mapping[str, Any], time: np.ndarray | None
) -> pd.DataFrame:
    """A table as ``operator_parameters`` gives it."""
    found = {name: np.atleast_1d(np.asarray(values[name], float)) for name in ESTIMATED}
    sd = {name: np.atleast_1d(np.asarray(deviations[name], float)) for name in ESTIMATED}
    with np.errstate(divide="ignore", invalid="ignore"):
        found["T_L"] = found["K_edot"] / found["K_e"]
        if "T_L" in deviations:
            sd["T_L"] = np.atleast_1d(np.asarray(deviations["T_L"], float))
        else:
            sd["T_L"] = np.hypot(sd["K_edot"], found["T_L"] * sd["K_e"]) / np.abs(found["K_e"])
    columns = {name: found[name] for name in SHOWN} | {f"sd_{name}": sd[name] for name in SHOWN}
    index = None if time is None else pd.Index(time, name="time")
    return pd.DataFrame(columns, index=index)


def interpolated(numbers: np.ndarray, path: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Parameters at wanted sample numbers: in the logarithm where a parameter keeps its sign."""
    rows = np.empty((wanted.size, path.shape[1]))
    for i, column in enumerate(path.T):
        known = np.isfinite(column)
        if not known.any():
            rows[:, i] = 0.0
            continue
        at, values = numbers[known], column[known]
        sign = np.sign(values[0])
        if sign != 0 and (np.sign(values) == sign).all():
            rows[:, i] = sign * np.exp(np.interp(wanted, at, np.log(sign * values)))
        else:
            rows[:, i] = np.interp(wanted, at, values)
    return rows


def operator_output(e: np.ndarray, parameters: np.ndarray, grid: ModelGrid) -> np.ndarray:
    """Free run of an operator with the parameters (``ESTIMATED``) of each row of a grid.

    Under zero-order hold u(t) = -a_1 u(t-1) - a_2 u(t-2) + b_0 e(t-1-tau) + b_1 e(t-2-tau); the
    delay of the moment is reached by linear interpolation of the error.
    """
    K_e, K_edot, tau_e, omega_nm, zeta_nm = parameters.T
    a1, a2, step, rate = held_filter(omega_nm, zeta_nm, grid.dt)
    b0 = K_e * step + K_edot * rate
    b1 = K_e * (1 + a1 + a2) - b0
    # The rate is that of K_edot e: each sample of the error keeps the gains that it met.
    theta = np.stack([a1, a2, b0, np.r_[b1[:1], b1[:-1]]], axis=-1)
    lag = tau_e / grid.dt + 1.0
    whole = np.rint(lag)
    lag = np.where(np.abs(lag - whole) <= WHOLE * whole, whole, lag)
    delayed = np.zeros((e.size, 2))
    for begin, end in segments(grid):
        rows = np.arange(end - begin)
        known, values = np.r_[-1, rows], np.r_[0.0, e[begin:end]]
        for column in range(2):
            where = rows - lag[begin:end] - column
            delayed[begin:end, column] = np.interp(where, known, values)
    stretches = (grid.begin, grid.end, grid.past)
    return free_run_output(delayed, stretches, ORDERS, theta, np.arange(e.size))
